"""The stride: how far the robot gets in a cycle, from the volume ratios of its three actuators over time."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catheter.free import Array, extension
from catheter.robot import Extender
from catheter.tuning import Marks
from data.errors import BadInput, CatheterError


@dataclass(frozen=True, kw_only=True)
class Events:
    """Times in s within a cycle (thesis Fig 3.3): the rear grips (B), the front touches (C), then both let go (E, F).

    B: V1 rises through `anchored`; C: V3 rises through `contact`; E: V1 falls through `contact`; F: V3
    falls through `anchored`. Between B and C the extender pushes the front on, between E and F it
    pulls the rear after it.
    """

    rear_grips_s: float
    front_touches_s: float
    rear_lets_go_s: float
    front_slips_s: float


@dataclass(frozen=True, kw_only=True)
class Stroke:
    """What a cycle gains, in m. stroke_m is the push between B and C; pull_m what the rear follows by between E and F.

    In a steady gait the robot advances by the smaller of the two without slip. inferred: what about
    this number the thesis does not print; "" when the length was given.
    """

    stroke_m: float
    pull_m: float
    stretch: tuple[float, float, float, float]  # l1 of the extender at B, C, E, F
    extender: Extender
    inferred: str


def events(time_s: Array, volume_ratio: Array, marks: Marks | None = None) -> Events:
    """Return the events of one cycle from samples: time (n,), volume ratios (n, 3) of Act 1 to 3.

    Crossings by the line between two samples. Raises BadInput for arrays of another shape or time that does not
    rise, CatheterError naming an event that does not happen.
    """
    marks = marks or Marks()
    if volume_ratio.shape != (len(time_s), 3) or len(time_s) < 2:
        raise BadInput("volume ratios", f"have shape {volume_ratio.shape}", f"expected ({len(time_s)}, 3), 2 or more")
    if not (np.diff(time_s) > 0).all() or not np.isfinite(volume_ratio).all():
        raise BadInput("cycle", "time does not rise, or a volume ratio is not finite", "expected one clean cycle")
    first, _, third = volume_ratio.T
    return Events(
        rear_grips_s=_crossing(time_s, first, marks.anchored, "B: Act 1 never fills up to"),
        front_touches_s=_crossing(time_s, third, marks.contact, "C: Act 3 never fills up to"),
        rear_lets_go_s=_crossing(time_s, -first, -marks.contact, "E: Act 1 never empties down to"),
        front_slips_s=_crossing(time_s, -third, -marks.anchored, "F: Act 3 never empties down to"),
    )


def _crossing(time_s: Array, value: Array, level: float, what: str) -> float:
    """Return when `value` first rises through a level, going around the cycle once."""
    rises: NDArray[np.int64] = np.flatnonzero((value[:-1] < level) & (value[1:] >= level))
    if not len(rises):
        raise CatheterError(
            f"event {what} V = {abs(level):g} (it spans {abs(value).min():.4f} to {abs(value).max():.4f});"
            " change the pressure, the valves or the grip"
        )
    i = rises[0]
    return float(time_s[i] + (level - value[i]) / (value[i + 1] - value[i]) * (time_s[i + 1] - time_s[i]))


def stroke(volume_ratio: ArrayLike, extender: Extender | None = None) -> Stroke:
    """Return the stroke L2 (l1(V2(C)) - l1(V2(B))) of a cycle. volume_ratio (4,): Act 2's at events B, C, E, F.

    The extender's default length of 100 mm is inferred, and the result says so. Raises BadInput for volume
    ratios that are not four positive numbers, Infeasible for one past the extender's lock.
    """
    extender = extender or Extender()
    volumes = np.asarray(volume_ratio, dtype=np.float64)
    if volumes.shape != (4,):
        raise BadInput("stroke", f"got volume ratios of shape {volumes.shape}", "expected those at B, C, E and F")
    b, c, e, f = map(float, extension(extender.angle, volumes))
    return Stroke(
        stroke_m=extender.length * (c - b),
        pull_m=extender.length * (e - f),
        stretch=(b, c, e, f),
        extender=extender,
        inferred=extender.inferred,
    )


def at_events(time_s: Array, volume_ratio: Array, happened: Events) -> Array:
    """Return the volume ratios (4,) at events B, C, E, F from samples: time (n,) s, volume_ratio (n,), Act 2's.

    Raises BadInput for arrays of another shape, and for an event outside the samples.
    """
    times = np.array(list(vars(happened).values()))
    if time_s.shape != volume_ratio.shape or time_s.ndim != 1 or not len(time_s):
        raise BadInput("cycle", f"time has shape {time_s.shape}, V2 {volume_ratio.shape}", "expected two (n,) arrays")
    if times.min() < time_s[0] or times.max() > time_s[-1]:
        found = f"lie from {times.min():g} to {times.max():g} s"
        raise BadInput("events", found, f"the samples span {time_s[0]:g} to {time_s[-1]:g} s")
    return np.asarray(np.interp(times, time_s, volume_ratio))
