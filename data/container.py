"""The bytes of an MCAP file: where its records are, what is whole, what is cut or damaged.

The index is made by walking the record headers, 9 bytes each, and not by believing a summary:
a file that was cut off and a file that is whole are read by the same code.
"""

import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Footer, McapRecord, Message, Metadata, Schema
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


@dataclass
class ChunkPlace:
    """Where a chunk stands, the stamps it holds, and the channels it has messages of."""

    place: Place
    start_ns: int
    end_ns: int
    counts: dict[int, int] = field(default_factory=dict)
    indexed: bool = False


@dataclass
class Contents:
    """What walking the file found. `cut` says in words where the file ends too early, if it does."""

    chunks: list[ChunkPlace] = field(default_factory=list)
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    loose: list[Place] = field(default_factory=list)  # messages outside chunks
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
    if not complete:
        found.cut = f"cut off after {size} bytes, {_reach(found)}"
    if not found.channels:
        _find_channels(file, found, path)
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
        case Opcode.MESSAGE_INDEX if found.chunks:
            channel, length = struct.unpack("<HI", _bytes(file, place, 6, path))
            found.chunks[-1].counts[channel] = length // 16
            found.chunks[-1].indexed = True
        case Opcode.MESSAGE:
            found.loose.append(place)
        case Opcode.SCHEMA | Opcode.CHANNEL | Opcode.METADATA:
            _keep(_record(file, place, path), found)


def _keep(record: McapRecord, found: Contents) -> None:
    if isinstance(record, Schema):
        found.schemas[record.id] = record
    elif isinstance(record, Channel):
        found.channels[record.id] = record
    elif isinstance(record, Metadata):
        found.metadata[record.name] = dict(record.metadata)


def _find_channels(file: BinaryIO, found: Contents, path: Path) -> None:
    """Read the channels out of the chunks themselves: a cut file has no summary that repeats them."""
    for chunk in found.chunks:
        for record in chunk_records(file, chunk, path):
            _keep(record, found)
            if isinstance(record, Message) and not chunk.indexed:
                chunk.counts[record.channel_id] = chunk.counts.get(record.channel_id, 0) + 1


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
    Opcode.FOOTER: lambda stream, _: Footer.read(stream),
    Opcode.MESSAGE: Message.read,
}


def _record(file: BinaryIO, place: Place, path: Path) -> McapRecord:
    from io import BytesIO

    content = _bytes(file, place, place.length, path)
    try:
        record: McapRecord = _READERS[Opcode(place.opcode)](ReadDataStream(BytesIO(content)), place.length)
    except (McapError, ValueError, struct.error, EOFError) as error:
        raise DamagedRecording(f"{path}, byte {place.offset}", f"record cannot be read: {error}") from error
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
    return f"{len(found.chunks)} complete chunks were read"
