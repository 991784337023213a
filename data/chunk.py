"""The inside of a chunk: unpacked, checked, and its messages found, thousands at once.

A chunk is a run of records of 9 bytes of head and a content; a message record holds its channel,
its stamp and its bytes. The walk over them is compiled; numpy sees arrays of where messages stand.
"""

import struct
import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.errors import DamagedRecording

MOST_OTHERS = 1 << 16  # schemas and channels in one chunk
HEAD = struct.Struct("<QQQII")  # start, end, unpacked size, checksum, length of the compression's name
_RECORD_HEAD, _MESSAGE_HEAD = 9, 22

Bytes = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Messages:
    """Where a chunk's messages stand: (n,) channels, stamps in ns, and offset and length in `buffer`."""

    buffer: Bytes
    channel: NDArray[np.uint16]
    stamp_ns: NDArray[np.int64]
    offset: NDArray[np.int64]
    length: NDArray[np.int64]

    @classmethod
    def of_one(cls, channel: int, stamp_ns: int, content: bytes) -> "Messages":
        """Return one message that stood outside any chunk."""
        one = np.array([len(content)], np.int64)
        stamp, number = np.array([stamp_ns], np.int64), np.array([channel], np.uint16)
        return cls(np.frombuffer(content, np.uint8), number, stamp, 0 * one, one)

    def __len__(self) -> int:
        return len(self.offset)

    def only(self, kept: NDArray[np.bool_]) -> "Messages":
        """Return the messages of a mask."""
        return Messages(self.buffer, self.channel[kept], self.stamp_ns[kept], self.offset[kept], self.length[kept])

    def view(self, index: int) -> memoryview:
        """Return one message where it stands."""
        first = int(self.offset[index])
        return self.buffer.data[first : first + int(self.length[index])]

    def content(self, index: int) -> bytes:
        """Return a copy of one message's bytes."""
        return bytes(self.view(index))


def unpack(content: bytes, place: str, most: int) -> bytes:
    """Return the records of a chunk record's content, its checksum verified.

    most: the largest unpacked size believed. Raises DamagedRecording naming `place`.
    """
    if len(content) < HEAD.size:
        raise DamagedRecording(place, f"has {len(content)} bytes", f"a chunk has at least {HEAD.size}")
    _, _, size, checksum, name_length = HEAD.unpack_from(content)
    packed_at = HEAD.size + name_length + 8
    if packed_at > len(content) or size > most:
        raise DamagedRecording(place, f"claims to unpack to {size} bytes", f"at most {most} are believed")
    name = content[HEAD.size : HEAD.size + name_length]
    packed = memoryview(content)[packed_at:]
    if int.from_bytes(content[packed_at - 8 : packed_at], "little") != len(packed):
        raise DamagedRecording(place, f"holds {len(packed)} packed bytes, its head says otherwise")
    unpacked = _unpack(name, packed, size, place)
    found = zlib.crc32(unpacked)
    if checksum and found != checksum:
        raise DamagedRecording(place, f"checksum is {found:08x}, should be {checksum:08x}", "bytes were changed")
    if len(unpacked) != size:
        raise DamagedRecording(place, f"unpacks to {len(unpacked)} bytes", f"its head says {size}")
    return unpacked


def _unpack(name: bytes, packed: memoryview, size: int, place: str) -> bytes:
    match name:
        case b"":
            return bytes(packed)
        case b"zstd":
            import zstandard

            try:  # the frame has a size of its own, which the decoder would believe
                if zstandard.frame_content_size(packed) not in (-1, size):
                    raise DamagedRecording(place, "its packed content has another size than its head says")
                return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
            except zstandard.ZstdError as error:
                raise DamagedRecording(place, f"cannot be unpacked ({error})", "bytes were changed") from error
        case b"lz4":
            import lz4.frame

            try:
                return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size + 1))
            except (RuntimeError, EOFError) as error:
                raise DamagedRecording(place, f"cannot be unpacked ({error})", "bytes were changed") from error
    raise DamagedRecording(place, f"is packed by {name!r:.30}", "zstd, lz4 and plain are read")


@dataclass(frozen=True, eq=False)
class Records:
    """A chunk's records: the messages, the others as (opcode, content), and how far they are whole."""

    messages: Messages
    others: list[tuple[int, bytes]]
    whole: int


def records(unpacked: bytes, place: str) -> Records:
    """Return the records of a chunk. Raises DamagedRecording where a record runs over its end."""
    found = records_as_far(unpacked, place)
    if found.whole < len(unpacked):
        raise DamagedRecording(place, f"record at byte {found.whole} of {len(unpacked)} runs over the chunk's end")
    return found


def records_as_far(unpacked: bytes, place: str) -> Records:
    """Return the records up to the first that is not whole."""
    from data.compiled import walk

    most = len(unpacked) // (_RECORD_HEAD + _MESSAGE_HEAD) + 1
    buffer = np.frombuffer(unpacked, np.uint8)
    channel, stamp = np.empty(most, np.uint16), np.empty(most, np.int64)
    offset, length = np.empty(most, np.int64), np.empty(most, np.int64)
    others = np.empty(MOST_OTHERS, np.int64)
    count, rest, whole = walk(buffer, channel, stamp, offset, length, others)
    if (stamp[:count] < 0).any():  # 2^63 ns and more do not fit: the year 2262
        raise DamagedRecording(place, "a message is stamped later than the year 2262")
    messages = Messages(buffer, channel[:count], stamp[:count], offset[:count], length[:count])
    return Records(messages, [_other(unpacked, int(at)) for at in others[:rest]], int(whole))


def _other(unpacked: bytes, at: int) -> tuple[int, bytes]:
    content = at + _RECORD_HEAD
    return unpacked[at], unpacked[content : content + int.from_bytes(unpacked[at + 1 : content], "little")]
