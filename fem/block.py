"""A block of many materials with chosen pressed and held faces: the thesis's cube."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from data.errors import BadInput, nearest
from data.signal import Array
from fem import grid
from fem.continuation import PRESSURE, Point, follow
from fem.element import Body, make_body
from fem.equilibrium import Newton, System
from fem.material import Law

FACES = {"x0": "v0", "x1": "v1", "y0": "w0", "y1": "w1", "z0": "u0", "z1": "u1"}


@dataclass(frozen=True, kw_only=True, eq=False)
class Block:
    """A block from the origin to sizes (x, y, z) [m], divisions elements along each.

    material: an array of laws (nx, ny, nz), whole groups of elements to a voxel. pressed, held,
    sliding: names of faces, x0 at x = 0 to z1; the fluid presses on the first, the second are
    fixed, the third may only slide in their plane. order 1: 8 nodes, 2: 20 nodes.
    """

    sizes: tuple[float, float, float]
    divisions: tuple[int, int, int]
    material: Any
    pressed: tuple[str, ...] = ()
    held: tuple[str, ...] = ()
    sliding: tuple[str, ...] = ()
    order: int = 1
    newton: Newton = field(default_factory=Newton)

    def __post_init__(self) -> None:
        """Check sizes, faces and voxels. Raises BadInput."""
        for name in (*self.pressed, *self.held, *self.sliding):
            if name not in FACES:
                raise BadInput("block, faces", f"{name!r} is unknown", nearest(name, FACES))
        if not all(size > 0 for size in self.sizes):
            raise BadInput("block, sizes", f"are {self.sizes}", "expected lengths > 0")
        voxels = getattr(self.material, "shape", ())
        if len(voxels) != 3 or any(d % v for d, v in zip(self.divisions, voxels, strict=True)):
            raise BadInput("block, material", f"has shape {voxels}", f"expected 3 divisors of {self.divisions}")

    def body(self) -> Body:
        """Return the mesh with the materials as they are now."""
        shape = grid.block(self.sizes, self.divisions, order=self.order)
        fixed = np.zeros(shape.nodes.shape, dtype=bool)
        for name in self.held:
            fixed[shape.face(FACES[name])] = True
        for name in self.sliding:
            fixed[shape.face(FACES[name]), "xyz".index(name[0])] = True
        count = 4 * self.order
        quads = [shape.face(FACES[name]).reshape(-1, count) for name in self.pressed]
        mesh = grid.solid(shape.nodes, shape.hexes, fixed, np.vstack(quads) if quads else None)
        z, x, y = np.indices(shape.hexes.shape[:3])
        groups = np.array(self.divisions) // np.array(self.material.shape)
        laws: list[Law] = self.material[x // groups[0], y // groups[1], z // groups[2]].ravel().tolist()
        kinds = list(dict.fromkeys(laws))
        number = {law: k for k, law in enumerate(kinds)}
        return make_body(mesh, kinds, np.array([number[law] for law in laws], dtype=np.int32))

    def press(self, pressures: ArrayLike) -> "Pressed":
        """Return the equilibria at these pressures (n,) [Pa]. Raises DidNotConverge where the path ends."""
        system = System(self.body(), self.newton)
        values = np.atleast_1d(np.asarray(pressures, dtype=np.float64)).tolist()
        return Pressed(self, system, tuple(follow(system, values, PRESSURE)))


@dataclass(frozen=True, eq=False)
class Pressed:
    """A block's equilibria, one a pressure."""

    block: Block
    system: System
    points: tuple[Point, ...]

    @property
    def displacement(self) -> Array:
        """Nodal displacements (n, nodes, 3) [m]."""
        return np.stack([p.x for p in self.points]) - self.system.body.mesh.nodes

    def face(self, name: str) -> Array:
        """Return the mean displacement of a face, such as "x1" (n, 3) [m]."""
        shape = grid.block(self.block.sizes, self.block.divisions, order=self.block.order)
        return np.asarray(self.displacement[:, np.unique(shape.face(FACES[name]))].mean(axis=1))
