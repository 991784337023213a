"""A log's clock: checked row by row, repaired only as its mapping says, every repair counted."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput
from data.mapping import Clock
from data.signal import Array
from data.units import factor_to_si

GAP_FACTOR = 5.0
MOST_SECONDS = 1e9  # 32 years

Mask = NDArray[np.bool_]


@dataclass
class ClockRepair:
    """Turns a log's stamps into seconds, block by block.

    clock: the mapping's options. line: names a row in errors.
    """

    clock: Clock
    line: Callable[[int], str]
    rows: int = 0
    backwards: int = 0
    repeated: int = 0
    gaps: int = 0
    widest_s: float = 0.0
    largest_off_s: float = 0.0
    _last_s: float = field(default=-np.inf, repr=False)
    _origin_s: float | None = field(default=None, repr=False)
    _zero: float | None = field(default=None, repr=False)
    _usual_s: float = field(default=0.0, repr=False)

    def seconds(self, stamps: Array) -> tuple[Array, Mask]:
        """Return (seconds since the first kept row, which rows are kept) of the next rows, (n,).

        Raises BadInput naming the line of a stamp that is not finite, does not increase, or does
        not agree with the mapping's period.
        """
        first, self.rows = self.rows, self.rows + len(stamps)
        kept: Mask = np.arange(first, self.rows) >= self.clock.drop_first
        stamps = np.where(kept, stamps, stamps[np.argmax(kept)] if kept.any() else 0.0)  # a dropped stamp says nothing
        bad = np.flatnonzero(~(np.abs(stamps) <= 2.0**53))
        if bad.size:
            advice = "every row needs a time stamp, below 2^53 to be exact"
            raise BadInput(self.line(first + int(bad[0])), f"time is {stamps[bad[0]]}", advice)
        self._zero = float(stamps[0]) if self._zero is None and kept.any() else self._zero
        read_s = (stamps - (self._zero or 0.0)) * factor_to_si(self.clock.unit)  # before scaling: keeps every digit
        if (np.abs(read_s) > MOST_SECONDS).any():
            at = int(np.argmax(np.abs(read_s) > MOST_SECONDS))
            raise BadInput(self.line(first + at), f"time {stamps[at]:.9g} is {read_s[at]:.3g} s after the first row")
        if self.clock.period is not None:
            return self._regular(read_s, kept, first, self.clock.period)
        if self.clock.duplicates == "drop":
            repeats = np.flatnonzero(kept)[self._steps(read_s[kept]) == 0]
            kept[repeats] = False
            self.repeated += len(repeats)
        time_s = read_s[kept]
        steps = self._steps(time_s)
        if (steps <= 0).any():
            raise self._does_not_increase(time_s, steps, first + np.flatnonzero(kept))
        if len(time_s):
            self._watch_gaps(steps[np.isfinite(steps)])
            self._last_s = float(time_s[-1])
            self._origin_s = float(time_s[0]) if self._origin_s is None else self._origin_s
        return time_s - (self._origin_s or 0.0), kept

    def report(self) -> list[str]:
        """Return in words what was repaired, and what was found and left."""
        clock, found = self.clock, []
        if clock.drop_first:
            found.append(f"the first {clock.drop_first} row(s) dropped: no sound time stamp")
        if clock.period is not None:
            found.append(
                f"{self.backwards} of {self.rows} printed stamps do not increase; the clock is row x "
                f"{clock.period:.9g} s, which agrees with every stamp to its last of {clock.digits} digits (largest "
                f"difference {self.largest_off_s:.2g} s)"
            )
        if self.repeated:
            found.append(f"{self.repeated} rows with a repeated stamp dropped")
        if self.gaps:
            found.append(f"{self.gaps} gaps wider than 5 sampling intervals left, the widest {self.widest_s:.3g} s")
        return found

    def _steps(self, time_s: Array) -> Array:
        return np.asarray(np.diff(time_s, prepend=self._last_s))

    def _regular(self, read_s: Array, kept: Mask, first: int, period: float) -> tuple[Array, Mask]:
        """Return row number x period, after checking it against every printed stamp."""
        rows = np.arange(first, first + len(read_s))
        regular = (rows - self.clock.drop_first) * period
        digits = self.clock.digits or 17
        printed = np.abs(read_s + (self._zero or 0.0) * factor_to_si(self.clock.unit))
        last_digit = np.maximum(10.0 ** (np.floor(np.log10(np.maximum(printed, 1e-300))) + 1 - digits), 1e-9)
        if (kept & (last_digit > 2 * period)).any():
            at = int(np.argmax(kept & (last_digit > 2 * period)))
            found = f"stamps are printed to {last_digit[at]:.3g} s"
            raise BadInput(self.line(first + at), found, f"too coarse to confirm a period of {period:.3g} s")
        self.largest_off_s = max(self.largest_off_s, float(np.abs(np.where(kept, read_s - regular, 0.0)).max()))
        off = kept & (np.abs(read_s - regular) > 0.51 * last_digit)  # half of the last digit, and its rounding
        if off.any():
            at = int(np.argmax(off))
            raise BadInput(
                self.line(first + at),
                f"stamp {read_s[at]:.9g} s is {abs(read_s[at] - regular[at]):.3g} s off row x {period:.9g} s",
                f"a regular clock must agree to the last of {digits} digits; correct [clock] period",
            )
        self.backwards += int(np.sum(self._steps(read_s[kept]) <= 0))
        self._last_s = float(read_s[-1]) if kept.any() else self._last_s
        return np.asarray((rows[kept] - self.clock.drop_first) * period, dtype=np.float64), kept

    def _does_not_increase(self, time_s: Array, steps: Array, rows: NDArray[np.int64]) -> BadInput:
        at = int(np.argmax(steps <= 0))
        return BadInput(
            self.line(int(rows[at])),
            f"time {time_s[at]:.9g} s does not come after the row before ({int(np.sum(steps <= 0))} such rows)",
            "if the clock is regular give [clock] period, if rows repeat give duplicates = 'drop'",
        )

    def _watch_gaps(self, steps: Array) -> None:
        if not self._usual_s and steps.size:
            self._usual_s = float(np.median(steps))
        self.gaps += int(np.sum(steps > GAP_FACTOR * self._usual_s))
        self.widest_s = max(self.widest_s, float(steps.max(initial=0.0)))
