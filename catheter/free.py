"""Fibre-reinforced tubes (FREEs): what two families of inextensible fibres leave of a tube's freedom.

A tube of radius r and length L at rest stretches by l1 along its axis and by l2 across it, and twists
by delta. Fibres at angles alpha and beta to the axis keep their length (thesis eq. 3.9, 3.10), so that
its volume ratio V = l1 l2^2 decides everything, up to a lock. Angles are in rad; the twist is the
dimensionless d = delta r / L.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data.errors import BadInput, CatheterError

Array = NDArray[np.float64]

SINGULAR = 1e-9  # rad: families closer than this are one, and a fibre this close to the axis is straight
ROUNDING = 1e-9  # relative: what is equal but for rounding


class Infeasible(CatheterError):
    """A design or state that the fibres do not allow: the message names why, where, and what would help."""


class PairState(IntEnum):
    """What two fibre families say about a volume ratio."""

    FEASIBLE = 0
    ONE_FAMILY = 1  # sin(alpha - beta) = 0: the twist is not determined
    STRAIGHT_FIBRE = 2  # a fibre along the axis: sgn(0), the limits from both sides differ
    BEYOND_LOCK = 3  # V lies past dV/dl1 = 0, or past where a fibre has turned into the axis
    BELOW_RANGE = 4  # deflated so far that a fibre has turned into the axis


@dataclass(frozen=True, eq=False)
class Lock:
    """Where a branch of states ends, all of one shape: axial stretch and volume ratio there.

    direction: +1 where the tube extends as it fills, -1 where it contracts, 0 where it is locked at
    rest. turns: whether dV/dl1 = 0 there (else a fibre lies along the axis). least: the volume
    ratio down to which the same branch deflates.
    """

    axial: Array
    volume_ratio: Array
    direction: Array
    turns: NDArray[np.bool_]
    least: Array


@dataclass(frozen=True, eq=False)
class Stretches:
    """States of tubes with two fibre families, arrays of one shape; NaN where `state` is not FEASIBLE.

    axial l1 and radial l2 (ratios), twist d = delta r / L (rad), volume_ratio as asked for.
    """

    axial: Array
    radial: Array
    twist: Array
    volume_ratio: Array
    state: NDArray[np.int8]

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """Where the fibres allow the volume ratio."""
        return np.asarray(self.state == PairState.FEASIBLE)


def cosine(angle: ArrayLike) -> Array:
    """Return cos(angle), exactly 0 within 1e-12 of +-90 deg, where rounding would leave 6e-17."""
    value = np.cos(angle)
    return np.asarray(np.where(np.abs(value) < 1e-12, 0.0, value))


def stretch(alpha: ArrayLike, beta: ArrayLike, axial: ArrayLike) -> tuple[Array, Array]:
    """Return (l2, d) at an axial stretch (thesis eq. 3.12, 3.13 with sgn for its garbled bracket).

    A = sgn(alpha) sqrt(1 - l1^2 cos^2 alpha), B likewise, N = A cos(beta) - B cos(alpha):
    l2 = N / sin(alpha - beta), d = (B sin alpha - A sin beta) / N. Arguments broadcast, complex ones
    too (for derivatives by a complex step). NaN where a fibre is too short for l1.
    """
    ca, cb, sa, sb = cosine(alpha), cosine(beta), np.sin(alpha), np.sin(beta)
    a = np.sign(np.real(sa)) * _across(ca, axial)
    b = np.sign(np.real(sb)) * _across(cb, axial)
    n = a * cb - b * ca
    return np.asarray(n / (sa * cb - ca * sb)), np.asarray((b * sa - a * sb) / n)


def _across(c: ArrayLike, axial: ArrayLike) -> Array:
    """Return sqrt(1 - l1^2 c^2), the part of a fibre that runs around the tube; 0 just past its end."""
    along = np.asarray(axial) * c
    square = (1 - along) * (1 + along)
    return np.asarray(np.sqrt(np.where((np.real(square) < 0) & (np.real(square) > -1e-14), 0.0, square)))


def volume_slope(alpha: ArrayLike, beta: ArrayLike, axial: ArrayLike) -> Array:
    """Return d ln V / d l1 = 1/l1 + sgn(alpha beta) 2 l1 cos(alpha) cos(beta) / (|A| |B|).

    That is (1 + 2 dln l2/dln l1) / l1 with the quotient of thesis eq. 3.12 cleared: no difference of
    nearly equal numbers is left in it.
    """
    ca, cb = cosine(alpha), cosine(beta)
    sign = np.sign(np.real(np.sin(alpha) * np.sin(beta)))
    axial = np.asarray(axial)
    return np.asarray(1 / axial + 2 * sign * axial * ca * cb / (_across(ca, axial) * _across(cb, axial)))


def lock(alpha: ArrayLike, beta: ArrayLike) -> Lock:
    """Return where the branch through the state of rest ends as the tube fills.

    Opposite signs: ln V is concave in x = l1^2, and dV/dl1 = 0 is |A||B| = 2 x cos(alpha) cos(beta),
    3 p x^2 + s x - 1 = 0 with s = cos^2 alpha + cos^2 beta, p = cos^2 alpha cos^2 beta: one lock
    (for beta = -alpha l1 = 1/(sqrt 3 cos alpha), V = 2/(3 sqrt 3 cos alpha sin^2 alpha)). Equal signs: V rises all the
    way to l1 = 1/cos, where the flatter fibre lies along the axis. So V is monotone between rest and
    lock, and a volume ratio belongs to one state only. NaN for one family and straight fibres.
    """
    alpha, beta = np.broadcast_arrays(*np.atleast_1d(alpha, beta))
    ca, cb = cosine(alpha), cosine(beta)
    s, p = ca**2 + cb**2, (ca * cb) ** 2
    undetermined = _undetermined(alpha, beta) != PairState.FEASIBLE
    with np.errstate(divide="ignore", invalid="ignore"):
        turns = (np.sin(alpha) * np.sin(beta) < 0) & (p > 0)
        end = 1 / np.maximum(ca, cb)
        axial = np.where(turns, np.sqrt(2 / (s + np.sqrt(s * s + 12 * p))), end)
        axial = np.where(undetermined, np.nan, axial)
        direction = np.where(np.abs(axial - 1) < ROUNDING, 0.0, np.sign(axial - 1))
        volume = axial * stretch(alpha, beta, axial)[0] ** 2
        flat = end * stretch(alpha, beta, end)[0] ** 2
    least = np.where(direction > 0, 0.0, np.where(undetermined, np.nan, flat))
    return Lock(axial, volume, direction, turns, least)


def _undetermined(alpha: ArrayLike, beta: ArrayLike) -> NDArray[np.int8]:
    sa, sb, ca, cb = np.sin(alpha), np.sin(beta), cosine(alpha), cosine(beta)
    straight = np.minimum(np.abs(sa), np.abs(sb)) < SINGULAR
    one = np.abs(sa * cb - ca * sb) < SINGULAR
    state = np.where(straight, PairState.STRAIGHT_FIBRE, PairState.FEASIBLE)
    return np.where(one, PairState.ONE_FAMILY, state).astype(np.int8)


def inflate(alpha: ArrayLike, beta: ArrayLike, volume_ratio: ArrayLike) -> Stretches:
    """Return the states at given volume ratios, on the branch that leads there from rest (l1 = 1).

    All arguments broadcast. Newton on ln V, kept in a bracket between rest and lock in which V is
    monotone: it can neither jump a branch nor pass dV/dl1 = 0. V < 1 follows the same branch
    backwards; the kinematics allow it, a real tube may buckle. What is not feasible is NaN and says why.
    Raises BadInput for a volume ratio that is not positive and finite, or an angle beyond +-90 deg.
    """
    shape = np.broadcast_shapes(np.shape(alpha), np.shape(beta), np.shape(volume_ratio))
    a, b, v = (np.array(np.broadcast_to(x, shape), dtype=np.float64).ravel() for x in (alpha, beta, volume_ratio))
    check_angles(alpha=a, beta=b)
    if not (np.isfinite(v) & (v > 0)).all():
        raise BadInput("volume ratio", f"is {v[~(np.isfinite(v) & (v > 0))][0]:g}", "it must be positive, 1 at rest")
    ends, state = lock(a, b), _undetermined(a, b)
    known = state == PairState.FEASIBLE
    still = (ends.direction == 0) & (np.abs(v - 1) > ROUNDING)
    state[known & (still | (v > ends.volume_ratio * (1 + 1e-15)))] = PairState.BEYOND_LOCK
    state[known & ~still & (v < ends.least)] = PairState.BELOW_RANGE
    good = state == PairState.FEASIBLE
    axial, radial, twist = (np.full(a.shape, np.nan) for _ in range(3))
    axial[good] = _axial(a[good], b[good], v[good], Lock(*(x[good] for x in vars(ends).values())))
    radial[good], twist[good] = stretch(a[good], b[good], axial[good])
    found = {"axial": axial, "radial": radial, "twist": twist, "volume_ratio": v, "state": state}
    return Stretches(**{name: value.reshape(shape) for name, value in found.items()})


def _axial(alpha: Array, beta: Array, volume_ratio: Array, ends: Lock) -> Array:
    """Return l1 (n,) of volume ratios that the branch reaches: Newton in a bracket, bisection where it leaves."""
    filling = volume_ratio >= 1
    rising = ends.direction >= 0
    with np.errstate(divide="ignore"):
        empty = np.where(rising, 0.0, 1 / np.maximum(cosine(alpha), cosine(beta)))
    other = np.where(filling, ends.axial, empty)
    low, high = np.minimum(1.0, other), np.maximum(1.0, other)
    axial, todo = np.ones_like(alpha), np.arange(len(alpha))
    for _ in range(200):  # bisection alone needs 60 from 1, and 1100 for the smallest V there is
        a, b, x = alpha[todo], beta[todo], axial[todo]
        with np.errstate(divide="ignore", invalid="ignore"):
            error = np.log(x * stretch(a, b, x)[0] ** 2 / volume_ratio[todo])
            step = error / volume_slope(a, b, x)
        right = (error < 0) == rising[todo]  # the state lies at a larger l1
        low[todo], high[todo] = np.where(right, x, low[todo]), np.where(right, high[todo], x)
        following = x - step
        outside = ~((following >= low[todo]) & (following <= high[todo]))
        following = np.where(outside, (low[todo] + high[todo]) / 2, following)
        exact = np.abs(error) <= 1e-16
        axial[todo] = np.where(exact, x, following)
        todo = todo[~exact & (np.abs(following - x) > 1e-15 * x)]
        if not len(todo):
            break
    return axial


def extension(alpha: float, volume_ratio: ArrayLike) -> Array:
    """Return l1 of a McKibben tube, fibres at +-alpha, in closed form, shape of `volume_ratio`.

    cos^2(alpha) l1^3 - l1 + sin^2(alpha) V = 0, solved by angle trisection on the branch through rest:
    steeper than 54.7 deg it extends, flatter it contracts. At 90 deg l1 = V. Raises Infeasible past
    the lock V = 2/(3 sqrt(3) cos sin^2), and for 0 and 54.7 deg; BadInput as `inflate`.
    """
    v = np.asarray(volume_ratio, dtype=np.float64)
    check_angles(alpha=np.asarray(alpha))
    if not (np.isfinite(v) & (v > 0)).all():
        raise BadInput("volume ratio", f"is {v.min():g}", "it must be positive, 1 at rest")
    c, s2 = float(cosine(alpha)), float(np.sin(alpha) ** 2)
    if c == 0:
        return v.copy()
    most = 2 / (3 * np.sqrt(3) * c * s2) if s2 > SINGULAR**2 else 1.0
    if s2 <= SINGULAR**2 or abs(3 * c * c - 1) < ROUNDING or v.max() > most * (1 + 1e-15):
        raise Infeasible(
            f"fibres at +-{np.degrees(alpha):g} deg do not reach V = {v.max():g}: they lock at {most:.6g};"
            " ask for a smaller volume ratio or other angles"
        )
    share = np.minimum(v / most, 1.0)
    root = np.sin(np.arcsin(share) / 3) if 3 * c * c < 1 else np.cos(np.arccos(-share) / 3)
    return np.asarray(2 / (np.sqrt(3) * c) * root)


def check_angles(**angles: Array) -> None:
    """Raise BadInput for the first angle that is not a number within +-90 deg."""
    for name, angle in angles.items():
        bad = ~(np.abs(angle) <= np.pi / 2 + ROUNDING)
        if bad.any():
            raise BadInput(name, f"is {np.degrees(angle[bad].flat[0]):g} deg", "angles lie within +-90 deg")


def refusal(alpha: float, beta: float, volume_ratio: float) -> str:
    """Return why two fibre families do not allow a volume ratio, with numbers and a remedy; "" where they do."""
    state = PairState(int(inflate(alpha, beta, volume_ratio).state))
    where = f"fibres at {np.degrees(alpha):.6g} and {np.degrees(beta):.6g} deg, V = {volume_ratio:.6g}"
    ends = lock(alpha, beta)
    reach = f"they allow V from {ends.least.item():.6g} to {ends.volume_ratio.item():.6g}"
    return {
        PairState.FEASIBLE: "",
        PairState.ONE_FAMILY: f"{where}: they are one family, sin(alpha - beta) = 0, and leave the twist"
        " undetermined; choose two different angles",
        PairState.STRAIGHT_FIBRE: f"{where}: a fibre along the axis can turn either way, so the twist has two"
        " values; choose an angle that is not 0",
        PairState.BEYOND_LOCK: f"{where}: beyond the lock at l1 = {ends.axial.item():.6g}; {reach}:"
        " ask for less volume or change the angles",
        PairState.BELOW_RANGE: f"{where}: a fibre lies along the axis before that; {reach}: deflate less",
    }[state]
