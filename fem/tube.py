"""A pressurised tube of many materials: build it, inflate it, ask what came out."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data.errors import BadInput
from data.signal import Array
from fem import grid, symmetry, tube_grid
from fem.continuation import PRESSURE, Point, follow
from fem.element import Body, make_body
from fem.equilibrium import Newton, System
from fem.material import Law, NeoHooke, printable

if TYPE_CHECKING:
    from fem.accuracy import Accuracy

DISC = NeoHooke(c1=2000e6 / 2.7 / 2, nu=0.35, name="cap")  # E 2 GPa: a rigid plastic


def _uniform() -> Any:
    return np.full((32, 32), printable("Agilus30"), dtype=object)


@dataclass(frozen=True, kw_only=True, eq=False)
class Tube:
    """A tube of voxels (around, along) from z = 0, fixed there and closed at z = length; lengths in m.

    material: an array of laws, one a voxel, which may be assigned to: voxel [i, j] is the i-th
    anticlockwise from the x axis as seen from +z, the j-th from the base (data/pictures/directions.png
    shows it, with twist and bending). divisions: elements
    around, along and through the wall, multiples of the voxels. cap: thickness of an elastic end
    disc of cap_material, 0 for a rigid cap. order 1: hexahedra of 8 nodes with mean dilatation;
    2: of 20 nodes. reduced: solve for the smallest sector of which map and mesh are copies; what breaks
    that symmetry is then left out, of `stable` too. Raises BadInput for what makes no tube.
    """

    length: float
    outer_radius: float
    wall: float
    divisions: tuple[int, int, int] = (32, 32, 2)
    material: Any = field(default_factory=_uniform)
    cap: float = 0.0
    cap_material: Law = DISC
    order: int = 1
    newton: Newton = field(default_factory=Newton)
    reduced: bool = False

    def mesh(self) -> grid.Mesh:
        """Return the mesh."""
        if not isinstance(self.material, np.ndarray) or self.material.ndim != 2:
            raise BadInput("tube, material", f"is {type(self.material).__name__}", "expected an array (around, along)")
        voxels = self.material.shape
        return tube_grid.tube(
            self.length, self.outer_radius, self.wall, self.divisions, voxels=voxels, cap=self.cap, order=self.order
        )

    def body(self) -> Body:
        """Return the mesh with the materials as they are now. Raises BadInput for a voxel without a law."""
        laws: list[Law] = []
        number: dict[Law, int] = {}
        for law in (*self.material.ravel(), self.cap_material):
            if not isinstance(law, Law):
                raise BadInput("tube, material", f"has {law!r:.60}", "expected laws of fem.material in every voxel")
            if law not in number:
                number[law] = len(laws)
                laws.append(law)
        mesh = self.mesh()
        of_voxel = np.array([number[law] for law in (*self.material.ravel(), self.cap_material)], dtype=np.int32)
        return make_body(mesh, laws, of_voxel[mesh.part])  # the cap's part is -1: the last

    def inflate(self, loads: ArrayLike, control: str = PRESSURE) -> "Inflation":
        """Return the equilibria at exactly these loads (n,): pressures [Pa], or cavity volumes [m^3].

        Raises DidNotConverge where the path ends, see fem.continuation.follow.
        """
        body = self.body()
        system = System(body, self.newton, symmetry=symmetry.found(body, self.divisions[0]) if self.reduced else None)
        values: Iterable[float] = np.atleast_1d(np.asarray(loads, dtype=np.float64)).tolist()
        return Inflation(self, system, tuple(follow(system, values, control)), control)

    @property
    def rest_volume(self) -> float:
        """Cavity volume of the mesh at rest [m^3]."""
        body = self.body()
        return body.fluid(body.mesh.nodes)[1]


@dataclass(frozen=True, eq=False)
class Inflation:
    """A tube's equilibria, one a requested load; what is asked of them is computed then.

    Angles in rad, anticlockwise as seen from +z (the tip's side); lengths in m.
    """

    tube: Tube
    system: System
    points: tuple[Point, ...]
    control: str

    @property
    def solver(self) -> str:
        """The name of the linear solver."""
        return self.system.method

    @property
    def sector(self) -> str:
        """What was solved for: "" the whole tube, or the name of a symmetry's sector."""
        return "" if self.system.symmetry is None else self.system.symmetry.name

    @property
    def pressure(self) -> Array:
        """Pressures (n,) [Pa]."""
        return np.array([p.load for p in self.points])

    @property
    def volume(self) -> Array:
        """Cavity volumes (n,) [m^3]."""
        return np.array([p.volume for p in self.points])

    @property
    def energy(self) -> Array:
        """Strain energies (n,) [J]."""
        return np.array([p.energy for p in self.points])

    @property
    def stable(self) -> NDArray[np.bool_]:
        """Whether each is stable under its pressure (n,): no pivot is negative; for a sector, by its own motions."""
        return np.array([p.negative == 0 for p in self.points])

    @property
    def iterations(self) -> NDArray[np.int64]:
        """Corrections by Newton's method, spent to reach each load from the one before (n,)."""
        return np.array([p.iterations for p in self.points])

    def accuracy(self, index: int = -1) -> "Accuracy":
        """Return how far off the mesh makes one equilibrium; solves a better one, see fem.accuracy.estimate."""
        from fem.accuracy import estimate

        return estimate(self, index)

    @property
    def displacement(self) -> Array:
        """Nodal displacements (n, nodes, 3) [m]."""
        return np.stack([p.x for p in self.points]) - self.system.body.mesh.nodes

    @cached_property
    def _end(self) -> tuple[Array, Array]:
        """The end ring's mean displacement (n, 3), and the rotation that fits its motion best (n, 3, 3)."""
        mesh = self.system.body.mesh
        rest = mesh.nodes[mesh.ring]
        now = np.stack([p.x[mesh.ring] for p in self.points])
        mean = now.mean(axis=1)
        u, _, v = np.linalg.svd(np.einsum("nri,rj->nij", now - mean[:, None], rest - rest.mean(axis=0)))
        u[:, :, 2] *= np.sign(np.linalg.det(u @ v))[:, None]  # a plane ring leaves the third direction open
        return mean - rest.mean(axis=0), u @ v

    @property
    def twist(self) -> Array:
        """Best-fit rotation about z of the end ring, seen in the x-y plane (n,) [rad], followed past 180 deg."""
        mesh = self.system.body.mesh
        rest = mesh.nodes[mesh.ring, :2] - mesh.nodes[mesh.ring, :2].mean(axis=0)
        now = np.stack([p.x[mesh.ring, :2] for p in self.points])
        now = now - now.mean(axis=1, keepdims=True)
        sine = (rest[:, 0] * now[..., 1] - rest[:, 1] * now[..., 0]).sum(axis=1)
        return np.asarray(np.unwrap(np.append(0.0, np.arctan2(sine, (rest * now).sum(axis=(1, 2)))))[1:])

    @property
    def extension(self) -> Array:
        """Mean z displacement of the end ring (n,) [m]."""
        return self._end[0][:, 2]

    @property
    def bending(self) -> Array:
        """Angle between the end ring's axis and z (n,) [rad]."""
        axis = self._end[1][:, :, 2]
        return np.arctan2(np.hypot(axis[:, 0], axis[:, 1]), axis[:, 2])

    @property
    def bending_direction(self) -> Array:
        """Direction the end ring's axis leans to, from the x axis towards y (n,) [rad]."""
        axis = self._end[1][:, :, 2]
        return np.arctan2(axis[:, 1], axis[:, 0])

    @property
    def centreline(self) -> Array:
        """Mean positions of the rings of nodes, base to tip (n, along + 1, 3) [m]."""
        rings = self._rings()
        return np.stack([[p.x[ring].mean(axis=0) for ring in rings] for p in self.points])

    def _rings(self) -> list[NDArray[np.int64]]:
        nodes, length = self.system.body.mesh.nodes, self.tube.length
        size = len(self.system.body.mesh.ring)
        first = np.argsort(nodes[:, 2], kind="stable")
        heights = np.arange(self.tube.divisions[1] + 1) * length / self.tube.divisions[1]
        near = [first[np.abs(nodes[first, 2] - z) < 1e-6 * length] for z in heights]
        return [ring[np.argsort(ring)][:size] for ring in near]

    def stretch(self, index: int = -1) -> Array:
        """Return the largest principal stretch in each voxel at one load, (around, along)."""
        body = self.system.body
        return body.stretch(self.points[index].x, body.mesh.part).reshape(self.tube.material.shape)

    def overstretched(self, index: int = -1) -> NDArray[np.bool_]:
        """Return which voxels are stretched past their material's elongation at one load, (around, along)."""
        limits = np.array([law.elongation for law in self.tube.material.ravel()])
        return np.asarray(self.stretch(index) - 1 > limits.reshape(self.tube.material.shape))
