"""JSON messages: the numbers in them, by path.

Messages of one topic look alike: the same keys in the same order, with other numbers and texts. One
message gives the pattern, and compiled code reads all that follow it. What is left over when
MOST_PATTERNS have been tried is read one by one.
"""

import itertools
import json
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from data.chunk import Messages
from data.decimals import Bytes, Integers, Words, number, powers
from data.errors import BadInput, DamagedRecording
from data.signal import Array

MOST_DEPTH = 20
MOST_PATTERNS = 8
_TOKEN = re.compile(rb'"(?P<text>(?:[^"\\]|\\.)*)"(?P<key>\s*:)?|(?P<number>-?\d[\d.eE+-]*)')
_TEXT, _UNASKED = -2, -1  # columns of gaps that hold a text, or a number nobody asks for

Path = tuple[str, ...]


class _Gap(float):
    """A number in a message read as a pattern: the place of its gap."""


@dataclass(frozen=True, eq=False)
class _Pattern:
    """What alike messages share: literals around gaps, each gap's column, and columns that are the same in all."""

    literals: Bytes
    ends: Integers
    columns: Integers
    constants: Array


@dataclass(frozen=True)
class Json:
    """The numbers of JSON messages: components, and the path of keys to each."""

    components: tuple[str, ...]
    paths: tuple[Path, ...]

    def decode(self, messages: Messages, place: str) -> Array:
        """Return (n, k) values, each the nearest double; what a message does not hold is NaN.

        Raises DamagedRecording.
        """
        values = np.empty((len(messages), len(self.paths)))
        left = np.arange(len(messages))
        for _ in range(MOST_PATTERNS):
            if left.size:
                values[left[0]] = self._one(messages, int(left[0]), place)
                left = self._alike(messages, left, values)
        for i in left.tolist():
            values[i] = self._one(messages, i, place)
        return values

    def _alike(self, messages: Messages, left: Integers, values: Array) -> Integers:
        """Fill in the messages that are like the first of those left; return the others."""
        pattern, rest = self._pattern(messages.content(int(left[0]))), left[1:]
        values[rest] = pattern.constants
        unlike = np.ones(len(rest), np.bool_)
        _fill(
            *(messages.buffer, messages.offset, messages.length, rest),
            *(pattern.literals, pattern.ends, pattern.columns, powers()),
            *(values.view(np.uint64), unlike),
        )
        return rest[unlike]

    def _pattern(self, content: bytes) -> _Pattern:
        """Return the pattern of a message that is known to be JSON."""
        numbers = itertools.count()
        read = json.loads(content, parse_int=lambda _: _Gap(next(numbers)), parse_float=lambda _: _Gap(next(numbers)))
        found = [_at(read, path) for path in self.paths]
        column_of = {int(value): column for column, value in enumerate(found) if isinstance(value, _Gap)}
        literals, columns, at = [], [], 0
        numbers = itertools.count()
        for token in _TOKEN.finditer(content):
            if token["key"]:
                continue
            kind = "text" if token["text"] is not None else "number"
            literals.append(content[at : token.start(kind)])
            columns.append(_TEXT if kind == "text" else column_of.get(next(numbers), _UNASKED))
            at = token.end(kind)
        literals.append(content[at:])
        return _Pattern(
            np.frombuffer(b"".join(literals), np.uint8),
            np.cumsum([len(literal) for literal in literals]),
            np.array(columns, np.int64),
            np.array([_number(value) for value in found]),
        )

    def _one(self, messages: Messages, index: int, place: str) -> list[float]:
        try:
            read = json.loads(messages.content(index), parse_int=float)
        except (ValueError, RecursionError) as error:
            raise DamagedRecording(f"{place}, message {index}", "is not JSON") from error
        return [_number(_at(read, path)) for path in self.paths]


def _at(read: Any, path: Path) -> Any:
    for key in path:
        read = read.get(key) if isinstance(read, dict) else None
    return read


def _number(value: Any) -> float:
    return float(value) if isinstance(value, float | bool) else float("nan")


@njit(cache=True, nogil=True)
def _fill(  # noqa: PLR0917, compiled functions take arrays, not objects
    buffer: Bytes,
    offset: Integers,
    length: Integers,
    wanted: Integers,
    literals: Bytes,
    ends: Integers,
    columns: Integers,
    table: Words,
    values: Words,
    unlike: NDArray[np.bool_],
) -> None:
    """Read the wanted messages into `values` (their bits); unlike[i] stays True for what does not fit the pattern."""
    for i in range(len(wanted)):
        at, literal = offset[wanted[i]], 0
        end = at + length[wanted[i]]
        fits = True
        for gap in range(len(ends)):
            size = ends[gap] - literal
            fits = at + size <= end
            if fits:
                for k in range(size):
                    fits &= buffer[at + k] == literals[literal + k]
            literal, at = ends[gap], at + size
            if fits and gap < len(columns):
                at, bits = _text(buffer, at, end) if columns[gap] == _TEXT else number(buffer, at, end, table)
                fits = at >= 0
                if fits and columns[gap] >= 0:
                    values[wanted[i], columns[gap]] = bits
            if not fits:
                break
        unlike[i] = not fits or at != end


@njit(cache=True, nogil=True)
def _text(buffer: Bytes, at: int, end: int) -> tuple[int, np.uint64]:
    """Return where a text's closing quote stands (-1: none, or a character that Python should judge)."""
    while at < end and 32 <= buffer[at] < 127 and buffer[at] != 92:
        if buffer[at] == 34:
            return at, np.uint64(0)
        at += 1
    return -1, np.uint64(0)


def json_decoder(name: str, first: bytes) -> Json:
    """Return the decoder for messages like the first one. Raises BadInput when it holds no numbers."""
    try:
        paths = tuple(_paths(json.loads(first, parse_int=float), ()))
    except (ValueError, RecursionError) as error:
        raise BadInput(name, "its first message is not JSON") from error
    if not paths:
        raise BadInput(name, "its first message holds no numbers")
    components = tuple("_".join("".join(c if c.isalnum() else "_" for c in key) for key in path) for path in paths)
    return Json(components, paths)


def _paths(read: Any, before: Path) -> list[Path]:
    if isinstance(read, dict) and len(before) < MOST_DEPTH:
        return [path for key, value in read.items() for path in _paths(value, (*before, key))]
    return [before] if before and isinstance(read, float | bool) else []
