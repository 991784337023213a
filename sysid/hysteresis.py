"""Memory without time: play and stop operators, turning points, loops and their areas."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from data.errors import BadInput

Array = NDArray[np.float64]


@njit(cache=True)
def _play(x: Array, radii: Array, out: Array) -> None:
    for j in range(radii.shape[0]):
        radius = radii[j]
        state = x[0]
        for i in range(x.shape[0]):
            state = max(x[i] - radius, min(x[i] + radius, state))
            out[i, j] = state


def play(x: Array, radii: ArrayLike) -> Array:
    """Return the play (backlash) operators of x, (n, k) for k radii, started without tension.

    p_i = max(x_i - r, min(x_i + r, p_(i-1))), p_0 = x_0 (Prandtl-Ishlinskii). x and r share a
    unit. Raises BadInput for a radius that is not positive or an x that is not finite.
    """
    thresholds = np.atleast_1d(np.asarray(radii, dtype=np.float64))
    if not (thresholds > 0).all():
        raise BadInput("play operator", f"radius {thresholds.min()}", "radii must be positive")
    if not np.isfinite(x).all():
        raise BadInput("play operator", f"sample {int(np.flatnonzero(~np.isfinite(x))[0])} is not finite")
    out = np.empty((len(x), len(thresholds)))
    if len(x):
        _play(np.ascontiguousarray(x, dtype=np.float64), thresholds, out)
    return out


def stop(x: Array, radii: ArrayLike) -> Array:
    """Return the stop operators x - play(x), (n, k): springs that slip at +-r (Maxwell slip)."""
    return np.asarray(x[:, None] - play(x, radii))


@njit(cache=True)
def _turns(x: Array, swing: float, turns: NDArray[np.int64]) -> int:
    count = 1
    turns[0] = 0
    low = high = 0
    direction = 0
    for i in range(1, x.shape[0]):
        low = i if x[i] < x[low] else low
        high = i if x[i] > x[high] else high
        if direction >= 0 and x[high] - x[i] > swing:
            if direction > 0 or high > 0:
                turns[count] = high
                count += 1
            direction, low = -1, i
        elif direction <= 0 and x[i] - x[low] > swing:
            if direction < 0 or low > 0:
                turns[count] = low
                count += 1
            direction, high = 1, i
    return count


def turning_points(x: Array, swing: float) -> NDArray[np.int64]:
    """Return the samples where x turns by more than `swing`, (k,), with the first and last sample."""
    if len(x) < 2:
        return np.arange(len(x))
    turns = np.empty(len(x) + 1, np.int64)
    count = _turns(np.ascontiguousarray(x, dtype=np.float64), float(swing), turns)
    return np.unique(np.append(turns[:count], len(x) - 1))


@dataclass(frozen=True)
class Loop:
    """One cycle of y over x from a minimum of x to the next: what is stored and what comes back.

    stored and returned are the integrals of y dx while x rises and falls; area is their
    difference for the loop closed by its chord, in (unit of x)(unit of y): joules for newtons
    over metres or pascals over cubic metres.
    """

    first: int
    peak: int
    last: int
    x_low: float
    x_high: float
    stored: float
    returned: float
    area: float


def loops(x: Array, y: Array, least_swing: float = 0.1) -> list[Loop]:
    """Return the cycles of x that rise and fall by more than `least_swing` of its whole span.

    Areas are trapezoidal sums over the samples. x, y: (n,). Raises BadInput if not.
    """
    if x.shape != y.shape or x.ndim != 1:
        raise BadInput("loops", f"x has shape {x.shape}, y {y.shape}", "expected two (n,) arrays")
    span = float(np.ptp(x)) if len(x) else 0.0
    if span <= 0:
        return []
    turns = turning_points(x, least_swing * span)
    found = []
    for first, peak, last in zip(turns, turns[1:], turns[2:], strict=False):
        falls = x[peak] - x[last]
        if x[peak] - x[first] > least_swing * span and falls > least_swing * span:
            found.append(_loop(x, y, int(first), int(peak), int(last)))
    return found


def _loop(x: Array, y: Array, first: int, peak: int, last: int) -> Loop:
    stored = float(np.trapezoid(y[first : peak + 1], x[first : peak + 1]))
    returned = -float(np.trapezoid(y[peak : last + 1], x[peak : last + 1]))
    chord = float((x[first] - x[last]) * (y[first] + y[last]) / 2)
    return Loop(first, peak, last, float(x[first]), float(x[peak]), stored, returned, stored - returned + chord)
