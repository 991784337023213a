"""The shapes a scene asks for: spiral, bend, twist and balloon in any mix, along a vessel or straight."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from catheter.centreline import Vessel
from catheter.curve import Offset, line, product
from catheter.frames import perpendicular, rotation_minimising
from catheter.shape import Shape, Shear, Slopes, Wall
from data.errors import BadInput
from data.options import option
from data.signal import Array
from fem.grid import Lattice, lattice

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
    """Return the shape. Raises BadInput for radii that make no tube, and for a fold at q = 1."""
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
        final=Offset(vessel.centre, _offsets(vessel, motions), lambda w: _normals(vessel, w, seed)),
        length=vessel.length,
        inner=inner,
        outer=outer,
        shear=_shear(motions.twist, vessel.length, outer - inner),
        lumen=_lumen(motions.balloon, vessel, inner),
        lumen_is_outside=motions.balloon.fit > 0,
        seed=seed,
    )
    coarse_wall(shape, 1.0)
    return shape


def coarse_wall(shape: Shape, q: float, around: int = 64, along: int = 200) -> Wall:
    """Return bore and outer wall at q on a grid fine enough to see (angles closed: the first again last)."""
    radii = np.array([shape.inner, shape.outer])
    return shape.wall(q, radii, np.linspace(0, 2 * np.pi, around + 1), np.linspace(0, shape.length, along + 1))


def _normals(vessel: Vessel, w: Array, seed: Array) -> Array:
    return rotation_minimising(vessel.centre, w, seed).normal


def _offsets(vessel: Vessel, motions: Motions) -> Callable[[Array], Array]:
    spiral, bend, length = motions.spiral, motions.bend, vessel.length

    def offsets(w: Array) -> Array:
        """Return the derivatives 0 to 3 of the offsets along N1, N2, T: (4, n, 3)."""
        out = np.zeros((4, len(w), 3))
        if spiral.turns:
            rate = 2 * np.pi * spiral.turns / length
            radius = spiral.share * product(_envelope(spiral, w, length), vessel.radius(w, 3))
            out[..., 0] += product(radius, _cosine(rate, w, 0.0))
            out[..., 1] += product(radius, _cosine(rate, w, -np.pi / 2))
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

    return offsets


def _cosine(rate: float, w: Array, phase: float) -> Array:
    """Return the derivatives 0 to 3 of cos(rate w + phase)."""
    return np.stack([rate**k * np.cos(rate * w + phase + k * np.pi / 2) for k in range(4)])


def _envelope(spiral: Spiral, w: Array, length: float) -> Array:
    if spiral.envelope == "smooth":
        return _pieces([0.0, spiral.blend, 1 - spiral.blend, 1.0], w, length)
    x = 15 * w / length
    g = 1 / (1 + x * x)
    slopes = np.stack([np.arctan(x), g, -2 * x * g**2, (6 * x * x - 2) * g**3])
    return slopes * ((15 / length) ** np.arange(4.0))[:, None] / np.sqrt(2)


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


@dataclass(frozen=True, eq=False)
class Target:
    """What an inverse solver is given: one lattice of nodes, undeformed and at q, in the frame of the base.

    Frame: origin on the initial centreline at w = 0, x along N1, y along N2, z along the tangent. A
    straight actuator's undeformed nodes are those of fem.tube_grid's tube, node for node. base [m]:
    the farthest a node of the base ring moves; a model whose base is held cannot follow that.
    """

    undeformed: Lattice
    deformed: Array
    q: float
    base: float


def target(shape: Shape, actuator: Actuator, q: float) -> Target:
    """Return both shapes on the lattice of an actuator's divisions (around, along, through). Raises BadInput."""
    order = 1 if actuator.nodes == "8" else 2
    rest, moved = (lattice(to_base(shape, positions(shape, actuator, x)), order, closed=True) for x in (0.0, q))
    ring = rest.index[:, 0]
    ring = ring[ring >= 0]
    base = np.linalg.norm(moved.nodes[ring] - rest.nodes[ring], axis=1).max()
    return Target(rest, moved.nodes, q, float(base))


def positions(shape: Shape, actuator: Actuator, q: float) -> Array:
    """Return positions (around, along, through, 3) of an actuator's lattice points in the vessel's frame [m]."""
    return on_lattice(shape, actuator, q).positions


def on_lattice(shape: Shape, actuator: Actuator, q: float) -> Wall:
    """Return the wall at q at an actuator's lattice points. Raises BadInput."""
    if len(actuator.divisions) != 3:
        raise BadInput("actuator, divisions", f"are {list(actuator.divisions)}", "expected around, along, through")
    order = 1 if actuator.nodes == "8" else 2
    around, along, through = (n * order for n in actuator.divisions)
    u = shape.inner + (shape.outer - shape.inner) * np.arange(through + 1) / through
    v = 2 * np.pi * np.arange(around) / around
    return shape.wall(q, u, v, shape.length * np.arange(along + 1) / along)


def to_base(shape: Shape, xyz: Array) -> Array:
    """Return positions (..., 3) of the vessel's frame in the frame of the actuator's base."""
    along = shape.centre(0.0, np.zeros(1)).along
    axes = np.stack([along.normal[0, 0], along.binormal[0, 0], along.tangent[0, 0]], axis=1)
    return np.asarray((xyz - along.curve[0, 0]) @ axes)


@dataclass(frozen=True, eq=False)
class Query:
    """A voxel: corners (2, 2, 2, 3) around, along, through [m] at rest and at q, and its middle's deformation.

    gradient, strain (3, 3): radial, around, along at rest; volume_ratio: det F; stretch: the largest
    principal one at the voxel's corners and middle.
    """

    voxel: tuple[int, int]
    q: float
    rest: Array
    moved: Array
    gradient: Array
    strain: Array
    volume_ratio: float
    stretch: float


def query(shape: Shape, actuator: Actuator, voxel: tuple[int, int], q: float) -> Query:
    """Return the deformation of voxel (i around, j along) through the whole wall. Raises BadInput."""
    counts = actuator.voxels
    if len(counts) != 2 or any(not 0 <= k < n for k, n in zip(voxel, counts, strict=True)):
        raise BadInput(f"voxel {voxel}", "is not there", f"the map has {counts} voxels (around, along), from 0")
    u, v, w = (
        np.linspace(low, high, 3)
        for low, high in (
            (shape.inner, shape.outer),
            (2 * np.pi * voxel[0] / counts[0], 2 * np.pi * (voxel[0] + 1) / counts[0]),
            (shape.length * voxel[1] / counts[1], shape.length * (voxel[1] + 1) / counts[1]),
        )
    )
    rest, moved = shape.wall(0.0, u, v, w), shape.wall(q, u, v, w)
    corners = np.ix_([0, 2], [0, 2], [0, 2])
    return Query(
        voxel,
        q,
        rest.positions[corners],
        moved.positions[corners],
        moved.gradient[1, 1, 1],
        moved.strain[1, 1, 1],
        float(moved.volume_ratio[1, 1, 1]),
        float(np.linalg.norm(moved.gradient, ord=2, axis=(-2, -1)).max()),
    )


def stretches(shape: Shape, actuator: Actuator, q: float) -> Array:
    """Return the largest principal stretch in the middle of each voxel, bore and outer wall: (around, along)."""
    around, along = actuator.voxels
    v, w = 2 * np.pi * (np.arange(around) + 0.5) / around, shape.length * (np.arange(along) + 0.5) / along
    wall = shape.wall(q, np.array([shape.inner, shape.outer]), v, w)
    return np.asarray(np.linalg.norm(wall.gradient, ord=2, axis=(-2, -1)).max(axis=-1))
