"""What drives the circuit: a source pressure in time, as pieces of cubics between exact breaks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from data.errors import BadInput
from data.options import check, option
from data.signal import Array, Signal

MOST_PIECES = 1_000_000
MOST_PRESSURE_PA = 1e9


@dataclass(frozen=True, eq=False)
class Drive:
    """A source pressure: breaks_s (m+1,) increasing; pieces (m, 4), u = a + b s + c s^2 + d s^3 [Pa] after a break."""

    breaks_s: Array
    pieces: Array

    def __post_init__(self) -> None:
        """Refuse what is no drive."""
        breaks, pieces = np.ascontiguousarray(self.breaks_s, float), np.ascontiguousarray(self.pieces, float)
        object.__setattr__(self, "breaks_s", breaks)
        object.__setattr__(self, "pieces", pieces)
        if breaks.ndim != 1 or pieces.shape != (len(breaks) - 1, 4) or not 1 <= len(pieces) <= MOST_PIECES:
            raise BadInput("drive", f"{breaks.shape} breaks, {pieces.shape} pieces", "expected (m+1,) and (m, 4)")
        if not np.isfinite(breaks).all() or not (np.diff(breaks) > 0).all():
            raise BadInput("drive", "its breaks do not increase", "give each time once, in order")
        if not np.isfinite(pieces).all():
            raise BadInput("drive", "a pressure is not finite", "repair the recording first")
        ends = self.at(np.concatenate([breaks[:-1], (breaks[:-1] + breaks[1:]) / 2]))
        if not np.abs(ends).max() <= MOST_PRESSURE_PA:
            raise BadInput("drive", f"{np.abs(ends).max():.3g} Pa", f"expected at most {MOST_PRESSURE_PA:g} Pa")

    def at(self, time_s: Array) -> Array:
        """Return u [Pa] at times (m,); at a break the pressure after it."""
        index = np.clip(np.searchsorted(self.breaks_s, time_s, side="right") - 1, 0, len(self.pieces) - 1)
        s, (a, b, c, d) = time_s - self.breaks_s[index], self.pieces[index].T
        return np.asarray(a + s * (b + s * (c + s * d)))


@dataclass(frozen=True, kw_only=True)
class SquareWave:
    """`high` for the first `duty` of every `period`, `low` for the rest; the thesis's: 83 kPa, 0.5 Hz."""

    high: float = option(83e3, unit="Pa", least=-1e9, most=1e9)
    low: float = option(0.0, unit="Pa", least=-1e9, most=1e9)
    period: float = option(2.0, unit="s", least=1e-6, most=1e6)
    duty: float = option(0.5, least=1e-3, most=0.999)

    def __post_init__(self) -> None:
        """Check the ranges."""
        check(self, "square wave")

    def drive(self, cycles: int = 1) -> Drive:
        """Return that many cycles, from time 0."""
        starts = np.arange(cycles) * self.period
        breaks = np.append(np.stack([starts, starts + self.duty * self.period], axis=1), cycles * self.period)
        pieces = np.zeros((2 * cycles, 4))
        pieces[0::2, 0], pieces[1::2, 0] = self.high, self.low
        return Drive(breaks, pieces)


def recorded(signal: Signal) -> Drive:
    """Return a recorded pressure, straight between its samples. Raises BadInput for another unit, NaN or vectors."""
    if signal.unit != "Pa" or signal.value.ndim != 1:
        raise BadInput(signal.name, f"is in {signal.unit}, shape {signal.value.shape}", "expected (n,) pressures in Pa")
    if len(signal) < 2 or not np.isfinite(signal.value).all():
        raise BadInput(signal.name, "has missing samples, or fewer than 2", "choose a window without gaps")
    pieces = np.zeros((len(signal) - 1, 4))
    pieces[:, 0] = signal.value[:-1]
    pieces[:, 1] = np.diff(signal.value) / np.diff(signal.time_s)
    return Drive(signal.time_s, pieces)


def sampled(
    pressure_pa: Callable[[float], float], end_s: float, *, breaks_s: Sequence[float] = (), tolerance_pa: float = 1e-3
) -> Drive:
    """Return a function of time as cubics that meet it within `tolerance_pa`, halved until they do.

    pressure_pa(t) for 0 <= t <= end_s. breaks_s: where it jumps or has a corner; a jump that is
    not named there is refused, and so is a function that is not finite. At a break the value
    just before and just after is asked for, a relative 1e-12 of end_s away.
    """
    edges = sorted({0.0, float(end_s), *(float(b) for b in breaks_s if 0 < b < end_s)})
    if not edges[-1] == end_s > 0:
        raise BadInput("drive", f"ends at {end_s:g} s", "expected a time after 0")
    breaks, pieces = [], []
    for left, right in pairwise(edges):
        inset, grid = 1e-12 * end_s, np.linspace(left, right, 33)
        grid[[0, -1]] += inset, -inset
        pending = list(pairwise(grid))[::-1]
        while pending:
            a, b = pending.pop()
            cubic, error = _cubic(pressure_pa, a, b)
            if error <= tolerance_pa:
                breaks.append(left if a == grid[0] else a)
                pieces.append(cubic)
                continue
            if b - a < 1e-9 * end_s or len(pieces) > MOST_PIECES:
                raise BadInput("drive", f"changes by {error:.3g} Pa near {a:.9g} s", "name its jumps in breaks_s")
            pending += [((a + b) / 2, b), (a, (a + b) / 2)]
    return Drive(np.array([*breaks, end_s]), np.array(pieces))


_NODES = np.array([0.0, 0.25, 0.75, 1.0])
_CHECKS = np.array([0.1, 0.5, 0.9])
_INVERSE = np.linalg.inv(np.vander(_NODES, 4, increasing=True))


def _cubic(pressure_pa: Callable[[float], float], a: float, b: float) -> tuple[Array, float]:
    """Return the cubic through four values of a piece, and how far it misses three others [Pa]."""
    values = np.array([float(pressure_pa(a + (b - a) * s)) for s in (*_NODES, *_CHECKS)])
    if not np.isfinite(values).all():
        raise BadInput("drive", f"is not finite between {a:.9g} s and {b:.9g} s", "expected pressures in Pa")
    shape = _INVERSE @ values[:4]
    error = np.abs(np.vander(_CHECKS, 4, increasing=True) @ shape - values[4:]).max()
    return shape / (b - a) ** np.arange(4), float(error)
