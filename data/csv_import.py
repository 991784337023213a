"""A laboratory's text log becomes a recording; every repair is written down, none is guessed."""

import itertools
import os
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput
from data.mapping import SEPARATORS, Clock, Column, Mapping
from data.recorder import Recorder
from data.signal import Array, Signal
from data.units import UNDOCUMENTED, factor_to_si

BLOCK_ROWS = 1 << 16
GAP_FACTOR = 5.0

Progress = Callable[[float], None]
Mask = NDArray[np.bool_]


@dataclass
class _Log:
    """What is known while a log is read, block by block."""

    path: Path
    mapping: Mapping
    row: int = 0  # data rows read
    last_s: float = -np.inf
    origin_s: float | None = None
    backwards: int = 0
    dropped: int = 0
    gaps: int = 0
    widest_s: float = 0.0
    median_s: float = 0.0
    heads: dict[str, int] = field(default_factory=dict)
    begun: set[str] = field(default_factory=set)


def import_log(
    log: Path, mapping: Mapping, out: Path, *, replace: bool = False, progress: Progress | None = None
) -> list[str]:
    """Read a text log through its mapping and write a recording; return what was repaired.

    Memory holds 65,536 rows whatever the log's length. progress is called with the share read.
    Raises BadInput naming file, line and column for ragged rows, text where a number should be,
    NaN, a clock that does not increase; CannotWrite for the output.
    """
    state = _Log(log, mapping)
    origin = {"kind": "measured", **{k: v for k, v in vars(mapping.source).items() if v}, "file": log.name}
    with _open(log) as file:
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
                recorder.write_signals(_signals(block, state))
                if progress:
                    progress(file.buffer.tell() / size)
            repairs = _repairs(state)
            listed = {f"repair.{i}": text for i, text in enumerate(repairs, start=1)}
            recorder.note("import", {"mapping": mapping.text, **listed})
    return repairs


def _open(path: Path) -> TextIO:
    try:
        return path.open(encoding="utf-8-sig", newline=None)
    except OSError as error:
        raise BadInput(path, f"cannot be read: {error.strerror}", "name a text log") from error


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
        yield from iter(file.readline, "")
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
            raise BadInput(_line(state, number), found, f"expected {width}: {', '.join(state.mapping.format.columns)}")
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
            try:
                float(cells[index])
            except ValueError:
                name = state.mapping.format.columns[index]
                return BadInput(f"{_line(state, number)}, column {name!r}", f"{cells[index]!r:.60} is not a number")
    return BadInput(state.path, "cannot be read as numbers")


def _line(state: _Log, number: int) -> str:
    return f"{state.path}, line {state.row + number + 1 + state.mapping.format.header}"


def _signals(block: dict[str, Array], state: _Log) -> dict[str, Signal]:
    """Return the block as signals in SI on the repaired clock."""
    time_s, kept = _clock(block[state.mapping.clock.column], state)
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
        raise BadInput(_line(state, at) + f", topic {topic.topic}", "value is NaN or infinite", advice)
    return start


def _clock(stamps: Array, state: _Log) -> tuple[Array, Mask]:
    """Return (seconds from the first kept row, which rows are kept)."""
    clock = state.mapping.clock
    seconds = stamps * factor_to_si(clock.unit)
    bad = np.flatnonzero(~np.isfinite(seconds))
    if bad.size:
        raise BadInput(_line(state, int(bad[0])), f"time is {stamps[bad[0]]}", "every row needs a time stamp")
    kept = np.arange(state.row, state.row + len(stamps)) >= clock.drop_first
    if clock.period is not None:
        return _index_clock(seconds, kept, clock.period, state)
    steps: Array = np.diff(seconds[kept], prepend=state.last_s)
    if clock.duplicates == "drop":
        state.dropped += int(np.sum(steps == 0))
        kept[np.flatnonzero(kept)[steps == 0]] = False
        steps = np.diff(seconds[kept], prepend=state.last_s)
    if (steps <= 0).any():
        raise _backwards(seconds, np.flatnonzero(kept), int(np.argmax(steps <= 0)), steps, state)
    time_s = seconds[kept]
    if len(time_s):
        _watch_gaps(steps[np.isfinite(steps)], state)
        state.last_s = float(time_s[-1])
        state.origin_s = float(time_s[0]) if state.origin_s is None else state.origin_s
    return time_s - (state.origin_s or 0.0), kept


def _index_clock(seconds: Array, kept: Mask, period: float, state: _Log) -> tuple[Array, Mask]:
    """Return row number x period, after checking it against every printed stamp."""
    rows = np.arange(state.row, state.row + len(seconds))
    state.origin_s = float(seconds[0]) if state.origin_s is None else state.origin_s
    regular = state.origin_s + rows * period
    digits = state.mapping.clock.digits
    magnitude = np.floor(np.log10(np.maximum(np.abs(seconds), 1e-300)))
    resolution = np.maximum(10.0 ** (magnitude + 1 - digits), 10.0 ** (-300))
    off = np.abs(seconds - regular) > 0.51 * resolution  # half a unit of the last digit, and rounding
    if off.any():
        at = int(np.argmax(off))
        raise BadInput(
            _line(state, at),
            f"stamp {seconds[at]:.9g} s is {abs(seconds[at] - regular[at]):.3g} s off row x {period:.9g} s",
            f"a regular clock must agree to the last of {digits} digits; correct [clock] period",
        )
    state.backwards += int(np.sum(np.diff(seconds, prepend=state.last_s) <= 0))
    state.last_s = float(seconds[-1])
    drop = state.mapping.clock.drop_first
    return np.asarray((rows[kept] - drop) * period, dtype=np.float64), kept


def _backwards(seconds: Array, rows: NDArray[np.int64], at: int, steps: Array, state: _Log) -> BadInput:
    bad = int(np.sum(steps <= 0))
    return BadInput(
        _line(state, int(rows[at])),
        f"time {seconds[rows[at]]:.9g} s does not come after the row before ({bad} such rows in this block)",
        "if the clock is regular give [clock] period, if rows repeat give duplicates = 'drop'",
    )


def _watch_gaps(steps: Array, state: _Log) -> None:
    if not state.median_s and steps.size:
        state.median_s = float(np.median(steps))
    wide = steps > GAP_FACTOR * state.median_s
    state.gaps += int(wide.sum())
    state.widest_s = max(state.widest_s, float(steps.max(initial=0.0)))


def _repairs(state: _Log) -> list[str]:
    """Return in words everything that was done to the log, and what was found and left."""
    clock: Clock = state.mapping.clock
    found = []
    if clock.drop_first:
        found.append(f"the first {clock.drop_first} row(s) dropped: no sound time stamp")
    if clock.period is not None:
        found.append(
            f"{state.backwards} of {state.row} printed stamps do not increase; the clock is row x {clock.period:.9g} "
            f"s, which agrees with every stamp to its last of {clock.digits} digits"
        )
    if state.dropped:
        found.append(f"{state.dropped} rows with a repeated stamp dropped")
    for topic, count in state.heads.items():
        if count:
            found.append(f"{topic} begins after {count} leading rows of NaN")
    if state.gaps:
        found.append(
            f"{state.gaps} gaps wider than 5 sampling intervals left as they are, the widest {state.widest_s:.3g} s"
        )
    undocumented = [topic.topic for topic in state.mapping.topics if topic.unit == UNDOCUMENTED]
    if undocumented:
        found.append(f"unit undocumented, recorded as 1: {', '.join(undocumented)}")
    return found


def _scene_text(mapping: Mapping) -> str:
    """Return the scene that a replay of the recording will read: the mapping's questions."""
    ask = mapping.ask
    others = ", ".join(f'"{name}"' for name in ask.others)
    title = mapping.source.title.replace("\\", "/").replace('"', "'")
    return (
        f'[scene]\nkind = "recording"\ntitle = "{title}"\n\n'
        f'[ask]\nresponse = "{ask.response}"\ninput = "{ask.input}"\nothers = [{others}]\nsplit = "{ask.split}"\n'
    )
