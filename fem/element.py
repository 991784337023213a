"""Hexahedra: shape functions, reference gradients, and the body whose forces and tangents they give.

Order 1 is the trilinear hexahedron with mean dilatation (Q1P0), order 2 the 20-node serendipity
hexahedron with 2 x 2 x 2 points.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from data.errors import BadInput, DidNotConverge
from data.signal import Array
from fem import kernel
from fem.grid import CORNERS, EDGES, SIDES, Indices, Mesh
from fem.material import PARAMETERS, Law

SIGNS = 2.0 * CORNERS[:, [2, 0, 1]] - 1  # of the corners in the parent cube's axes (w, u, v), right-handed
SQUARE = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])


def serendipity(corners: Array, pairs: Indices, at: Array, order: int) -> tuple[Array, Array]:
    """Return shape functions (p, a) and their gradients (p, a, d) in the parent square or cube.

    corners (c, d) of signs, pairs (m, 2) the corners beside each middle node, at (p, d) points.
    """
    signs = corners if order == 1 else np.vstack([corners, (corners[pairs[:, 0]] + corners[pairs[:, 1]]) / 2])
    middle = (signs == 0).any(axis=1)
    linear = np.where(signs == 0, 1 - at[:, None] ** 2, (1 + signs * at[:, None]))
    slope = np.where(signs == 0, -2 * at[:, None], np.broadcast_to(signs, linear.shape))
    d = corners.shape[1]
    scale = np.where(middle, 2.0 ** (1 - d), 2.0**-d)
    shape = scale * linear.prod(axis=-1)
    others = [np.delete(linear, k, axis=-1).prod(axis=-1) for k in range(d)]
    gradient = scale[:, None] * np.stack([slope[..., k] * others[k] for k in range(d)], axis=-1)
    if order == 2:  # a corner's function vanishes at the middles beside it
        for c in range(len(corners)):
            beside = len(corners) + np.flatnonzero((pairs == c).any(axis=1))
            shape[:, c] -= shape[:, beside].sum(axis=1) / 2
            gradient[:, c] -= gradient[:, beside].sum(axis=1) / 2
    return shape, gradient


def gauss(count: int, dimensions: int) -> tuple[Array, Array]:
    """Return Gauss points (count^d, d) and weights of the parent square or cube."""
    points, weights = np.polynomial.legendre.leggauss(count)
    at = np.stack(np.meshgrid(*[points] * dimensions, indexing="ij"), axis=-1).reshape(-1, dimensions)
    return at, np.stack(np.meshgrid(*[weights] * dimensions, indexing="ij"), axis=-1).reshape(len(at), -1).prod(axis=1)


@dataclass(frozen=True, eq=False)
class Pattern:
    """Where node pairs stand: block rows start (n+1,), columns column (s,), element and face slots."""

    start: Indices
    column: Indices
    element: Indices
    face: Indices


def pattern(count: int, hexes: Indices, quads: Indices) -> Pattern:
    """Return the node pairs that share an element or a pressed face, row by row, columns ascending."""
    groups = [hexes, quads]
    pairs = [np.repeat(g, g.shape[1], axis=1).astype(np.int64) * count + np.tile(g, (1, g.shape[1])) for g in groups]
    kept, slots = np.unique(np.concatenate([p.ravel() for p in pairs]), return_inverse=True)
    start = np.searchsorted(kept, np.arange(count + 1, dtype=np.int64) * count)
    element, face = np.split(slots.astype(np.int32), [pairs[0].size])
    return Pattern(
        start.astype(np.int32),
        (kept % count).astype(np.int32),
        element.reshape(*hexes.shape, hexes.shape[1]),
        face.reshape(*quads.shape, quads.shape[1]),
    )


@dataclass(frozen=True, eq=False)
class Body:
    """A mesh with its materials as the kernels want them; law (e,), numbers (e, 6), kappa (e,) [Pa].

    gradient (e, g, a, 3) [1/m] and weight (e, g) [m^3] of the rest state; shape, along and
    face_weight those of pressed faces, share (q,) how often each counts; volumes are counted from
    origin; softest: least shear modulus [Pa].
    """

    mesh: Mesh
    law: Indices
    numbers: Array
    kappa: Array
    gradient: Array
    weight: Array
    shape: Array
    along: Array
    face_weight: Array
    pattern: Pattern
    origin: Array
    softest: float
    share: Array

    @property
    def mean(self) -> bool:
        """Whether the volumetric measure is an element's mean (order 1)."""
        return self.mesh.order == 1

    @cached_property
    def noise(self) -> float:
        """Norm of the forces [N] that rounding of the positions makes, through the volumetric stiffness."""
        size = np.linalg.norm(self.gradient, axis=-1)
        far = np.abs(self.mesh.nodes[self.mesh.hexes]).max(axis=(1, 2))
        strain = np.finfo(float).eps * far * size.sum(axis=2).mean(axis=1)
        reach = np.einsum("eg,ega->ea", self.weight, size)
        return float(np.linalg.norm((self.kappa * strain)[:, None] * reach))

    def forces(self, x: Array, held: Array | None = None) -> "Forces":
        """Return the state at positions x (n, 3); held (e, g, 7) are the tangent's stresses, None: no tangent.

        Raises Inverted naming the element whose volume ratio is not positive.
        """
        entries = 0 if held is None else len(self.pattern.column)
        force, carried, stiffness = np.zeros_like(x), np.zeros_like(x), np.zeros((entries, 3, 3))
        bad, energy = kernel.assemble(
            x,
            self.mesh.hexes,
            self.gradient,
            self.weight,
            self.law,
            self.numbers,
            self.kappa,
            self.mean,
            np.zeros((1, 1, 7)) if held is None else held,
            self.pattern.element,
            force,
            carried,
            stiffness,
        )
        if bad >= 0:
            raise Inverted(f"element {bad} is turned inside out")
        return Forces(force, carried, stiffness, float(energy))

    def fluid(self, x: Array, pressure: float = 0.0, stiffness: Array | None = None) -> tuple[Array, float]:
        """Return -dV/dx (n, 3) [m^2] and the volume V [m^3] of the pressed cavity.

        Adds pressure times the slope of the first to stiffness where that is given.
        """
        area = np.zeros_like(x)
        volume = kernel.press(
            x,
            self.mesh.pressed,
            self.shape,
            self.along,
            self.face_weight,
            self.share,
            self.origin,
            pressure,
            self.pattern.face,
            area,
            np.zeros((0, 3, 3)) if stiffness is None else stiffness,
        )
        return area, float(volume)

    def linearised(self, x: Array, step: Array) -> Array:
        """Return the stresses (e, g, 7) [Pa] that a tangent after a step (n, 3) from x is to hold."""
        return np.asarray(sum(self.stresses(x, step)))

    def stresses(self, x: Array, step: Array) -> tuple[Array, Array]:
        """Return the stresses (e, g, 7) [Pa] that a tangent at x (n, 3) holds, and their change with a step (n, 3)."""
        out, mesh = np.empty((2, *self.weight.shape, 7)), self.mesh
        kernel.linearised(
            x, step, mesh.hexes, self.gradient, self.weight, self.law, self.numbers, self.kappa, self.mean, out
        )
        return out[0], out[1]

    def deformation(self, x: Array) -> Array:
        """Return the deformation gradients (e, g, 3, 3)."""
        return np.asarray(np.einsum("eai,egaj->egij", x[self.mesh.hexes], self.gradient))

    def stretch(self, x: Array, which: Indices) -> Array:
        """Return the largest principal stretch in each voxel (v,); which (e,): an element's voxel, -1 for none."""
        largest = np.linalg.norm(self.deformation(x), ord=2, axis=(-2, -1)).max(axis=1)
        out = np.zeros(int(which.max()) + 1)
        inside = which >= 0
        np.maximum.at(out, which[inside], largest[inside])
        return out


class Inverted(DidNotConverge):
    """A trial state with an element turned inside out."""


@dataclass(frozen=True, eq=False)
class Forces:
    """Internal forces (n, 3) [N], node-pair stiffness blocks (s, 3, 3) [N/m] and strain energy [J].

    carried (n, 3) are the forces of the stresses that the tangent holds, 0 without a tangent.
    """

    force: Array
    carried: Array
    stiffness: Array
    energy: float


def make_body(mesh: Mesh, materials: Sequence[Law], which: Indices) -> Body:
    """Return a mesh's body; which (e,) says for each element which of the materials it is.

    Raises BadInput for an element whose rest shape is turned inside out, or materials missing.
    """
    if which.shape != (len(mesh.hexes),) or which.min() < 0 or which.max() >= len(materials):
        raise BadInput("body, which", f"{which.shape}, up to {which.max()}", f"expected ({len(mesh.hexes)},)")
    at, weights = gauss(2, 3)
    parent = serendipity(SIGNS, EDGES, at, mesh.order)[1]
    jacobian = np.einsum("eai,gak->egik", mesh.nodes[mesh.hexes], parent)
    determinant = np.linalg.det(jacobian)
    if not (determinant > 0).all():
        bad = int(np.argmin(determinant.min(axis=1)))
        raise BadInput(
            f"element {bad}", f"has a Jacobian of {determinant[bad].min():.3g} m^3", "order its nodes as VTK"
        )
    gradient = np.ascontiguousarray(np.einsum("gak,egki->egai", parent, np.linalg.inv(jacobian)))
    square, face_weights = gauss(mesh.order + 1, 2)
    shape, along = serendipity(SQUARE, SIDES, square, mesh.order)
    numbers = np.zeros((len(materials), PARAMETERS))
    for row, law in zip(numbers, materials, strict=True):
        row[: len(law.numbers())] = law.numbers()
    held = mesh.nodes[mesh.fixed.all(axis=1)]
    return Body(
        mesh,
        np.array([law.code for law in materials], dtype=np.int32)[which],
        numbers[which],
        np.array([law.kappa for law in materials])[which],
        gradient,
        determinant * weights,
        shape,
        along,
        face_weights,
        pattern(len(mesh.nodes), mesh.hexes, mesh.pressed),
        held.mean(axis=0) if len(held) else np.zeros(3),
        min(law.shear for law in materials),
        np.ones(len(mesh.pressed)),
    )
