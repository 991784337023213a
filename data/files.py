"""Outputs that overwrite nothing: written beside their place, moved there when complete."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from data.errors import BadInput, CannotWrite


def open_regular(path: Path) -> BinaryIO:
    """Open a file for reading. Raises BadInput when it is none: a pipe or a device may never end."""
    try:
        if path.exists() and not path.is_file():
            raise BadInput(path, "is no regular file", "name a file")
        return path.open("rb")
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise BadInput(path, f"cannot be read: {getattr(error, 'strerror', error)}", "name a file") from error


def check_inputs(output: Path, *inputs: Path) -> None:
    """Raise CannotWrite when an output is one of the inputs, whatever the user forces."""
    for path in inputs:
        if output.exists() and path.exists() and output.samefile(path):
            raise CannotWrite(output, "is an input of the same command and is never overwritten; name another file")


def check_free(path: Path, replace: bool = False) -> None:
    """Raise CannotWrite when `path` exists (unless `replace`) or its folder is not there."""
    if path.is_symlink() and not path.exists():
        raise CannotWrite(path, "is a link to nothing; name another file")
    if path.is_dir():
        raise CannotWrite(path, "is a folder; name a file")
    if path.exists() and not replace:
        raise CannotWrite(path, "exists and is not overwritten; name another file, or ask to replace it (--force)")
    if not path.parent.is_dir():
        raise CannotWrite(path, f"the folder {path.parent} does not exist; create it first")


def unused(path: Path) -> Path:
    """Return `path`, or with -2, -3 ... before its suffix the first such path that is free."""
    number, candidate = 1, path
    while candidate.exists():
        number += 1
        candidate = path.with_stem(f"{path.stem}-{number}")
    return candidate


def place(temporary: Path, path: Path, replace: bool = False) -> None:
    """Move a finished file to its place in one step; raises CannotWrite if that is taken by now."""
    try:
        if replace:
            temporary.replace(path)
            return
        try:
            os.link(temporary, path)  # unlike a rename, this fails when the place is taken
        except FileExistsError:
            raise CannotWrite(path, f"was created by another program meanwhile; {temporary} holds our data") from None
        except OSError:  # a file system without hard links (a memory stick)
            check_free(path)
            temporary.rename(path)
        else:
            temporary.unlink()
    except OSError as error:
        raise cannot_write(path, error) from error


def cannot_write(path: Path, error: OSError) -> CannotWrite:
    """Return the project's error for what the operating system refused."""
    return CannotWrite(path, f"cannot be written: {error.strerror or error}; free space or name another place")


@contextmanager
def fresh(path: Path, replace: bool = False) -> Iterator[Path]:
    """Yield a temporary path beside `path`; on success it is moved there, on failure removed.

    Raises CannotWrite when the place is taken or cannot be written.
    """
    check_free(path, replace)
    temporary = unused(path.with_stem(f".{path.stem}.partial"))
    try:
        yield temporary
        place(temporary, path, replace)
    except OSError as error:
        raise cannot_write(path, error) from error
    except CannotWrite as error:
        if error.path != temporary:
            raise
        raise CannotWrite(path, error.reason) from error  # the user knows the place, not our file beside it
    finally:
        with suppress(FileNotFoundError):
            temporary.unlink()
