"""A shape on a lattice: nodes for an inverse solver, and the deformation of any voxel."""

from dataclasses import dataclass

import numpy as np

from catheter.motions import Actuator
from catheter.shape import Shape, Wall
from data.errors import BadInput
from data.signal import Array
from fem.grid import Lattice, lattice


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
