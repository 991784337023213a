"""Messages: protobuf with one `optional double` for each component, all of one length.

Zeros are written too, so every message of a topic has the same bytes but for its numbers, and
numpy reads and writes thousands at once.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from data.chunk import Messages
from data.errors import DamagedRecording
from data.signal import Array


@cache
def _tag(number: int) -> bytes:
    """Return a field's tag, the varint of (number << 3 | wire type 1): one byte up to field 15."""
    key = number << 3 | 1
    return bytes([key]) if key < 128 else bytes([key & 127 | 128, key >> 7])


@cache
def layout(size: int) -> np.dtype[np.void]:
    """Return the numpy layout of a message of `size` doubles: fields tag1, value1, tag2 ..."""
    fields: list[tuple[str, str, int | tuple[int, ...]]] = []
    for number in range(1, size + 1):
        fields += [(f"tag{number}", "u1", (len(_tag(number)),)), (f"value{number}", "<f8", ())]
    return np.dtype(fields)


def encode(values: Array) -> NDArray[np.void]:
    """Return (n,) messages from values (n, k); `.tobytes()` of each is what goes into the file."""
    messages = np.zeros(len(values), layout(values.shape[1]))
    for number in range(1, values.shape[1] + 1):
        messages[f"tag{number}"] = np.frombuffer(_tag(number), np.uint8)
        messages[f"value{number}"] = values[:, number - 1]
    return messages


def decode(messages: Messages, size: int, place: str) -> Array:
    """Return (n, k) values from n messages of k = `size` doubles.

    Raises DamagedRecording when a message is not laid out as its topic says.
    """
    from data.compiled import gather

    length = layout(size).itemsize
    wrong = np.flatnonzero(messages.length != length)
    if wrong.size:
        found = f"message {wrong[0]} has {messages.length[wrong[0]]} bytes"
        raise DamagedRecording(place, found, f"expected {length} ({size} optional doubles)")
    tags = [_tag(number) for number in range(1, size + 1)]
    values = np.empty((len(messages), size), "<f8")
    widths = np.array([len(tag) for tag in tags], np.int64)
    tagged = np.frombuffer(b"".join(tags), np.uint8)
    bad = gather(messages.buffer, messages.offset, tagged, widths, values.reshape(-1).view(np.uint8))
    if bad >= 0:
        raise DamagedRecording(place, f"message {bad} is not made of optional doubles")
    return values


@dataclass(frozen=True)
class Doubles:
    """The decoder of messages that are optional doubles and nothing else."""

    components: tuple[str, ...]

    def decode(self, messages: Messages, place: str) -> Array:
        """Return (n, k) values. Raises DamagedRecording."""
        return decode(messages, len(self.components), place)


@cache
def schema(name: str, components: tuple[str, ...]) -> bytes:
    """Return the protobuf FileDescriptorSet of a message, as an MCAP schema record holds it."""
    from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet

    package, _, message_name = name.rpartition(".")
    file = FileDescriptorProto(name=f"{package}/{message_name}.proto", package=package, syntax="proto3")
    message = file.message_type.add(name=message_name)
    for index, component in enumerate(components):
        message.oneof_decl.add(name=f"_{component}")  # what `optional` is, in a proto3 descriptor
        message.field.add(
            name=component,
            number=index + 1,
            type=FieldDescriptorProto.TYPE_DOUBLE,
            label=FieldDescriptorProto.LABEL_OPTIONAL,
            proto3_optional=True,
            oneof_index=index,
        )
    return FileDescriptorSet(file=[file]).SerializeToString(deterministic=True)


def components_of(schema_data: bytes, name: str) -> tuple[str, ...] | None:
    """Return the component names of a schema of optional doubles numbered from 1, else None."""
    from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorSet
    from google.protobuf.message import DecodeError

    try:
        files = FileDescriptorSet.FromString(schema_data).file
    except DecodeError:
        return None
    for file in files:
        for message in file.message_type:
            if f"{file.package}.{message.name}".lstrip(".") == name:
                double = FieldDescriptorProto.TYPE_DOUBLE
                doubles = all(field.type == double and field.proto3_optional for field in message.field)
                in_order = [field.number for field in message.field] == list(range(1, len(message.field) + 1))
                return tuple(field.name for field in message.field) if doubles and in_order else None
    return None


@cache
def camera_schema() -> bytes:
    """Return the FileDescriptorSet of foxglove.CompressedImage with the files it imports."""
    from foxglove_schemas_protobuf.CompressedImage_pb2 import DESCRIPTOR
    from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet

    found = FileDescriptorSet()

    def add(descriptor: object) -> None:
        for dependency in descriptor.dependencies:  # type: ignore[attr-defined]
            add(dependency)
        if descriptor.name not in {file.name for file in found.file}:  # type: ignore[attr-defined]
            descriptor.CopyToProto(file := FileDescriptorProto())  # type: ignore[attr-defined]
            found.file.append(file)

    add(DESCRIPTOR)
    return found.SerializeToString(deterministic=True)


def encode_picture(stamp_ns: int, frame: str, data: bytes, picture_format: str) -> bytes:
    """Return a foxglove.CompressedImage holding an encoded picture ("jpeg", "png", "webp")."""
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

    picture = CompressedImage(frame_id=frame, data=data, format=picture_format)
    picture.timestamp.seconds, picture.timestamp.nanos = divmod(stamp_ns, 1_000_000_000)
    return picture.SerializeToString(deterministic=True)


def decode_picture(message: memoryview, place: str) -> tuple[bytes, str]:
    """Return (encoded picture, format) of a foxglove.CompressedImage; raises DamagedRecording.

    Its fields are stepped over where they stand: protobuf's own parser would copy the picture twice more.
    """
    data, kind = b"", b""
    try:
        for number, content in _fields(message):
            match number:
                case 2:
                    data = bytes(content)
                case 3:
                    kind = bytes(content)
        return data, kind.decode()
    except (IndexError, ValueError) as error:
        raise DamagedRecording(place, "is not a foxglove.CompressedImage") from error


def _fields(message: memoryview) -> Iterator[tuple[int, memoryview]]:
    """Yield a message's fields that have a length (wire type 2); raises IndexError or ValueError at what is none."""
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        match key & 7:
            case 0:
                _, at = _varint(message, at)
            case 1 | 5 as fixed:
                at += 8 if fixed == 1 else 4
            case 2:
                size, at = _varint(message, at)
                if at + size <= len(message):
                    yield key >> 3, message[at : at + size]
                at += size
            case other:
                raise ValueError(f"wire type {other}")
    if at > len(message):
        raise ValueError("a field ends after its message")


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    """Return a number of seven bits a byte, least first, and where it ends."""
    number = shift = 0
    while (byte := message[at]) & 128:
        number |= (byte & 127) << shift
        at, shift = at + 1, shift + 7
        if shift > 63:
            raise ValueError("a number of more than 64 bits")
    return number | byte << shift, at + 1
