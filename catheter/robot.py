"""The robot in its cannula, spiral, extender, spiral: whether it fits, touches, extends, and stands straight."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from catheter.free import (
    ROUNDING,
    Array,
    Infeasible,
    Stretches,
    extension,
    inflate,
    lock,
    refusal,
    stretch,
    volume_slope,
)
from catheter.helix import Design, HelixState, bend
from catheter.task import DEGREE, MM, Task
from data.errors import BadInput
from data.options import option
from data.table import table

MAGIC = np.arctan(np.sqrt(2.0))  # 54.7 deg: steeper crossed fibres extend, flatter ones contract


@dataclass(frozen=True, kw_only=True)
class Segment:
    """One actuator of the robot: its fibres in rad (gamma None: no third fibre) and its length at rest in m."""

    name: str
    alpha: float
    beta: float
    gamma: float | None
    length: float
    note: str = ""


def layout(task: Task, spiral: Design, extender: "Extender") -> tuple[Segment, Segment, Segment]:
    """Return the robot from rear to front (thesis Fig 3.1): the two spirals grip, the extender between them strides."""
    ends = [
        Segment(name=name, alpha=spiral.alpha_rad, beta=spiral.beta_rad, gamma=spiral.gamma_rad, length=task.length)
        for name in ("Act 1, rear spiral", "Act 3, front spiral")
    ]
    middle = Segment(
        name="Act 2, extender",
        alpha=extender.angle,
        beta=-extender.angle,
        gamma=None,
        length=extender.length,
        note=extender.inferred,
    )
    return ends[0], middle, ends[1]


@dataclass(frozen=True, kw_only=True)
class Extender:
    """The middle actuator: fibres at +-angle (thesis Table 3.2), length at rest.

    The thesis prints no length for it. 100 mm is inferred: its 28 mm a cycle need 84 to 103 mm, the
    spiral's 300 mm would give three times as much.
    """

    angle: float = option(80 * DEGREE, unit="rad", least=0.0, most=np.pi / 2)
    length: float = option(100 * MM, unit="m", least=1e-6)

    @property
    def inferred(self) -> str:
        """What to say about the length when it is the default; "" otherwise."""
        return "length inferred, not printed in the thesis" if self.length == 100 * MM else ""


@dataclass(frozen=True, kw_only=True)
class Contact:
    """Volume ratios at which a spiral, filled from rest, first touches the cannula; NaN: it locks before.

    wall: the outer wall of its tube does (the centre line's R and the deformed radius l2 r and wall);
    centre_line: its centre line would lie on the cannula's wall, which squeezes the tube flat against it.
    """

    wall: float
    centre_line: float


def contact(task: Task, spiral: Design, points: int = 2001) -> Contact:
    """Return when a spiral touches. The wall thins as it stretches: rubber keeps its volume.

    The first crossing on `points` volume ratios up to the lock, then bisected by interpolation: good
    to about 1e-6 in V. Raises Infeasible for fibres that lock at rest.
    """
    if reason := refusal(spiral.alpha_rad, spiral.beta_rad, 1.0):
        raise Infeasible(reason)
    end = float(lock(spiral.alpha_rad, spiral.beta_rad).volume_ratio.item())
    volume = np.linspace(1.0, min(end, 10.0) * (1 - 1e-9), points)
    pair = inflate(spiral.alpha_rad, spiral.beta_rad, volume)
    helix = bend(pair, spiral.gamma_rad, radius=task.radius, length=task.length, torsion=task.torsion)
    good = (helix.state == HelixState.VALID) | (volume <= 1.0)
    centre = np.where(good, helix.radius_m, np.nan)
    outer = outer_radius(task, pair)
    half = task.diameter / 2
    return Contact(wall=_first(volume, centre + outer - half), centre_line=_first(volume, centre - half))


def outer_radius(task: Task, pair: Stretches) -> Array:
    """Return the outer radius [m] of a filled tube, of the shape of the pair's states."""
    return np.asarray(np.sqrt((task.radius * pair.radial) ** 2 + _wall_area(task) / pair.axial))


def _wall_area(task: Task) -> float:
    """Return ((r + t)^2 - r^2) in m^2, the wall's cross-section over pi; it shrinks with 1/l1."""
    return (task.radius + task.wall) ** 2 - task.radius**2


def _first(x: Array, y: Array) -> float:
    """Return where y first rises through 0, by the line between two samples; NaN when it does not."""
    at = np.flatnonzero((y[:-1] < 0) & (y[1:] >= 0))
    if not len(at):
        return float("nan")
    i = at[0]
    return float(x[i] - y[i] * (x[i + 1] - x[i]) / (y[i + 1] - y[i]))


@dataclass(frozen=True, kw_only=True)
class Rubber:
    """A neo-Hookean wall. shear_modulus: of soft latex, ASSUMED: the thesis gives none for the tubing."""

    shear_modulus: float = option(0.4e6, unit="Pa", least=1.0)


def pressure(
    alpha: float, beta: float, volume_ratio: ArrayLike, *, radius: float, wall: float, rubber: Rubber | None = None
) -> Array:
    """Return the pressure in Pa that fills a tube to volume ratios, by virtual work (thesis 2.1.1): an estimate.

    P dV = dW, W = mu/2 (I1 - 3) of the wall's rubber, one stretch over its whole thickness (good to
    about wall / radius): I1 = l1^2 + l2^2 (1 + d^2) + 1 / (l1 l2)^2. It needs no third fibre: bending is
    left out. Infinite at the lock, where no volume is left to do work. Raises Infeasible, BadInput.
    """
    pair = inflate(alpha, beta, volume_ratio)
    _refuse(alpha, beta, pair)
    axial = pair.axial + 1e-30j  # a complex step: its imaginary part is the derivative
    radial, twist = stretch(alpha, beta, axial)
    first = axial**2 + radial**2 * (1 + twist**2) + 1 / (axial * radial) ** 2
    work = (rubber or Rubber()).shear_modulus / 2 * np.imag(first) / 1e-30
    rubber_share = ((radius + wall) ** 2 - radius**2) / radius**2  # volume of the wall over that of the lumen
    with np.errstate(divide="ignore"):
        slope = volume_slope(alpha, beta, pair.axial) * pair.volume_ratio
        return np.asarray(np.where(np.abs(slope) > ROUNDING, rubber_share * work / slope, np.inf))


def _refuse(alpha: float, beta: float, pair: Stretches) -> None:
    if not pair.feasible.all():
        raise Infeasible(refusal(alpha, beta, float(pair.volume_ratio[~pair.feasible].flat[0])))


@dataclass(frozen=True, kw_only=True)
class Stride:
    """An extender at one angle and volume ratio; forces and pressures are estimates (see `extender_sweep`)."""

    angle_rad: float
    axial: float
    extension_m: float
    lock_volume_ratio: float
    pressure_pa: float
    buckling_force_n: float
    buckling_pressure_pa: float


def extender_sweep(task: Task, angles: ArrayLike, *, length: float, rubber: Rubber | None = None) -> list[Stride]:
    """Return extension and buckling of extenders with fibres at +-angle, for angles (rad) that reach the task's V.

    Extension is the closed form of `catheter.free.extension`. Buckling is ESTIMATED: an Euler column of the
    stretched length, hinged at both ends, E = 3 mu of the wall alone (thin, neo-Hookean, its volume kept),
    stiffness of fibres and fluid, bending of the anchors and the cannula's support left out. The
    pressure: what makes a blocked tube push with that force, P pi r^2 dV/dl1. Real tubes bend earlier
    by their imperfections, later by the cannula's wall. Raises BadInput for an angle that does not extend.
    """
    found = []
    for angle in np.atleast_1d(np.asarray(angles, dtype=np.float64)).tolist():
        if not MAGIC < angle < np.pi / 2:
            raise BadInput(
                "extender angle", f"is {np.degrees(angle):.4g} deg", "54.7 to 90 deg: flatter fibres contract"
            )
        if float(lock(angle, -angle).volume_ratio.item()) > task.volume_ratio:
            found.append(_stride(task, angle, length, rubber or Rubber()))
    return found


def _stride(task: Task, angle: float, length: float, rubber: Rubber) -> Stride:
    axial = float(extension(angle, task.volume_ratio))
    inner2 = (float(stretch(angle, -angle, axial)[0]) * task.radius) ** 2
    second_moment = np.pi / 4 * ((inner2 + _wall_area(task) / axial) ** 2 - inner2**2)
    force = float(np.pi**2 * 3 * rubber.shear_modulus * second_moment / (axial * length) ** 2)
    slope = float(volume_slope(angle, -angle, axial)) * task.volume_ratio
    filled = pressure(angle, -angle, task.volume_ratio, radius=task.radius, wall=task.wall, rubber=rubber)
    return Stride(
        angle_rad=angle,
        axial=axial,
        extension_m=(axial - 1) * length,
        lock_volume_ratio=float(lock(angle, -angle).volume_ratio.item()),
        pressure_pa=float(filled),
        buckling_force_n=force,
        buckling_pressure_pa=force / (np.pi * task.radius**2 * slope),
    )


def published() -> tuple[float, float, float]:
    """Return (alpha, beta, gamma) in rad of the thesis's spiral (Table 3.2)."""
    angles = table("3.2")
    alpha, beta, gamma = (angles.value("Spiral", name) for name in ("alpha", "beta", "gamma"))
    return alpha, beta, gamma
