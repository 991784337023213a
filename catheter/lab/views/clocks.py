"""Columns of numbers on clocks: signals that share their time stamps share one entity.

A .rrd keeps the stamps and a row number with every entity, so a clock that is stored once
instead of once for each signal halves the file.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import rerun as rr

from catheter.lab.views.output import Output
from data.signal import Array

TIMELINE = "t"
PIECE = 1 << 17


@dataclass(frozen=True)
class Column:
    """Where a column stands in the file: entity path and component ('Signal:/force')."""

    entity: str
    component: str


@dataclass
class Clock:
    """Time stamps (n,) in seconds, and the columns (n,) that were sampled at them."""

    time_s: Array
    columns: dict[str, Array] = field(default_factory=dict)


class Clocks:
    """Collects columns by clock, then sends each clock as one entity."""

    def __init__(self) -> None:
        self._clocks: list[Clock] = []

    def __len__(self) -> int:
        return len(self._clocks)

    def add(self, group: str, name: str, time_s: Array, values: Array) -> Column:
        """Put a column, values (n,) at time_s (n,), on its clock; (group, name) must be new there."""
        component = f"{group}:{name}"
        index = self._find(time_s)
        self._clocks[index].columns[component] = values
        return Column(f"/clock/{index}", component)

    def send(self, output: Output, step: Callable[[], None]) -> None:
        """Write every clock, at most PIECE rows at a time, calling `step` after each clock."""
        for index, clock in enumerate(self._clocks):
            for first in range(0, len(clock.time_s), PIECE):
                rows = slice(first, first + PIECE)
                columns = rr.ComponentColumnList(
                    [
                        rr.ComponentColumn(_descriptor(component), rr.components.ScalarBatch(values[rows]))
                        for component, values in clock.columns.items()
                    ]
                )
                output.stream.send_columns(f"/clock/{index}", indexes=[stamps(clock.time_s[rows])], columns=columns)
                output.settle(8 * clock.time_s[rows].size * (1 + len(clock.columns)))
            step()

    def _find(self, time_s: Array) -> int:
        """Return the number of the clock with these stamps, a new one if there is none."""
        for index, clock in enumerate(self._clocks):
            if clock.time_s is time_s or np.array_equal(clock.time_s, time_s):
                return index
        self._clocks.append(Clock(time_s))
        return len(self._clocks) - 1


def stamps(time_s: Array) -> rr.TimeColumn:
    """Return times in seconds as the timeline's column; rounded, where rerun itself would truncate."""
    nanoseconds = np.rint(np.asarray(time_s, dtype=np.float64) * 1e9).astype("timedelta64[ns]")
    return rr.TimeColumn(TIMELINE, duration=nanoseconds)


def _descriptor(component: str) -> rr.ComponentDescriptor:
    archetype = component.partition(":")[0]
    kind = rr.components.ScalarBatch._COMPONENT_TYPE  # without it the viewer's table shows bare numbers
    return rr.ComponentDescriptor(component, archetype=archetype, component_type=kind)
