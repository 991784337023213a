"""A whole recording, read through: what of it is sound, what is lost, and where.

The scan does not need a sound file. Where a record lies about its length, the next chunk is
searched for; of a chunk that was cut off, what its complete compressed blocks hold is recovered,
marked as unverified, because the chunk's checksum covers all of it or nothing.
"""

import mmap
import os
import struct
import warnings
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema

from data import container
from data.chunk import HEAD, Records, records, records_as_far, unpack
from data.container import MAGIC, MOST_UNPACKED
from data.errors import BadInput, DamagedRecording, RecordingCut
from data.files import open_regular
from data.seal import LIBRARY

Progress = Callable[[float], None]
RELEASE_BYTES = 1 << 26
_RECORD = struct.Struct("<BQ")
DEFINITIONS = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA)
_PACKINGS = (b"", b"zstd", b"lz4")


@dataclass(frozen=True)
class Finding:
    """Something wrong in a file: at which byte, and what."""

    offset: int
    what: str


@dataclass(frozen=True, eq=False)
class Piece:
    """Something whole in a file: a chunk's records, or a schema, channel, metadata or message outside chunks."""

    offset: int
    opcode: int
    content: bytes = b""
    records: Records | None = None
    verified: bool = True


@dataclass(frozen=True)
class Inspection:
    """What reading a whole file found. `unverifiable` names what no checksum covers."""

    path: Path
    size: int
    findings: tuple[Finding, ...]
    chunks: int
    messages: int
    unverified_messages: int
    unverifiable: str = ""

    @property
    def sound(self) -> bool:
        """Whether nothing is wrong."""
        return not self.findings


def inspect(path: Path, progress: Progress | None = None, definitions: list[Piece] | None = None) -> Inspection:
    """Read all of a recording and say what is sound, lost, and where.

    definitions: takes the schemas, channels and metadata that stand outside chunks.
    Raises BadInput for what is no recording at all (empty, or not beginning like one).
    """
    findings: list[Finding] = []
    chunks = messages = unverified = 0
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        for piece in scan(file, path, findings):
            if piece.records is not None:
                chunks += piece.verified
                messages += len(piece.records.messages) * piece.verified
                unverified += len(piece.records.messages) * (not piece.verified)
            elif piece.opcode == Opcode.MESSAGE:
                messages += 1
            elif definitions is not None and piece.opcode in DEFINITIONS:
                definitions.append(piece)
            if progress:
                progress(piece.offset / size)
        unverifiable = _check_whole(file, path, findings)
    return Inspection(path, size, tuple(findings), chunks, messages, unverified, unverifiable)


def scan(file: BinaryIO, path: Path, findings: list[Finding]) -> Iterator[Piece]:
    """Yield every whole piece of a file in order; what is wrong is added to `findings` on the way."""
    size = os.fstat(file.fileno()).st_size
    if size < len(MAGIC) or file.read(len(MAGIC)) != MAGIC:
        raise BadInput(path, "does not begin as an MCAP recording", "nothing can be salvaged")
    with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as view:
        at = released = len(MAGIC)
        while at < size:
            if size - at == len(MAGIC) and view[at:] == MAGIC:
                return
            opcode, length = _RECORD.unpack_from(view, at) if at + _RECORD.size <= size else (0, size)
            if 0 < opcode <= Opcode.DATA_END and at + _RECORD.size + length <= size:
                yield from _piece(view, (at, opcode, length), path, findings)
                at += _RECORD.size + length
                if at - released > RELEASE_BYTES and hasattr(mmap, "MADV_DONTNEED"):
                    view.madvise(mmap.MADV_DONTNEED)  # what was read need not stay in memory
                    released = at
                continue
            following = _next_chunk(view, at + 1, size)
            cut = _cut_chunk(view, at, size if following is None else following, path)
            if cut is not None:
                yield cut
            until = "the end" if following is None else f"byte {following}"
            kept = f"; {len(cut.records.messages)} messages of it recovered, unverified" if cut and cut.records else ""
            findings.append(Finding(at, f"no whole record stands here; passed over up to {until}{kept}"))
            at = size if following is None else following


def _piece(view: mmap.mmap, head: tuple[int, int, int], path: Path, findings: list[Finding]) -> Iterator[Piece]:
    at, opcode, length = head
    content = view[at + _RECORD.size : at + _RECORD.size + length]
    if opcode == Opcode.CHUNK:
        place = f"{path}, chunk at byte {at}"
        try:
            yield Piece(at, opcode, records=records(unpack(content, place, len(view) + MOST_UNPACKED), place))
        except DamagedRecording as error:
            start, end = HEAD.unpack_from(content)[:2] if length >= HEAD.size else (0, 0)
            lost = f"a chunk (t = {start / 1e9:.3f} to {end / 1e9:.3f} s, {length} bytes) is lost"
            findings.append(Finding(at, f"{lost}: {error.found}"))
    elif opcode in (*DEFINITIONS, Opcode.MESSAGE, Opcode.HEADER):
        yield Piece(at, opcode, content)


def _next_chunk(view: mmap.mmap, first: int, size: int) -> int | None:
    """Return where the next record begins that looks like a chunk in all its fields, or None."""
    step = 1 << 24
    for start in range(first, size, step):
        part = np.frombuffer(view[start : start + step + HEAD.size + _RECORD.size], np.uint8)
        likely = np.flatnonzero((part[:-8] == Opcode.CHUNK) & (part[7 : len(part) - 1] == 0) & (part[8:] == 0))
        for at in likely[likely < step].tolist():
            if _looks_like_chunk(view, start + at, size):
                return int(start + at)
    return None


def _looks_like_chunk(view: mmap.mmap, at: int, size: int) -> bool:
    if at + _RECORD.size + HEAD.size > size:
        return False
    _, length = _RECORD.unpack_from(view, at)
    named = HEAD.unpack_from(view, at + _RECORD.size)[4]
    packed_at = at + _RECORD.size + HEAD.size + named
    if named > 4 or view[packed_at - named : packed_at] not in _PACKINGS:
        return False
    (packed,) = struct.unpack_from("<Q", view, packed_at) if packed_at + 8 <= size else (-1,)
    return bool(packed >= 0 and HEAD.size + named + 8 + packed == length)


def _cut_chunk(view: mmap.mmap, at: int, end: int, path: Path) -> Piece | None:
    """Return what the complete blocks of a chunk hold whose bytes end too early, or None."""
    if not (at + _RECORD.size <= end and view[at] == Opcode.CHUNK and _looks_like_chunk(view, at, end)):
        return None
    named = HEAD.unpack_from(view, at + _RECORD.size)[4]
    first = at + _RECORD.size + HEAD.size + named
    packing, packed = view[first - named : first], view[first + 8 : end]
    unpacked = _as_far(packing, packed, HEAD.unpack_from(view, at + _RECORD.size)[2], len(view))
    try:
        found = records_as_far(unpacked, f"{path}, chunk at byte {at}")
    except DamagedRecording:  # what was unpacked is no run of messages: nothing to recover
        return None
    return Piece(at, int(Opcode.CHUNK), records=found, verified=False)


def _as_far(packing: bytes, packed: bytes, size: int, file_size: int) -> bytes:
    """Return what can be unpacked of a cut stream, at most what its head says and the file justifies."""
    most = min(size, file_size + MOST_UNPACKED)
    if packing == b"":
        return packed[:most]
    if packing == b"zstd":
        import zstandard

        reader = zstandard.ZstdDecompressor().stream_reader(BytesIO(packed), read_size=1 << 12)
        parts: list[bytes] = []
        total = 0
        try:
            while total < most and (part := reader.read(min(1 << 17, most - total))):
                parts.append(part)
                total += len(part)
        except zstandard.ZstdError:  # the block that was cut: what came before it stands
            return b"".join(parts)
        return b"".join(parts)
    import lz4.frame

    try:
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=most))
    except (RuntimeError, EOFError):
        return b""


def _check_whole(file: BinaryIO, path: Path, findings: list[Finding]) -> str:
    """Check structure, summary, data checksum and counts; return what no checksum covers."""
    file.seek(0)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RecordingCut)
            contents = container.walk(file, path)
    except BadInput as error:
        if not findings:
            findings.append(Finding(0, error.found + (f"; {error.expected}" if error.expected else "")))
        return ""
    if contents.cut:
        findings.append(Finding(os.fstat(file.fileno()).st_size, contents.cut))
        return "the end of the file is missing, and with it the checksum of what stands between chunks"
    return _check_data_checksum(file, contents.data_end, contents.library == LIBRARY, findings)


def _check_data_checksum(file: BinaryIO, data_end: int, ours: bool, findings: list[Finding]) -> str:
    file.seek(data_end + _RECORD.size)
    written = int.from_bytes(file.read(4), "little")
    if not written and not ours:
        return "what stands between chunks: its writer stored no checksum of the data section"
    file.seek(0)
    found, left = 0, data_end
    while left and (part := file.read(min(left, 1 << 20))):
        found, left = zlib.crc32(part, found), left - len(part)
    if found != written:
        findings.append(Finding(0, f"the data section's checksum is {found:08x}, should be {written:08x}"))
    return ""


def parse(piece: Piece) -> Schema | Channel | Metadata | None:
    """Return the schema, channel or metadata of a piece; None for another, or one that cannot be read."""
    if piece.opcode not in DEFINITIONS:
        return None
    try:
        record = container.parse(piece.opcode, piece.content, "")
    except DamagedRecording:
        return None
    assert isinstance(record, Schema | Channel | Metadata)
    return record
