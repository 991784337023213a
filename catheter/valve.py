"""Conical valves: a cone of soft rubber that opens at one pressure forwards and at another backwards.

Cracking pressures are measured (thesis Table 3.5): cones of 0 to 50 deg, 0.050 to 0.110 in thick.
Between them they are interpolated, beyond them refused.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catheter.free import Array, Infeasible
from data.errors import BadInput
from data.options import option
from data.table import table

INCH = 0.0254


@dataclass(frozen=True, eq=False)
class Cones:
    """Cones and their cracking pressures, arrays of one shape; those measured: (a,), (t,), (a, t), (a, t)."""

    angle_rad: Array
    thickness_m: Array
    forward_pa: Array
    reverse_pa: Array

    @property
    def ratio(self) -> Array:
        """Prev / Pfwd - 1: thesis Fig 3.20."""
        return np.asarray(self.reverse_pa / self.forward_pa - 1)


@cache
def measured() -> Cones:
    """Return Table 3.5 as arrays in SI."""
    cones = table("3.5")
    angle, thickness = np.unique(cones.column("angle")), np.unique(cones.column("thickness"))
    shape = (len(angle), len(thickness))  # its rows go by angle, then by thickness
    return Cones(angle, thickness, cones.column("forward").reshape(shape), cones.column("reverse").reshape(shape))


def cone(angle_rad: ArrayLike, thickness_m: ArrayLike) -> Cones:
    """Return cones by bilinear interpolation of both cracking pressures; arguments broadcast.

    Exact at measured cones; the table prints no spread, so how good it is between them is not known.
    Raises BadInput naming the measured range for what lies outside it.
    """
    known = measured()
    shape = np.broadcast_shapes(np.shape(angle_rad), np.shape(thickness_m))
    angle, thickness = (np.broadcast_to(np.asarray(x, np.float64), shape) for x in (angle_rad, thickness_m))
    i, u = _place(angle, known.angle_rad, "cone angle", "deg", np.pi / 180)
    j, v = _place(thickness, known.thickness_m, "cone thickness", "in", INCH)

    def between(table: Array) -> Array:
        near = (1 - v) * table[i, j] + v * table[i, j + 1]
        return np.asarray((1 - u) * near + u * ((1 - v) * table[i + 1, j] + v * table[i + 1, j + 1]))

    return Cones(angle, thickness, between(known.forward_pa), between(known.reverse_pa))


def _place(value: Array, knots: Array, what: str, unit: str, size: float) -> tuple[NDArray[np.int64], Array]:
    """Return which interval a value lies in and how far along, 0 to 1; a rounding's width outside still counts."""
    slack = 1e-9 * knots[-1]
    bad = ~((value >= knots[0] - slack) & (value <= knots[-1] + slack))
    if bad.any():
        reach = f"measured are {knots[0] / size:.3g} to {knots[-1] / size:.3g} {unit}, and nothing beyond is known"
        raise BadInput(what, f"is {value[bad].flat[0] / size:.4g} {unit}", reach)
    at = np.asarray(np.clip(np.searchsorted(knots, value, side="right") - 1, 0, len(knots) - 2), np.int64)
    return at, np.clip((value - knots[at]) / (knots[at + 1] - knots[at]), 0.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """What a valve should do; 0 for a pressure leaves it open. ratio is Prev / Pfwd - 1, None leaves it open."""

    ratio: float | None = option(None, least=-0.99)
    forward: float = option(0.0, unit="Pa", least=0.0)
    reverse: float = option(0.0, unit="Pa", least=0.0)


@dataclass(frozen=True, kw_only=True)
class Choice:
    """The cone nearest to what was wanted. miss: root sum of squares of the relative differences; 0 is a hit.

    measured: whether it is a cone of the table, not one between.
    """

    angle_rad: float
    thickness_m: float
    forward_pa: float
    reverse_pa: float
    ratio: float
    miss: float
    measured: bool


def choose(wanted: Wanted, *, accept: float = 0.02, between: int = 40) -> Choice:
    """Return the cone that comes closest to the wanted pressures or ratio, within `accept` (relative).

    Looks at `between` cones from one measured angle or thickness to the next; the first of equals is
    the flattest, thinnest. Raises Infeasible with the nearest there is when none comes within `accept`,
    BadInput when nothing, or more than two things, are wanted.
    """
    targets = {"forward_pa": wanted.forward or None, "reverse_pa": wanted.reverse or None, "ratio": wanted.ratio}
    given = {name: target for name, target in targets.items() if target is not None}
    if not 1 <= len(given) <= 2:
        raise BadInput("valve", f"{len(given)} wishes", "give one or two of ratio, forward and reverse")
    known = measured()
    angle, thickness = _refined(known.angle_rad, between), _refined(known.thickness_m, between)
    cones = cone(angle[:, None], thickness[None, :])
    miss = _miss(cones, given)
    i, j = divmod(int(np.argmin(miss.round(12))), miss.shape[1])
    nearest = Choice(
        angle_rad=float(angle[i]),
        thickness_m=float(thickness[j]),
        forward_pa=float(cones.forward_pa[i, j]),
        reverse_pa=float(cones.reverse_pa[i, j]),
        ratio=float(cones.ratio[i, j]),
        miss=float(miss[i, j]),
        measured=bool(i % between == 0 and j % between == 0),
    )
    if nearest.miss > accept:
        raise Infeasible(f"no measured or interpolated cone comes within {accept:.1%} of {_words(given, nearest)}")
    return nearest


def _miss(cones: Cones, given: dict[str, float]) -> Array:
    """Return the root sum of squares of the relative differences; a ratio can be 0, so Prev / Pfwd is compared."""
    offset = {name: 1.0 if name == "ratio" else 0.0 for name in given}
    off = [(getattr(cones, name) + offset[name]) / (wish + offset[name]) - 1 for name, wish in given.items()]
    return np.asarray(np.sqrt(np.sum(np.square(off), axis=0)))


def _refined(knots: Array, between: int) -> Array:
    """Return each interval of the knots cut in `between`."""
    return np.interp(np.arange((len(knots) - 1) * between + 1) / between, np.arange(len(knots)), knots)


def _words(given: dict[str, float], nearest: Choice) -> str:
    words = {"forward_pa": "forward {:.4g} kPa", "reverse_pa": "reverse {:.4g} kPa", "ratio": "a ratio of {:.4g}"}
    wishes = [words[name].format(wish / (1 if name == "ratio" else 1e3)) for name, wish in given.items()]
    return (
        f"{' and '.join(wishes)}; the nearest is {np.degrees(nearest.angle_rad):.3g} deg,"
        f" {nearest.thickness_m / INCH:.3g} in: forward {nearest.forward_pa / 1e3:.4g} kPa, reverse"
        f" {nearest.reverse_pa / 1e3:.4g} kPa, ratio {nearest.ratio:.3g}"
    )
