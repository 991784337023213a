"""The shapes a scene asks for: spiral, bend, twist and balloon in any mix, along a vessel or straight."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from catheter.centreline import Vessel
from catheter.curve import Curve, Offset, line, product
from catheter.frames import perpendicular, rotation_minimising
from catheter.polyline import crossing
from catheter.shape import Shape, Shear, Slopes, Wall
from data.errors import BadInput
from data.options import option
from data.signal import Array

MM = 1e-3


@dataclass(frozen=True, kw_only=True)
class Actuator:
    """A tube before it is deformed [m], along the vessel or straight along its first tangent.

    divisions: elements (around, along, through the wall); voxels (around, along); nodes: of an element.
    """

    inner_radius: float = option(0.99 * MM, unit="m", least=1e-7)
    outer_radius: float = option(1.00 * MM, unit="m", least=1e-7)
    initial: str = option("vessel", choices=("vessel", "straight"))
    divisions: tuple[int, ...] = option((32, 32, 1), least=1, most=512)
    voxels: tuple[int, ...] = option((32, 32), least=1, most=512)
    nodes: str = option("8", choices=("8", "20"))


@dataclass(frozen=True, kw_only=True)
class Spiral:
    """A helix about the vessel's centreline, R(w) = share f(w / L) r_vessel(w) (thesis eq. 4.4 to 4.6).

    offset: rho, a constant shift along the tangent. envelope "thesis": f = atan(15 w / L) / sqrt(2),
    as printed, w taken over L: it blends one end and tends to 1.11; "smooth": from 0 to 1 and
    back to 0, each within `blend` of the length.
    """

    turns: float = 0.0
    share: float = option(0.5, least=0.0)
    offset: float = option(0.0, unit="m")
    envelope: str = option("smooth", choices=("smooth", "thesis"))
    blend: float = option(0.3, least=0.01, most=0.5)


@dataclass(frozen=True, kw_only=True)
class Bend:
    """A circular arc of an angle, and a sway sideways after a straight share; direction counts from N1."""

    angle: float = option(0.0, unit="rad")
    direction: float = option(0.0, unit="rad")
    sway: float = option(0.0, unit="m")
    straight: float = option(0.0, least=0.0, most=0.95)


@dataclass(frozen=True, kw_only=True)
class Twist:
    """The shear gamma = angle w / L + wave sin(waves v) + through (u - inner) / (outer - inner)."""

    angle: float = option(0.0, unit="rad")
    wave: float = option(0.0, unit="rad")
    waves: int = option(2, least=1, most=64)
    through: float = option(0.0, unit="rad")


@dataclass(frozen=True, kw_only=True)
class Balloon:
    """The final bore over the initial: grow + (bulge + lobe cos(lobes v)) sin^2(pi w / L).

    fit: instead, the outer wall's distance from its centreline over the vessel's radius.
    """

    grow: float = option(1.0, least=0.05)
    bulge: float = 0.0
    lobe: float = 0.0
    lobes: int = option(2, least=1, most=64)
    fit: float = option(0.0, least=0.0)


@dataclass(frozen=True, kw_only=True)
class Motions:
    """What the final shape is made of."""

    spiral: Spiral = field(default_factory=Spiral)
    bend: Bend = field(default_factory=Bend)
    twist: Twist = field(default_factory=Twist)
    balloon: Balloon = field(default_factory=Balloon)


def build(vessel: Vessel, actuator: Actuator, motions: Motions) -> Shape:
    """Return the shape. Raises BadInput for radii that make no tube, and for folds and overlaps at q = 1."""
    inner, outer = actuator.inner_radius, actuator.outer_radius
    if not inner < outer:
        found = f"has radii {1e3 * inner:g} and {1e3 * outer:g} mm"
        raise BadInput("actuator", found, "expected inner_radius < outer_radius")
    start = np.zeros(1)
    origin, slope = vessel.centre(start, 1)[:, 0]
    tangent = slope / np.linalg.norm(slope)
    initial = line(origin, tangent) if actuator.initial == "straight" else vessel.centre
    seed = perpendicular(tangent)
    shape = Shape(
        initial=initial,
        final=Offset(
            vessel.centre,
            lambda w: offsets(motions, vessel.length, vessel.radius, w),
            lambda w: rotation_minimising(vessel.centre, w, seed).normal,
        ),
        length=vessel.length,
        inner=inner,
        outer=outer,
        shear=_shear(motions.twist, vessel.length, outer - inner),
        lumen=_lumen(motions.balloon, vessel, inner),
        lumen_is_outside=motions.balloon.fit > 0,
        seed=seed,
    )
    refuse_overlap(shape, 1.0)
    return shape


def refuse_overlap(shape: Shape, q: float) -> None:
    """Raise BadInput for a fold at q, and for turns that pass through each other, naming both places."""
    wall = coarse_wall(shape, q)
    points, w = wall.centre.along.curve[0], wall.w
    arc = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    near = crossing(points, arc, wall.h[..., 1].max(axis=0))
    if near is not None:
        places = " and ".join(f"{1e3 * w[k]:.4g}" for k in near)
        found = f"passes through itself at w = {places} mm"
        raise BadInput(f"the shape at q = {q:g}", found, "fewer turns, a smaller bend, or a thinner actuator")


def coarse_wall(shape: Shape, q: float, around: int = 64, along: int = 200) -> Wall:
    """Return bore and outer wall at q on a grid fine enough to see (angles closed: the first again last)."""
    radii = np.array([shape.inner, shape.outer])
    return shape.wall(q, radii, np.linspace(0, 2 * np.pi, around + 1), np.linspace(0, shape.length, along + 1))


def offsets(motions: Motions, length: float, radius: Curve | None, w: Array) -> Array:
    """Return the derivatives 0 to 3 of the final centreline's offsets along N1, N2, T: (4, n, 3) [m].

    radius: of the vessel, which a spiral needs.
    """
    spiral, bend = motions.spiral, motions.bend
    out = np.zeros((4, len(w), 3))
    if spiral.turns and radius is not None:
        rate = 2 * np.pi * spiral.turns / length
        reach = spiral.share * product(_envelope(spiral, w, length), radius(w, 3))
        out[..., 0] += product(reach, _cosine(rate, w, 0.0))
        out[..., 1] += product(reach, _cosine(rate, w, -np.pi / 2))
        out[0, :, 2] += spiral.offset
    side = np.zeros((4, len(w)))
    if bend.angle:
        rate = bend.angle / length
        side -= _cosine(rate, w, 0.0) / rate
        side[0] += 1 / rate
        out[..., 2] += _cosine(rate, w, -np.pi / 2) / rate
        out[:2, :, 2] -= np.stack([w, np.ones_like(w)])
    if bend.sway:
        side += bend.sway * _pieces([0.0, bend.straight, 1.0] if bend.straight else [0.0, 1.0], w, length)
    out[..., 0] += np.cos(bend.direction) * side
    out[..., 1] += np.sin(bend.direction) * side
    return out


def _cosine(rate: float, w: Array, phase: float) -> Array:
    """Return the derivatives 0 to 3 of cos(rate w + phase)."""
    return np.stack([rate**k * np.cos(rate * w + phase + k * np.pi / 2) for k in range(4)])


def _envelope(spiral: Spiral, w: Array, length: float) -> Array:
    if spiral.envelope == "smooth":
        return _pieces([0.0, spiral.blend, 1 - spiral.blend, 1.0], w, length)
    x = 15 * w / length
    g = 1 / (1 + x * x)
    slopes = np.stack([np.arctan(x), g, -2 * x * g**2, (6 * x * x - 2) * g**3])
    return np.asarray(slopes * ((15 / length) ** np.arange(4.0))[:, None] / np.sqrt(2))


def _pieces(knots: list[float], w: Array, length: float) -> Array:
    """Return derivatives of quintics over w / L: 0 and 1 in turn at the knots, flat there, C2.

    Two knots: from 0 to 1. Three: 0 up to the second, 1 at the last. Four: up, at 1, and down.
    """
    from scipy.interpolate import BPoly

    levels = {2: (0, 1), 3: (0, 0, 1), 4: (0, 1, 1, 0)}[len(knots)]
    if len(knots) == 4 and knots[1] == knots[2]:
        knots, levels = [*knots[:2], knots[3]], (0, 1, 0)
    made = BPoly.from_derivatives(knots, [[level, 0, 0] for level in levels])
    return np.stack([made(w / length, k) / length**k for k in range(4)])


def _shear(twist: Twist, length: float, wall: float) -> Callable[[Array, Array], Shear]:
    def shear(v: Array, w: Array) -> Shear:
        n, a, zero = twist.waves, twist.wave, 0 * (v + w)
        gamma = Slopes(
            twist.angle * w / length + a * np.sin(n * v), a * n * np.cos(n * v) + zero, twist.angle / length + zero
        )
        return Shear(gamma, Slopes(gamma.by_v, -a * n * n * np.sin(n * v) + zero, zero), twist.through / wall)

    return shear


def _lumen(balloon: Balloon, vessel: Vessel, inner: float) -> Callable[[Array, Array], Slopes]:
    if balloon.fit and (balloon.grow != 1 or balloon.bulge or balloon.lobe):
        raise BadInput("balloon", "has fit beside grow, bulge or lobe", "the bore follows from one of them")

    def outside(v: Array, w: Array) -> Slopes:
        radius, slope = balloon.fit * vessel.radius(w[0], 1)
        return Slopes(radius + 0 * v, 0 * (v + w), slope + 0 * v)

    def lumen(v: Array, w: Array) -> Slopes:
        n, length, x = balloon.lobes, vessel.length, np.pi * w / vessel.length
        swell, slope = np.sin(x) ** 2, np.pi / length * np.sin(2 * x)
        lobes = balloon.bulge + balloon.lobe * np.cos(n * v)
        return Slopes(
            inner * (balloon.grow + lobes * swell),
            inner * -n * balloon.lobe * np.sin(n * v) * swell,
            inner * lobes * slope,
        )

    return outside if balloon.fit else lumen
