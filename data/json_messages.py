"""JSON messages: the numbers in them, by path."""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from data.chunk import Messages
from data.errors import BadInput, DamagedRecording
from data.signal import Array

MOST_DEPTH = 20


@dataclass(frozen=True)
class Json:
    """The numbers of JSON messages: components, and the path of keys to each."""

    components: tuple[str, ...]
    paths: tuple[tuple[str, ...], ...]

    def decode(self, messages: Messages, place: str) -> Array:
        """Return (n, k) values; what a message does not hold is NaN. Raises DamagedRecording."""
        try:
            return self._fast(messages)
        except (ValueError, KeyError, TypeError):  # not alike enough for columns: one by one
            return np.array([self._one(messages.content(i), f"{place}, message {i}") for i in range(len(messages))])

    def _fast(self, messages: Messages) -> Array:
        import pyarrow as pa
        from pyarrow import json as arrow

        lines = b"\n".join(messages.content(i).replace(b"\n", b" ") for i in range(len(messages)))
        options = arrow.ParseOptions(explicit_schema=pa.schema(_fields(self.paths)), unexpected_field_behavior="ignore")
        table = arrow.read_json(pa.BufferReader(lines), arrow.ReadOptions(block_size=len(lines) + 1), options)
        columns = []
        for path in self.paths:
            column: Any = table.column(path[0])
            for key in path[1:]:
                column = pa.compute.struct_field(column, key)
            columns.append(column.to_numpy())
        values = np.stack(columns, axis=1).astype(np.float64)
        if len(values) != len(messages):
            raise ValueError("an empty message")
        return values

    def _one(self, content: bytes, place: str) -> list[float]:
        try:
            read = json.loads(content)
        except (ValueError, RecursionError) as error:
            raise DamagedRecording(place, "is not JSON") from error
        return [_number(read, path) for path in self.paths]


def _number(read: Any, path: tuple[str, ...]) -> float:
    for key in path:
        read = read.get(key) if isinstance(read, dict) else None
    return float(read) if isinstance(read, int | float) else float("nan")


def _fields(paths: tuple[tuple[str, ...], ...]) -> list[Any]:
    import pyarrow as pa

    keys: dict[str, list[tuple[str, ...]]] = {}
    for path in paths:
        keys.setdefault(path[0], []).append(path[1:])
    return [
        pa.field(key, pa.float64() if rest == [()] else pa.struct(_fields(tuple(p for p in rest if p))))
        for key, rest in keys.items()
    ]


def json_decoder(name: str, first: bytes) -> Json:
    """Return the decoder for messages like the first one. Raises BadInput when it holds no numbers."""
    try:
        paths = tuple(_paths(json.loads(first), ()))
    except (ValueError, RecursionError) as error:
        raise BadInput(name, "its first message is not JSON") from error
    if not paths:
        raise BadInput(name, "its first message holds no numbers")
    components = tuple("_".join("".join(c if c.isalnum() else "_" for c in key) for key in path) for path in paths)
    return Json(components, paths)


def _paths(read: Any, before: tuple[str, ...]) -> list[tuple[str, ...]]:
    if isinstance(read, dict) and len(before) < MOST_DEPTH:
        return [path for key, value in read.items() for path in _paths(value, (*before, key))]
    return [before] if before and isinstance(read, int | float) else []
