"""A laboratory's text log becomes a recording; every repair is written down, none is guessed."""

import itertools
import json
import os
import re
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import TextIOWrapper
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from data.clock import ClockRepair, Mask
from data.errors import BadInput
from data.files import check_inputs, open_regular
from data.mapping import SEPARATORS, Column, Mapping
from data.recorder import Recorder
from data.signal import Array, Signal
from data.units import UNDOCUMENTED, factor_to_si

BLOCK_ROWS = 1 << 16
MOST_LINE = 1 << 18
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?(nan|inf|infinity)", re.IGNORECASE | re.ASCII)

Progress = Callable[[float], None]


@dataclass
class _Log:
    """What is known while a log is read, block by block."""

    path: Path
    mapping: Mapping
    row: int = 0  # of the block that is being read
    heads: dict[str, int] = field(default_factory=dict)
    begun: set[str] = field(default_factory=set)

    def line(self, row: int) -> str:
        """Return how errors name a data row."""
        return f"{self.path}, line {row + 1 + self.mapping.format.header}"


def import_log(
    log: Path, mapping: Mapping, out: Path, *, replace: bool = False, progress: Progress | None = None
) -> list[str]:
    """Read a text log through its mapping and write a recording; return what was repaired.

    Memory holds 65,536 rows whatever the log's length. progress is called with the share read.
    Raises BadInput naming file, line and column for ragged rows, text where a number should be,
    NaN, a clock that does not increase; CannotWrite for the output.
    """
    state = _Log(log, mapping)
    clock = ClockRepair(mapping.clock, state.line)
    origin = {"kind": "measured", **{k: v for k, v in vars(mapping.source).items() if v}, "file": ascii(log.name)[1:-1]}
    check_inputs(out, log)
    with TextIOWrapper(open_regular(log), encoding="utf-8-sig") as file:
        size = max(1, os.fstat(file.fileno()).st_size)
        columns = _header(file, state)
        blocks = _blocks(file, columns, state)
        first = next(blocks, None)
        if first is None:
            raise BadInput(log, "has no rows", f"expected columns {', '.join(mapping.format.columns)}")
        scene = _scene_text(mapping)
        with Recorder(out, origin, scene=scene, flush_s=None, replace=replace) as recorder:
            for column in mapping.topics:
                recorder.add(column.described())
            for block in itertools.chain([first], blocks):
                recorder.write_signals(_signals(block, state, clock))
                if progress:
                    progress(file.buffer.tell() / size)
            _check_not_empty(state)
            repairs = _repairs(state, clock)
            listed = {f"repair.{i}": text for i, text in enumerate(repairs, start=1)}
            recorder.note("import", {"mapping": mapping.text, **listed})
    return repairs


def _check_not_empty(state: _Log) -> None:
    for topic in state.mapping.topics:
        if topic.topic not in state.begun:
            what = f"{topic.topic} has no sample: every row was dropped or is NaN"
            raise BadInput(state.path, what, "see [clock] drop_first and the topic's nan")


def _header(file: TextIO, state: _Log) -> tuple[str, ...]:
    """Return the column names; a header must be the one the mapping expects."""
    expected = state.mapping.format.columns
    if not state.mapping.format.header:
        return expected
    line = _lines(file, state)
    found = tuple(cell.strip() for cell in next(line, "").rstrip("\n").split(_separator(state)))
    if found != expected:
        wrong = next((i for i, pair in enumerate(zip(found, expected, strict=False)) if len(set(pair)) > 1), None)
        what = f"has {len(found)} columns" if wrong is None else f"column {wrong + 1} is {found[wrong]!r:.60}"
        wanted = f"{len(expected)} columns" if wrong is None else repr(expected[wrong])
        raise BadInput(f"{state.path}, line 1", what, f"the mapping expects {wanted}")
    return found


def _separator(state: _Log) -> str | None:
    return SEPARATORS[state.mapping.format.separator]


def _lines(file: TextIO, state: _Log) -> Iterator[str]:
    try:
        for number, line in enumerate(iter(lambda: file.readline(MOST_LINE), ""), start=1):
            if len(line) == MOST_LINE:
                raise BadInput(f"{state.path}, line {number}", f"is longer than {MOST_LINE} characters", "a text log?")
            yield line
    except UnicodeDecodeError as error:
        raise BadInput(state.path, f"is not UTF-8 text: {error.reason} near byte {error.start}") from error


def _blocks(file: TextIO, columns: tuple[str, ...], state: _Log) -> Iterator[dict[str, Array]]:
    """Yield the needed columns, up to BLOCK_ROWS rows at a time."""
    wanted = {state.mapping.clock.column, *(c for topic in state.mapping.topics for c in topic.columns)}
    indices = [i for i, name in enumerate(columns) if name in wanted]
    lines = _lines(file, state)
    while rows := list(itertools.islice(lines, BLOCK_ROWS)):
        table = _numbers(rows, indices, len(columns), state)
        yield {columns[index]: table[:, i] for i, index in enumerate(indices)}
        state.row += len(rows)


def _numbers(rows: list[str], indices: list[int], width: int, state: _Log) -> Array:
    separator = _separator(state)
    for number, row in enumerate(rows):
        cells = row.count(separator) + 1 if separator else len(row.split())
        if cells != width or row.isspace():
            found = "is empty" if row.isspace() else f"has {cells} cells"
            raise BadInput(
                state.line(state.row + number), found, f"expected {width}: {', '.join(state.mapping.format.columns)}"
            )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return np.loadtxt(rows, delimiter=separator, usecols=indices, ndmin=2, comments=None)
    except ValueError:
        raise _bad_cell(rows, indices, state) from None


def _bad_cell(rows: list[str], indices: list[int], state: _Log) -> BadInput:
    for number, row in enumerate(rows):
        cells = row.rstrip("\n").split(_separator(state))
        for index in indices:
            if not NUMBER.fullmatch(cells[index].strip()):
                name = state.mapping.format.columns[index]
                return BadInput(
                    f"{state.line(state.row + number)}, column {name!r}", f"{cells[index]!r:.60} is not a number"
                )
    return BadInput(state.path, "cannot be read as numbers")


def _signals(block: dict[str, Array], state: _Log, clock: ClockRepair) -> dict[str, Signal]:
    """Return the block as signals in SI on the repaired clock."""
    time_s, kept = clock.seconds(block[state.mapping.clock.column])
    found = {}
    for topic in state.mapping.topics:
        values = np.stack([block[name][kept] for name in topic.columns], axis=1)
        start = _head(values, topic, state, np.flatnonzero(kept))
        if start < len(values):
            factor = 1.0 if topic.unit == UNDOCUMENTED else factor_to_si(topic.unit)
            unit = topic.described().units[0]
            found[topic.topic] = Signal(time_s[start:], values[start:] * factor, unit, name=topic.topic)
    return found


def _head(values: Array, topic: Column, state: _Log, rows: NDArray[np.int64]) -> int:
    """Return where the topic's numbers begin; refuse NaN the mapping does not allow."""
    bad: Mask = np.asarray(~np.isfinite(values).all(axis=1))
    start = 0
    if topic.nan == "head" and topic.topic not in state.begun:
        start = len(bad) if bad.all() else int(np.argmin(bad))
        state.heads[topic.topic] = state.heads.get(topic.topic, 0) + start
    if start < len(bad):
        state.begun.add(topic.topic)
    remaining = bad[start:] & (np.isinf(values[start:]).any(axis=1) | (topic.nan != "keep"))
    if remaining.any():
        at = int(rows[start + int(np.argmax(remaining))])
        advice = "a leading NaN stretch may be dropped with nan = 'head', NaN recorded with nan = 'keep'"
        raise BadInput(state.line(state.row + at) + f", topic {topic.topic}", "value is NaN or infinite", advice)
    return start


def _repairs(state: _Log, clock: ClockRepair) -> list[str]:
    """Return in words everything that was done to the log, and what was found and left."""
    found = clock.report()
    found += [f"{topic} begins after {n} leading rows of NaN" for topic, n in state.heads.items() if n]
    undocumented = [topic.topic for topic in state.mapping.topics if topic.unit == UNDOCUMENTED]
    if undocumented:
        found.append(f"unit undocumented, recorded as 1: {', '.join(undocumented)}")
    return found


def _scene_text(mapping: Mapping) -> str:
    """Return the scene that a replay of the recording will read: the mapping's questions."""
    ask = mapping.ask
    return (
        f'[scene]\nkind = "recording"\ntitle = {_quoted(mapping.source.title)}\n\n'
        f"[ask]\nresponse = {_quoted(ask.response)}\ninput = {_quoted(ask.input)}\n"
        f"others = [{', '.join(map(_quoted, ask.others))}]\nsplit = {_quoted(ask.split)}\n"
    )


def _quoted(text: str) -> str:
    """Return a TOML string: JSON's escapes are TOML's, but for the one control character JSON leaves."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
