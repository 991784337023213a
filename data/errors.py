"""Every error the project raises on purpose."""

import difflib
from collections.abc import Iterable
from pathlib import Path
from typing import Any


class CatheterError(Exception):
    """Root of all the project's errors: one sentence with numbers and a remedy."""


class BadInput(CatheterError):
    """Something given to the project is not what it must be.

    The message names the place (file, line, field or topic), the value found and what was
    expected there.
    """

    def __init__(self, place: object, found: str, expected: str = "") -> None:
        self.place, self.found, self.expected = str(place), found, expected
        super().__init__(f"{place}: {found}" + (f"; {expected}" if expected else ""))

    def __reduce__(self) -> tuple[Any, ...]:
        """Say how it is made anew in the process that asked for the work: from its parts, not from its sentence."""
        return type(self), (self.place, self.found, self.expected), self.__dict__


class DamagedRecording(BadInput):
    """A recording whose bytes are not the bytes that were written."""


class DidNotConverge(CatheterError):
    """A computation that found no answer it can vouch for: the message has the numbers and a remedy."""


class CannotWrite(CatheterError):
    """An output that would overwrite something, or a place that cannot be written."""

    def __init__(self, path: Path | str, reason: str) -> None:
        self.path, self.reason = Path(path), reason
        super().__init__(f"{path}: {reason}")

    def __reduce__(self) -> tuple[Any, ...]:
        """Say how it is made anew in another process."""
        return type(self), (self.path, self.reason), self.__dict__


class RecordingCut(UserWarning):
    """A recording ends before its end: what came before the cut is sound and was read."""


def nearest(name: str, known: Iterable[str]) -> str:
    """Return 'did you mean ...' for a misspelt name, with all the known ones."""
    names = list(known)
    close = difflib.get_close_matches(name, names, n=1)
    return (f"did you mean {close[0]!r}? " if close else "") + f"known: {', '.join(names) or 'none'}"
