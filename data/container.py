"""The bytes of an MCAP file: where its records are, what is whole, what is cut or damaged.

Records are found by walking their headers, 9 bytes each. What the walk finds is believed only
where a checksum covers it: a whole file's chunks must be those its summary lists (the footer's
checksum covers the summary), and each chunk's content must match its own. A file that was cut off
has no summary; there everything is taken from the chunks themselves.
"""

import os
import struct
import zlib
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from threading import Lock
from typing import BinaryIO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    Footer,
    Header,
    McapRecord,
    Message,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from data.chunk import HEAD, Records, records, unpack
from data.errors import BadInput, DamagedRecording
from data.seal import LIBRARY, SEAL, unseal

MOST_UNPACKED = 32 << 20  # beyond the file's own size: a chunk that claims more is taken for damage
MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")
_ONE_AT_A_TIME = Lock()  # a file has one position, and a chunk may be read ahead
_FOOTER_BYTES = 20
_PRIVATE = 0x80  # opcodes from here on are anybody's

_DATA = {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.MESSAGE_INDEX, Opcode.ATTACHMENT}
_DATA |= {Opcode.METADATA, Opcode.DATA_END}
_SUMMARY = {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS, Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX}
_SUMMARY |= {Opcode.METADATA_INDEX, Opcode.SUMMARY_OFFSET, Opcode.FOOTER}


@dataclass(frozen=True)
class Place:
    """Where one record's content stands in the file."""

    opcode: int
    offset: int
    length: int


@dataclass(frozen=True)
class ChunkPlace:
    """Where a chunk stands, what its head says, and the channels it has messages of."""

    place: Place
    start_ns: int
    end_ns: int
    packing: tuple[int, str] = (0, "")  # unpacked size, compression
    channels: frozenset[int] | None = None  # None: not known, it must be read


@dataclass
class Contents:
    """What walking the file found. `cut` says in words where the file ends too early, if it does."""

    chunks: list[ChunkPlace] = field(default_factory=list)
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    places: dict[int, str] = field(default_factory=dict)  # of the metadata, by byte
    loose: list[Place] = field(default_factory=list)  # messages outside chunks
    listed: dict[int, ChunkIndex] = field(default_factory=dict)  # what the summary says of chunks
    listed_metadata: dict[int, str] = field(default_factory=dict)
    statistics: Statistics | None = None
    counts: dict[int, int] | None = None  # messages by channel, as the summary says or as they were counted
    library: str = ""
    data_end: int = 0  # where the record stands that ends the data section
    cut: str | None = None


def walk(file: BinaryIO, path: Path) -> Contents:
    """Index an MCAP file. Raises BadInput when it is none, DamagedRecording when records lie."""
    size = os.fstat(file.fileno()).st_size
    if not size:
        raise BadInput(path, "is empty", "expected an MCAP recording")
    head = file.read(len(MAGIC))
    if not MAGIC.startswith(head) or not head:
        raise BadInput(path, f"begins with {head!r}", "expected an MCAP recording; `import` reads text logs")
    found, complete = Contents(), False
    allowed = {Opcode.HEADER}
    for place in _places(file, size):
        if place.offset + place.length > size:
            _check_really_cut(file, place, size, path)
            break
        private = place.opcode >= _PRIVATE and found.library != LIBRARY  # ours has none
        if place.opcode not in allowed and not private:
            raise DamagedRecording(f"{path}, byte {place.offset}", f"a record of kind {place.opcode} cannot stand here")
        if place.opcode == Opcode.DATA_END:
            found.data_end = place.offset - _HEAD.size
        allowed = _SUMMARY if place.opcode == Opcode.DATA_END else allowed if allowed is _SUMMARY else _DATA
        if place.opcode == Opcode.FOOTER:
            complete = _check_footer(file, place, path, found.library == LIBRARY)
            break
        _note(file, place, found, path)
    if complete:
        _compare(found, path)
    else:
        found.cut = f"cut off after {size} bytes: {_reach(found)}"
    described = all(channel.schema_id in {0, *found.schemas} for channel in found.channels.values())
    if not complete or not found.channels or not described:
        _read_all(file, found, path)
    return found


def _places(file: BinaryIO, size: int) -> Iterator[Place]:
    offset = len(MAGIC)
    while offset + _HEAD.size <= size:
        file.seek(offset)
        opcode, length = _HEAD.unpack(file.read(_HEAD.size))
        yield Place(opcode, offset + _HEAD.size, length)
        offset += _HEAD.size + length


def _check_really_cut(file: BinaryIO, place: Place, size: int, path: Path) -> None:
    """Raise DamagedRecording when a record runs over the end of a file that does have its end."""
    file.seek(max(0, size - len(MAGIC)))
    if file.read() == MAGIC:
        found = f"a record claims {place.length} bytes, {size - place.offset} are left"
        raise DamagedRecording(f"{path}, byte {place.offset}", found, "bytes were changed")


def _check_footer(file: BinaryIO, footer: Place, path: Path, ours: bool) -> bool:
    """Return whether the file ends as it should, False if cut; raise DamagedRecording otherwise."""
    end = footer.offset + footer.length
    file.seek(end)
    tail = file.read(len(MAGIC) + 1)
    if footer.length != _FOOTER_BYTES or (tail != MAGIC and not MAGIC.startswith(tail)):
        raise DamagedRecording(f"{path}, byte {footer.offset}", "the footer is not the end of the file")
    if tail != MAGIC:
        return False
    record = _record(file, footer, path)
    assert isinstance(record, Footer)
    if record.summary_start or ours:  # ours always has a summary
        if not len(MAGIC) < record.summary_start < footer.offset:
            raise DamagedRecording(path, f"the summary begins at byte {record.summary_start}")
        file.seek(record.summary_start)
        content = file.read(footer.offset + 16 - record.summary_start)
        if (record.summary_crc or ours) and zlib.crc32(content) != record.summary_crc:
            raise DamagedRecording(path, "the summary at its end fails its checksum", "bytes were changed")
    return True


def _note(file: BinaryIO, place: Place, found: Contents, path: Path) -> None:
    """Add one record to the index; a chunk's content is not read."""
    match place.opcode:
        case Opcode.CHUNK:
            found.chunks.append(_chunk_place(file, place, path))
        case Opcode.MESSAGE:
            found.loose.append(place)
        case opcode if opcode in _READERS:
            record = _record(file, place, path)
            _keep(record, found, f"{path}, byte {place.offset}")
            if isinstance(record, Metadata):
                found.places[place.offset - _HEAD.size] = record.name


def _chunk_place(file: BinaryIO, place: Place, path: Path) -> ChunkPlace:
    start, end, size, _, length = HEAD.unpack(_bytes(file, place, HEAD.size, path))
    name = file.read(min(length, 32)).decode("latin-1")
    return ChunkPlace(place, start, end, (size, name))


def _keep(record: McapRecord, found: Contents, place: str) -> None:
    match record:
        case Header():
            found.library = record.library
        case Schema():
            found.schemas[record.id] = record
        case Channel():
            found.channels[record.id] = record
        case Metadata():
            fields = dict(record.metadata)
            fields = unseal(record.name, fields, place) if found.library == LIBRARY or SEAL in fields else fields
            if found.metadata.setdefault(record.name, fields) != fields:
                raise DamagedRecording(f"{place}, metadata {record.name!r:.40}", "stands twice, with different content")
        case ChunkIndex():
            found.listed[record.chunk_start_offset + _HEAD.size] = record
        case MetadataIndex():
            found.listed_metadata[record.offset] = record.name
        case Statistics():
            counts = dict(record.channel_message_counts)
            found.statistics, found.counts = record, counts if counts or not record.message_count else None


def _compare(found: Contents, path: Path) -> None:
    """Check what was walked against the summary, and take the chunks' channels from it."""
    counted = found.statistics
    if counted and (counted.chunk_count, counted.metadata_count) != (len(found.chunks), len(found.places)):
        what = f"{len(found.chunks)} chunks and {len(found.places)} metadata records"
        listed = f"the summary lists {counted.chunk_count} and {counted.metadata_count}"
        raise DamagedRecording(path, f"holds {what}", listed)
    if found.listed_metadata and found.listed_metadata != found.places:
        raise DamagedRecording(path, "its metadata are not those its summary lists", "bytes were changed")
    if not found.listed:
        return
    walked = {chunk.place.offset: chunk for chunk in found.chunks}
    for offset in walked.keys() | found.listed.keys():
        chunk, index = walked.get(offset), found.listed.get(offset)
        if chunk is None or index is None:
            raise DamagedRecording(path, f"chunk at byte {offset} stands in the {'summary' if index else 'file'} only")
        head = (index.message_start_time, index.message_end_time, (index.uncompressed_size, index.compression))
        if (chunk.start_ns, chunk.end_ns, chunk.packing) != head:
            raise DamagedRecording(path, f"the head of the chunk at byte {offset} is not as its summary lists it")
    found.chunks = [
        replace(chunk, channels=frozenset(offsets) if (offsets := found.listed[at].message_index_offsets) else None)
        for at, chunk in walked.items()
    ]


def _read_all(file: BinaryIO, found: Contents, path: Path) -> None:
    """Take channels, times and counts from the chunks' own content, as there is no summary to ask."""
    counts: dict[int, int] = defaultdict(int)
    for index, chunk in enumerate(found.chunks):
        inside = chunk_records(file, chunk, path)
        for opcode, content in inside.others:
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                place = f"{path}, chunk at byte {chunk.place.offset}"
                _keep(parse(opcode, content, place), found, place)
        stamps = inside.messages.stamp_ns
        held, numbers = np.unique(inside.messages.channel, return_counts=True)
        for channel, number in zip(held.tolist(), numbers.tolist(), strict=True):
            counts[channel] += number
        times = (int(stamps.min()), int(stamps.max())) if len(stamps) else (0, 0)
        found.chunks[index] = ChunkPlace(chunk.place, *times, channels=frozenset(held.tolist()))
    for loose in found.loose:
        counts[loose_message(file, loose, path).channel_id] += 1
    found.counts = dict(counts)


def chunk_records(file: BinaryIO, chunk: ChunkPlace, path: Path) -> Records:
    """Return a chunk's records, its checksum verified. Raises DamagedRecording naming the chunk."""
    place = f"{path}, chunk at byte {chunk.place.offset} (t = {chunk.start_ns / 1e9:.3f} to {chunk.end_ns / 1e9:.3f} s)"
    content = _bytes(file, chunk.place, chunk.place.length, path)
    found = records(unpack(content, place, os.fstat(file.fileno()).st_size + MOST_UNPACKED), place)
    stamps = found.messages.stamp_ns
    if len(stamps) and not chunk.start_ns <= int(stamps.min()) <= int(stamps.max()) <= chunk.end_ns:
        raise DamagedRecording(place, f"holds stamps {stamps.min()} to {stamps.max()} ns", "its head says otherwise")
    return found


def loose_message(file: BinaryIO, place: Place, path: Path) -> Message:
    """Return a message that stands outside any chunk."""
    return loose_from(_bytes(file, place, place.length, path), path)


def loose_from(content: bytes, path: Path) -> Message:
    """Return a message from its record's content; raises DamagedRecording when it is none."""
    record = parse(Opcode.MESSAGE, content, str(path))
    if not isinstance(record, Message) or record.log_time >= 1 << 63:
        raise DamagedRecording(path, "a message outside chunks cannot be read")
    return record


_READERS = {
    Opcode.HEADER: lambda stream, _: Header.read(stream),
    Opcode.SCHEMA: lambda stream, _: Schema.read(stream),
    Opcode.CHANNEL: lambda stream, _: Channel.read(stream),
    Opcode.METADATA: lambda stream, _: Metadata.read(stream),
    Opcode.METADATA_INDEX: lambda stream, _: MetadataIndex.read(stream),
    Opcode.CHUNK_INDEX: lambda stream, _: ChunkIndex.read(stream),
    Opcode.STATISTICS: lambda stream, _: Statistics.read(stream),
    Opcode.FOOTER: lambda stream, _: Footer.read(stream),
    Opcode.MESSAGE: Message.read,
}


def _record(file: BinaryIO, place: Place, path: Path) -> McapRecord:
    return parse(place.opcode, _bytes(file, place, place.length, path), f"{path}, byte {place.offset}")


def parse(opcode: int, content: bytes, place: str) -> McapRecord:
    """Return a record from its content; raises DamagedRecording naming `place`."""
    try:
        record: McapRecord = _READERS[Opcode(opcode)](ReadDataStream(BytesIO(content)), len(content))
    except (McapError, ValueError, OverflowError, MemoryError, struct.error, EOFError) as error:
        raise DamagedRecording(place, f"record cannot be read ({type(error).__name__})") from error
    return record


def _bytes(file: BinaryIO, place: Place, length: int, path: Path) -> bytes:
    with _ONE_AT_A_TIME:
        file.seek(place.offset)
        content = file.read(min(length, place.length))
    if len(content) < length:
        raise DamagedRecording(f"{path}, byte {place.offset}", f"record has {len(content)} bytes, not {length}")
    return content


def _reach(found: Contents) -> str:
    if not found.chunks:
        return "before its first complete chunk"
    return f"{len(found.chunks)} complete chunks are left, up to t = {found.chunks[-1].end_ns / 1e9:.3f} s"
