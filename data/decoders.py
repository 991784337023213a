"""Which decoder a topic's messages need: ours, protobuf doubles; others', JSON and ROS 2 CDR."""

import base64
import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from data import message
from data.chunk import Messages
from data.errors import BadInput, DamagedRecording
from data.signal import Array
from data.topics import CAMERA_SCHEMA, Topic, from_metadata

ROS_CAMERA = ("sensor_msgs/msg/CompressedImage", "sensor_msgs/CompressedImage")


class Decoder(Protocol):
    """Turns a topic's messages into columns of numbers."""

    @property
    def components(self) -> tuple[str, ...]:
        """The columns' names."""

    def decode(self, messages: Messages, place: str) -> Array:
        """Return (n, k) values; raises DamagedRecording naming `place`."""


Pictures = Callable[[memoryview, str], tuple[bytes, str]]


@dataclass(frozen=True)
class Reader:
    """What a topic is, and how to read it; `unreadable` says why it cannot be."""

    topic: Topic
    numbers: Decoder | None = None
    pictures: Pictures | None = None
    unreadable: str = ""


def reader(channel: Any, schema: Any, first: Callable[[], bytes | None]) -> Reader:
    """Return the reader of an MCAP channel. first: its first message, read only where that is needed."""
    nothing = Topic(name="/unnamed", components=(), units=())
    try:
        nothing = Topic(name=channel.topic, components=(), units=())
        name = schema.name if schema else ""
        pictures = _pictures(channel.message_encoding, name)
        if pictures:
            return Reader(from_metadata(channel.topic, (), dict(channel.metadata)), pictures=pictures)
        numbers = _numbers(channel.message_encoding, name, schema, first)
        return Reader(from_metadata(channel.topic, numbers.components, dict(channel.metadata)), numbers)
    except BadInput as error:
        return Reader(nothing, unreadable=str(error))


def _numbers(encoding: str, name: str, schema: Any, first: Callable[[], bytes | None]) -> Decoder:
    match encoding:
        case "protobuf" if schema is not None:
            components = message.components_of(schema.data, name)
            if not components:
                raise BadInput(f"schema {name!r:.60}", "is not made of optional doubles")
            return message.Doubles(components)
        case "json":
            from data.json_messages import json_decoder

            return json_decoder(name or "JSON", first() or b"")
        case "cdr" if schema is not None and schema.encoding == "ros2msg":
            from data.cdr import cdr

            return cdr(name, schema.data.decode("utf-8", errors="replace"))
    raise BadInput(f"encoding {encoding!r:.60}", "is not read", "known are protobuf, json, and cdr with ros2msg")


def _pictures(encoding: str, name: str) -> Pictures | None:
    if name == CAMERA_SCHEMA:
        return {"protobuf": message.decode_picture, "json": _json_picture}.get(encoding)
    return _ros_picture if encoding == "cdr" and name in ROS_CAMERA else None


def _json_picture(content: memoryview, place: str) -> tuple[bytes, str]:
    try:
        read = json.loads(bytes(content))
        return base64.b64decode(read["data"], validate=True), str(read.get("format", ""))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise DamagedRecording(place, "is not a foxglove.CompressedImage in JSON") from error


def _ros_picture(content: memoryview, place: str) -> tuple[bytes, str]:
    """Step over header (stamp, frame_id) and read format and data of a sensor_msgs/CompressedImage."""
    order = "little" if len(content) > 1 and content[1] & 1 else "big"
    at, parts = 4 + 8, []
    for _ in range(3):
        at = 4 + -(-(at - 4) // 4) * 4
        size = int.from_bytes(content[at : at + 4], order)  # type: ignore[arg-type]
        if at + 4 + size > len(content):
            raise DamagedRecording(place, f"has {len(content)} bytes", "expected a sensor_msgs/CompressedImage")
        parts.append(bytes(content[at + 4 : at + 4 + size]))
        at += 4 + size
    return parts[2], parts[1].rstrip(b"\0").decode("utf-8", errors="replace").split(";")[0].strip()
