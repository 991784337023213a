"""ROS 2 messages (CDR): the numbers in them, read without ROS.

A message's layout follows from its definition and from the lengths of the strings and sequences in
it. Messages of one chunk that agree in those are read together; others in groups of their own.
"""

import re
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from data.chunk import Messages
from data.errors import BadInput, DamagedRecording
from data.signal import Array

Indices = NDArray[np.int64]

PRIMITIVES = {
    **{"bool": "?", "byte": "u1", "char": "u1", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2"},
    **{"int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8"},
}
_TIME = "int32 sec\nuint32 nanosec"
_BUILT_IN = {"builtin_interfaces/Time": _TIME, "builtin_interfaces/Duration": _TIME}
_FIELD = re.compile(r"([A-Za-z][\w/]*)(?:<=\d+)?(\[(?:<=)?(\d*)\])?\s+([a-zA-Z]\w*)(?:\s+[^=].*)?")
MOST_ARRAY = 64  # numbers of a fixed array that become components; longer ones are stepped over
MOST_FIELDS = 10_000
MOST_DEPTH = 20


@dataclass(frozen=True)
class _Step:
    """One thing in a message: `count` values of a primitive kind, a string, or a counted sequence."""

    kind: str  # a numpy kind, or "string"
    name: str = ""  # empty: stepped over
    count: int = 1
    counted: bool = False


@dataclass(frozen=True)
class Cdr:
    """The numbers of a ROS 2 message type, as components in the order of the definition."""

    steps: tuple[_Step, ...]
    components: tuple[str, ...] = field(default=())

    def decode(self, messages: Messages, place: str) -> Array:
        """Return (n, k) values; integers beyond 2^53 are rounded. Raises DamagedRecording."""
        values = np.empty((len(messages), len(self.components)))
        left = np.arange(len(messages))
        while left.size:
            lengths, leaves = self._lay_out(messages, int(left[0]), place)
            alike = _agree(messages, left, lengths)
            for column, (offset, kind) in enumerate(leaves):
                at = messages.offset[alike][:, None] + offset + np.arange(np.dtype(kind).itemsize)
                values[alike, column] = np.ascontiguousarray(messages.buffer[at]).view(kind)[:, 0]
            left = np.setdiff1d(left, alike, assume_unique=True)
        return values

    def _lay_out(
        self, messages: Messages, index: int, place: str
    ) -> tuple[list[tuple[int, bytes]], list[tuple[int, str]]]:
        """Return one message's length words (offset, bytes) and where its numbers stand (offset, kind)."""
        content = messages.content(index)
        if len(content) < 4:
            raise DamagedRecording(place, f"message {index} has {len(content)} bytes", "CDR begins with 4 of its own")
        order = "<" if content[1] & 1 else ">"
        words, leaves, at = [(0, content[:4])], [], 4
        for step in self.steps:
            count = step.count
            if step.counted or step.kind == "string":
                at = 4 + -(-(at - 4) // 4) * 4
                words.append((at, content[at : at + 4]))
                count, at = int(np.frombuffer(_four(content, at, place), f"{order}u4")[0]), at + 4
            if step.kind == "string":
                at += count
                continue
            size = np.dtype(step.kind).itemsize
            at = 4 + -(-(at - 4) // size) * size if count else at
            if step.name:
                leaves += [(at + i * size, order + step.kind) for i in range(count)]
            at += count * size
        if at > len(content):
            raise DamagedRecording(place, f"message {index} has {len(content)} bytes", f"its definition needs {at}")
        return words, leaves


def _four(content: bytes, at: int, place: str) -> bytes:
    if at + 4 > len(content):
        raise DamagedRecording(place, f"a message of {len(content)} bytes ends inside its definition")
    return content[at : at + 4]


def _agree(messages: Messages, left: Indices, words: list[tuple[int, bytes]]) -> Indices:
    """Return which of the messages have the first one's length and length words."""
    alike = left[messages.length[left] == messages.length[left[0]]]
    for offset, word in words:
        at = messages.offset[alike][:, None] + offset + np.arange(4)
        alike = alike[(messages.buffer[at] == np.frombuffer(word, np.uint8)).all(axis=1)]
    return np.asarray(alike)


def cdr(name: str, definition: str) -> Cdr:
    """Return the decoder of a ROS 2 type from its definition (encoding "ros2msg").

    Numbers after something that cannot be stepped over (a sequence of messages, a wide string) are
    left out. Raises BadInput when nothing is left.
    """
    parts = re.split(r"^=+\s*$", definition, flags=re.MULTILINE)
    known = dict(_BUILT_IN)
    for part in parts[1:]:
        head, _, body = part.strip().partition("\n")
        known[head.removeprefix("MSG:").strip().replace("/msg/", "/")] = body
    layout = _Layout(known)
    layout.append(parts[0], "", name.split("/", maxsplit=1)[0])
    components = tuple(
        step.name if step.count == 1 else f"{step.name}_{i}"
        for step in layout.steps
        if step.name
        for i in range(step.count)
    )
    if not components:
        raise BadInput(f"type {name}", "holds no numbers at fixed places")
    return Cdr(tuple(layout.steps), components)


@dataclass
class _Layout:
    """A definition, flattened into steps."""

    known: dict[str, str]
    steps: list[_Step] = field(default_factory=list)

    def append(self, body: str, prefix: str, package: str, depth: int = 0) -> bool:
        """Append a definition; return False at the first thing that cannot be stepped over."""
        for line in body.splitlines():
            text = line.partition("#")[0].strip()
            match = _FIELD.fullmatch(text)
            if not text or (match is None and "=" in text):  # empty, or a constant
                continue
            if match is None or depth > MOST_DEPTH or len(self.steps) > MOST_FIELDS:
                return False
            kind, array, size, name = match.groups()
            counted = array is not None and (not size or array.startswith("[<="))
            count = int(size) if size and not counted else 1
            if kind in PRIMITIVES:
                named = "" if counted or count > MOST_ARRAY else prefix + name
                self.steps.append(_Step(PRIMITIVES[kind], named, count, counted))
            elif kind == "string" and not counted and count <= MOST_FIELDS:
                self.steps += [_Step("string")] * count
            elif counted or not self._append_type(kind, count, prefix + name, package, depth):
                return False
        return True

    def _append_type(self, kind: str, count: int, name: str, package: str, depth: int) -> bool:
        candidates = (kind, f"{package}/{kind}", f"std_msgs/{kind}")
        body = next((self.known[one] for one in candidates if one in self.known), None)
        if body is None or count > MOST_FIELDS:
            return False
        owner = kind.split("/", maxsplit=1)[0] if "/" in kind else package
        names = [f"{name}_{i}_" for i in range(count)] if count > 1 else [f"{name}_"]
        for one in names:
            before = len(self.steps)
            if not self.append(body, one, owner, depth + 1):
                return False
            if len(self.steps) == before:
                self.steps.append(_Step("u1"))  # ROS gives a type without fields one byte
        return True
