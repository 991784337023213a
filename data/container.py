"""The bytes of an MCAP file: where its records are, what is whole, what is cut or damaged.

Records are found by walking their headers, 9 bytes each. What the walk finds is believed only
where a checksum covers it: a whole file's chunks must be those its summary lists (the footer's
checksum covers the summary), and each chunk's content must match its own. A file that was cut off
has no summary; there everything is taken from the chunks themselves.
"""

import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Footer, McapRecord, Message, Metadata, Schema, Statistics
from mcap.stream_reader import CRCValidationError, breakup_chunk

from data.errors import BadInput, DamagedRecording

MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQI")


@dataclass(frozen=True)
class Place:
    """Where one record's content stands in the file."""

    opcode: int
    offset: int
    length: int


@dataclass(frozen=True)
class ChunkPlace:
    """Where a chunk stands, the stamps it holds, and the channels it has messages of."""

    place: Place
    start_ns: int
    end_ns: int
    channels: frozenset[int] | None = None  # None: not known, it must be read


@dataclass
class Contents:
    """What walking the file found. `cut` says in words where the file ends too early, if it does."""

    chunks: list[ChunkPlace] = field(default_factory=list)
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    loose: list[Place] = field(default_factory=list)  # messages outside chunks
    listed: dict[int, ChunkIndex] = field(default_factory=dict)  # what the summary says of chunks
    counts: dict[int, int] | None = None  # messages by channel
    cut: str | None = None


def walk(file: BinaryIO, path: Path) -> Contents:
    """Index an MCAP file. Raises BadInput when it is none, DamagedRecording when records lie."""
    size = os.fstat(file.fileno()).st_size
    if not size:
        raise BadInput(path, "is empty", "expected an MCAP recording")
    head = file.read(len(MAGIC))
    if not MAGIC.startswith(head) or not head:
        raise BadInput(path, f"begins with {head!r}", "expected an MCAP recording; `import` reads CSV logs")
    found = Contents()
    complete = False
    for place in _places(file, size):
        if place.offset + place.length > size:
            break
        if place.opcode == Opcode.FOOTER:
            _check_summary(file, place, path)
            complete = True
            break
        _note(file, place, found, path)
    if complete and found.listed:
        _compare(found, path)
    if not complete:
        found.cut = f"cut off after {size} bytes: {_reach(found)}"
    if not complete or not found.channels:
        _read_all(file, found, path)
    return found


def _places(file: BinaryIO, size: int) -> Iterator[Place]:
    offset = len(MAGIC)
    while offset + _HEAD.size <= size:
        file.seek(offset)
        opcode, length = _HEAD.unpack(file.read(_HEAD.size))
        yield Place(opcode, offset + _HEAD.size, length)
        offset += _HEAD.size + length


def _note(file: BinaryIO, place: Place, found: Contents, path: Path) -> None:
    """Add one record to the index; a chunk's content is not read."""
    match place.opcode:
        case Opcode.CHUNK:
            start, end, _, _ = _CHUNK_HEAD.unpack(_bytes(file, place, _CHUNK_HEAD.size, path))
            found.chunks.append(ChunkPlace(place, start, end))
        case Opcode.MESSAGE:
            found.loose.append(place)
        case Opcode.SCHEMA | Opcode.CHANNEL | Opcode.METADATA | Opcode.CHUNK_INDEX | Opcode.STATISTICS:
            _keep(_record(file, place, path), found)


def _keep(record: McapRecord, found: Contents) -> None:
    match record:
        case Schema():
            found.schemas[record.id] = record
        case Channel():
            found.channels[record.id] = record
        case Metadata():
            found.metadata[record.name] = dict(record.metadata)
        case ChunkIndex():
            found.listed[record.chunk_start_offset + _HEAD.size] = record
        case Statistics():
            found.counts = dict(record.channel_message_counts)


def _compare(found: Contents, path: Path) -> None:
    """Check the chunks against the summary's list, and take their channels from it."""
    walked = {chunk.place.offset: chunk for chunk in found.chunks}
    for offset in walked.keys() | found.listed.keys():
        chunk, listed = walked.get(offset), found.listed.get(offset)
        if chunk is None or listed is None:
            raise DamagedRecording(path, f"chunk at byte {offset} stands in the {'summary' if listed else 'file'} only")
        if (chunk.start_ns, chunk.end_ns) != (listed.message_start_time, listed.message_end_time):
            raise DamagedRecording(path, f"chunk at byte {offset} has other times than the summary lists")
    found.chunks = [
        replace(chunk, channels=frozenset(offsets) if (offsets := found.listed[at].message_index_offsets) else None)
        for at, chunk in walked.items()
    ]


def _read_all(file: BinaryIO, found: Contents, path: Path) -> None:
    """Take channels, times and counts from the chunks' own content, as there is no summary to ask."""
    counts: dict[int, int] = {}
    for index, chunk in enumerate(found.chunks):
        records = chunk_records(file, chunk, path)
        stamps = [record.log_time for record in records if isinstance(record, Message)]
        held = [record.channel_id for record in records if isinstance(record, Message)]
        for record in records:
            _keep(record, found)
        for number in held:
            counts[number] = counts.get(number, 0) + 1
        times = (min(stamps), max(stamps)) if stamps else (0, 0)
        found.chunks[index] = ChunkPlace(chunk.place, *times, frozenset(held))
    for place in found.loose:
        number = loose_message(file, place, path).channel_id
        counts[number] = counts.get(number, 0) + 1
    found.counts = counts


def chunk_records(file: BinaryIO, chunk: ChunkPlace, path: Path) -> list[McapRecord]:
    """Return a chunk's records, its checksum verified. Raises DamagedRecording naming the chunk."""
    place = f"{path}, chunk at byte {chunk.place.offset} (t = {chunk.start_ns / 1e9:.3f} to {chunk.end_ns / 1e9:.3f} s)"
    record = _record(file, chunk.place, path)
    if not isinstance(record, Chunk):
        raise DamagedRecording(place, "is no chunk")
    if record.uncompressed_size > 1 << 31:
        raise DamagedRecording(place, f"claims to unpack to {record.uncompressed_size} bytes")
    try:
        return list(breakup_chunk(record, validate_crc=True))
    except CRCValidationError as error:
        raise DamagedRecording(
            place, f"checksum is {error.actual:08x}, should be {error.expected:08x}", "bytes were changed"
        ) from error
    except (McapError, ValueError, RuntimeError, OSError, struct.error, EOFError) as error:
        raise DamagedRecording(place, f"cannot be unpacked: {error}", "bytes were changed") from error
    except Exception as error:
        if type(error).__name__ == "ZstdError":  # its class stands in a package only the decoder needs
            raise DamagedRecording(place, f"cannot be unpacked: {error}", "bytes were changed") from error
        raise


def loose_message(file: BinaryIO, place: Place, path: Path) -> Message:
    """Return a message that stands outside any chunk."""
    record = _record(file, place, path)
    if not isinstance(record, Message):
        raise DamagedRecording(path, f"byte {place.offset}: is no message")
    return record


_READERS = {
    Opcode.SCHEMA: lambda stream, _: Schema.read(stream),
    Opcode.CHANNEL: lambda stream, _: Channel.read(stream),
    Opcode.METADATA: lambda stream, _: Metadata.read(stream),
    Opcode.CHUNK: lambda stream, _: Chunk.read(stream),
    Opcode.CHUNK_INDEX: lambda stream, _: ChunkIndex.read(stream),
    Opcode.STATISTICS: lambda stream, _: Statistics.read(stream),
    Opcode.FOOTER: lambda stream, _: Footer.read(stream),
    Opcode.MESSAGE: Message.read,
}


def _record(file: BinaryIO, place: Place, path: Path) -> McapRecord:
    from io import BytesIO

    content = _bytes(file, place, place.length, path)
    try:
        record: McapRecord = _READERS[Opcode(place.opcode)](ReadDataStream(BytesIO(content)), place.length)
    except (McapError, ValueError, struct.error, EOFError) as error:
        raise DamagedRecording(
            f"{path}, byte {place.offset}", f"record cannot be read ({type(error).__name__})"
        ) from error
    return record


def _bytes(file: BinaryIO, place: Place, length: int, path: Path) -> bytes:
    file.seek(place.offset)
    content = file.read(min(length, place.length))
    if len(content) < length:
        raise DamagedRecording(f"{path}, byte {place.offset}", f"record has {len(content)} bytes, not {length}")
    return content


def _check_summary(file: BinaryIO, footer: Place, path: Path) -> None:
    record = _record(file, footer, path)
    if not isinstance(record, Footer) or not record.summary_crc or not record.summary_start:
        return
    file.seek(record.summary_start)
    content = file.read(max(0, footer.offset + 16 - record.summary_start))
    if zlib.crc32(content) != record.summary_crc:
        raise DamagedRecording(path, "the summary at its end fails its checksum", "bytes were changed")


def _reach(found: Contents) -> str:
    if not found.chunks:
        return "before its first complete chunk"
    return f"{len(found.chunks)} complete chunks are left, up to t = {found.chunks[-1].end_ns / 1e9:.3f} s"
