"""The third fibre: a strain limiter along a FREE that makes it bend into a helix.

Everything goes through curvature k and torsion tau, which stay finite for a straight tube (k = 0),
a planar ring (gamma = 0 without twist) and everything between.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catheter.free import ROUNDING, Array, Infeasible, Stretches, check_angles, cosine, inflate, refusal
from data.errors import BadInput, nearest

TORSIONS = ("thesis", "exact")


class HelixState(IntEnum):
    """What the third fibre does."""

    VALID = 0
    OVER_CONSTRAINED = 1  # |l2 (sin g + d cos g)| > 1: the third fibre is too short even around the tube
    SLACK = 2  # the limiter's line is as long as the axis or longer: nothing bends the tube
    AROUND = 3  # gamma = +-90 deg: psi is infinite, and a hoop limits no axial strain
    NO_PAIR = 4  # the first two fibres do not allow the volume ratio


@dataclass(frozen=True, eq=False)
class Helix:
    """Helices of tubes at rest of radius r and length L, arrays of one shape.

    axial: l1 of the tube; limiter: axial stretch l_g of the inner line; curvature, torsion [1/m] of
    the centre line; twist_rad: delta over the whole length; length: L [m]. Numbers mean something
    where `state` is VALID; radius, length ratio and pitch are NaN for k = tau = 0, a straight tube.
    """

    axial: Array
    limiter: Array
    curvature: Array
    torsion: Array
    twist_rad: Array
    length: float
    state: NDArray[np.int8]

    @property
    def radius_m(self) -> Array:
        """Radius of the helix (thesis eq. 3.15): R = k / (k^2 + tau^2)."""
        return self._over_square(self.curvature)

    @property
    def angle_rad(self) -> Array:
        """Angle of the helix (thesis eq. 3.16): phi = atan(tau / k)."""
        return np.arctan2(self.torsion, self.curvature)

    @property
    def length_ratio(self) -> Array:
        """lambda_x, axial length over L (thesis eq. 3.17 divided by its L): l1 |sin phi|."""
        sign = np.sign(np.real(self.torsion))
        with np.errstate(invalid="ignore"):
            return np.asarray(self.axial * sign * self.torsion / np.sqrt(self.curvature**2 + self.torsion**2))

    @property
    def pitch_m(self) -> Array:
        """Rise in one turn, signed with the hand: 2 pi R tan(phi) = 2 pi tau / (k^2 + tau^2)."""
        return self._over_square(2 * np.pi * self.torsion)

    def _over_square(self, value: Array) -> Array:
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(value / (self.curvature**2 + self.torsion**2))

    @property
    def turns(self) -> Array:
        """Turns over the whole length, lambda_x L / pitch = l1 L sqrt(k^2 + tau^2) / 2 pi."""
        return np.asarray(self.axial * self.length * np.hypot(self.curvature, self.torsion) / (2 * np.pi))


def bend(pair: Stretches, gamma: ArrayLike, *, radius: ArrayLike, length: float, torsion: str = "thesis") -> Helix:
    """Return the helices that a third fibre at `gamma` makes of tubes; arguments broadcast. SI.

    The inner line of the bend is the limiter: l_g = sqrt(1 - (l2 (sin g + d cos g))^2) / cos g
    (thesis eq. 3.11, its bracket squared), k = (l1 - l_g) / (l1 l2 r), tau = (d + tan g) / r. That
    torsion, of the tube at rest, is the thesis's; "exact" divides it by l1, which makes the helix
    whose inner line has just the limiter's length. Raises BadInput for a radius or length that is
    not positive, an angle beyond +-90 deg, or an unknown torsion.
    """
    gamma, radius = np.asarray(gamma), np.asarray(radius)
    check_angles(gamma=np.real(gamma))
    _check(radius, length, torsion)
    c, s = cosine(gamma), np.sin(gamma)
    with np.errstate(divide="ignore", invalid="ignore"):
        around = pair.radial * (s + pair.twist * c)
        limiter = np.sqrt((1 - around) * (1 + around)) / c
        curvature = (pair.axial - limiter) / (pair.axial * pair.radial * radius)
        turning = (pair.twist + s / c) / radius
        if torsion == "exact":
            turning = turning / pair.axial
    state = np.where(np.real(limiter) < np.real(pair.axial) * (1 - ROUNDING), HelixState.VALID, HelixState.SLACK)
    state = np.where(np.abs(np.real(around)) > 1, HelixState.OVER_CONSTRAINED, state)
    state = np.where(np.real(c) == 0, HelixState.AROUND, state)
    state = np.where(pair.feasible, state, HelixState.NO_PAIR).astype(np.int8)
    return Helix(pair.axial, limiter, curvature, turning, pair.twist * length / radius, length, state)


def _check(radius: Array, length: float, torsion: str) -> None:
    if not (np.real(radius) > 0).all():
        raise BadInput("tube radius", f"is {np.real(radius).min():g} m", "it must be positive: a helix scales with it")
    if not length > 0:
        raise BadInput("tube length", f"is {length:g} m", "it must be positive")
    if torsion not in TORSIONS:
        raise BadInput("torsion", f"is {torsion!r}", nearest(torsion, TORSIONS))


@dataclass(frozen=True, kw_only=True)
class Design:
    """One design at one volume ratio, in SI: what the fibres make of the tube and its helix."""

    alpha_rad: float
    beta_rad: float
    gamma_rad: float
    volume_ratio: float
    axial: float
    radial: float
    limiter: float
    twist_rad: float
    radius_m: float
    angle_rad: float
    length_ratio: float
    pitch_m: float
    turns: float
    torsion: str


def design(
    alpha: float,
    beta: float,
    gamma: float,
    *,
    volume_ratio: float,
    radius: float,
    length: float,
    torsion: str = "thesis",
) -> Design:
    """Return one design's state (rad, m). Raises Infeasible saying why there is none, BadInput as `bend`."""
    if reason := refusal(alpha, beta, volume_ratio):
        raise Infeasible(reason)
    pair = inflate(alpha, beta, volume_ratio)
    helix = bend(pair, gamma, radius=radius, length=length, torsion=torsion)
    if helix.state != HelixState.VALID:
        raise Infeasible(_why(HelixState(int(helix.state)), pair, helix, float(gamma)))
    numbers = {name: float(getattr(helix, name)) for name in Design.__dataclass_fields__ if hasattr(helix, name)}
    numbers |= {"alpha_rad": alpha, "beta_rad": beta, "gamma_rad": gamma, "radial": float(pair.radial)}
    return Design(**numbers | {"torsion": torsion, "volume_ratio": volume_ratio})  # type: ignore[arg-type]


def _why(state: HelixState, pair: Stretches, helix: Helix, gamma: float) -> str:
    where = f"third fibre at {np.degrees(gamma):.6g} deg, V = {float(pair.volume_ratio):.6g}"
    around = float(pair.radial * (np.sin(gamma) + pair.twist * cosine(gamma)))
    if state == HelixState.SLACK and abs(float(helix.limiter / pair.axial) - 1) <= ROUNDING:
        return (
            f"{where}: slack, its line stretches by {float(pair.axial):.6g} as the tube does, so that nothing bends;"
            " fill the tube, or choose an angle that is neither alpha nor beta"
        )
    return {
        HelixState.OVER_CONSTRAINED: f"{where}: over-constrained, its hoop share would have to be"
        f" {abs(around):.6g} of its length (at most 1); turn it towards the axis",
        HelixState.SLACK: f"{where}: slack, its line would stretch by {float(helix.limiter):.6g}, the tube by"
        f" {float(pair.axial):.6g} only, so that nothing bends; turn it towards the axis or extend the tube more",
        HelixState.AROUND: f"{where}: it runs around the tube, tan(gamma) is infinite, and limits no axial"
        " strain; choose an angle within +-90 deg",
    }[state]
