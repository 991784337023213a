"""A dashboard's file, written piece by piece as it is logged: memory does not grow with its length.

rerun's own file writer streams, but waits for ever on a full disk. So it writes into a pipe, and a thread of
ours carries that to the file: what the disk refuses is an error here, and rerun never notices.
"""

import os
import threading
from collections.abc import Callable
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import Self
from uuid import uuid4

import rerun as rr
from rerun_bindings import flush_and_cleanup_orphaned_recordings

from data.errors import CannotWrite
from data.files import cannot_write

DESCRIPTORS = Path("/dev/fd")
PIECE = 1 << 20
PENDING = 1 << 24  # bytes that may wait in rerun's queues before `settle` waits for the disk


class Output:
    """Writes one .rrd file, replaced, in a `with` block; log to `.stream`.

    The viewer keeps one blueprint for each application, so each file is an application of its own, named after `name`.
    Raises CannotWrite, at the latest when the block ends, for a place that cannot be written.
    """

    def __init__(self, name: str, path: Path) -> None:
        flush_and_cleanup_orphaned_recordings()  # rerun keeps two threads for each stream that was ever made
        rr.set_strict_mode(True)  # what rerun would only warn of is an error here
        self.path = path
        self.stream = rr.RecordingStream(f"{name}-{uuid4().hex}")
        self._failed: OSError | None = None
        self._pending = 0

    def __enter__(self) -> Self:
        """Open the file and the pipe."""
        if not DESCRIPTORS.exists():  # Windows
            self.stream.disconnect()
            raise CannotWrite(
                self.path, f"a dashboard is written through {DESCRIPTORS}: use Linux, macOS or WSL for it"
            )
        try:
            file = self.path.open("wb", buffering=0)
        except OSError as error:
            self.stream.disconnect()
            raise cannot_write(self.path, error) from error
        source, sink = os.pipe()
        try:
            self.stream.set_sinks(rr.FileSink(str(DESCRIPTORS / str(sink))))  # opens the pipe's end anew
        except BaseException:
            os.close(source)
            file.close()
            self.stream.disconnect()
            raise
        finally:
            os.close(sink)
        self._carrier = threading.Thread(target=self._carry, args=(source, file), daemon=True)
        self._carrier.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        """Finish the file; what went wrong in the block matters more than the disk."""
        self.stream.disconnect()  # writes the file's end and closes the pipe
        self._carrier.join()
        if error is None:
            self._check()

    def settle(self, size: int = PENDING) -> None:
        """Say that `size` bytes more were logged; waits for the disk when many are pending. Raises CannotWrite."""
        self._pending += size
        if self._pending >= PENDING:
            self.stream.flush()
            self._pending = 0
            self._check()

    def _check(self) -> None:
        if self._failed is not None:
            raise cannot_write(self.path, self._failed) from self._failed

    def _carry(self, source: int, file: FileIO) -> None:
        """Copy the pipe into the file until rerun closes it; after a failure read on, so that rerun never waits."""
        with os.fdopen(source, "rb", buffering=0) as pipe, file as out:
            while piece := pipe.read(PIECE):
                try:
                    while piece and self._failed is None:
                        piece = piece[out.write(piece) :]
                except OSError as error:
                    self._failed = error


def write(name: str, path: Path, log: Callable[[rr.RecordingStream], None]) -> None:
    """Write what `log` logs to `path`, replaced. Raises CannotWrite."""
    with Output(name, path) as output:
        log(output.stream)
