"""What a mesh and its materials repeat: turns about z, or a mirror that holds z. Then a sector says it all.

Elements of which one is the other's image make the same energy: one of each such orbit is assembled,
weighted by their number. Nodes follow one of their orbit: position = matrix times its position. A
solution found so has the symmetry; motions that break it are neither found nor counted in its stability.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.signal import Array
from fem.element import Body, pattern

Integers = NDArray[np.int64]
CLOSE = 1e-7  # of the body's extent: nodes no farther apart are the same


@dataclass(frozen=True, eq=False)
class Symmetry:
    """A group of matrices (g, 3, 3), the first the identity, and where they take nodes (g, n) and elements (g, e)."""

    name: str
    matrices: Array
    nodes: Integers
    elements: Integers
    faces: Integers

    def sector(self, body: Body) -> Body:
        """Return the body of one element and one pressed face of each orbit, weighted by the orbit's size."""
        kept, times = np.unique(self.elements.min(axis=0), return_counts=True)
        faces, share = np.unique(self.faces.min(axis=0), return_counts=True)
        mesh = replace(
            body.mesh, hexes=body.mesh.hexes[kept], part=body.mesh.part[kept], pressed=body.mesh.pressed[faces]
        )
        return replace(
            body,
            mesh=mesh,
            law=body.law[kept],
            numbers=body.numbers[kept],
            kappa=body.kappa[kept],
            gradient=body.gradient[kept],
            weight=body.weight[kept] * times[:, None],
            pattern=pattern(len(mesh.nodes), mesh.hexes, mesh.pressed),
            share=share.astype(np.float64),
        )

    def average(self, forces: Array) -> Array:
        """Return the forces on all nodes (n, 3) whose sector has these."""
        out = np.zeros_like(forces)
        for matrix, nodes in zip(self.matrices, self.nodes, strict=True):
            out[nodes] += forces @ matrix.T / len(self.matrices)
        return out

    def basis(self, moves: NDArray[np.bool_], place: Integers) -> tuple[Any, Integers]:
        """Return what displacements (3n,) unknowns make, sparse (3n, k), and each unknown's node (k,).

        moves (n,): nodes that are unknown at all; place (n,): the order of the nodes.
        """
        from scipy.sparse import csr_array

        first = self.nodes.min(axis=0)
        by = np.argmax(self.nodes[:, first] == np.arange(len(first)), axis=0)
        rows, columns, values, of = [], [], [], list[int]()
        followers = np.argsort(first, kind="stable")
        starts = np.searchsorted(first[followers], np.arange(len(first) + 1))
        leaders = np.flatnonzero((first == np.arange(len(first))) & moves)
        for node in leaders[np.argsort(place[leaders])]:
            free = invariant(self.matrices[self.nodes[:, node] == node])
            for other in followers[starts[node] : starts[node + 1]]:
                block = self.matrices[by[other]] @ free
                rows.append(np.repeat(3 * other + np.arange(3), free.shape[1]))
                columns.append(np.tile(len(of) + np.arange(free.shape[1]), 3))
                values.append(block.ravel())
            of += [int(node)] * free.shape[1]
        shape = (3 * len(first), len(of))
        made = csr_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=shape)
        return made, np.array(of)

    @cached_property
    def cap(self) -> Array:
        """The rigid cap's motions (6, r) that have the symmetry: displacements, then turns."""
        signs = np.linalg.det(self.matrices)[:, None, None]  # a mirror turns a turn round
        moves, turns = invariant(self.matrices), invariant(self.matrices * signs)
        out = np.zeros((6, moves.shape[1] + turns.shape[1]))
        out[:3, : moves.shape[1]], out[3:, moves.shape[1] :] = moves, turns
        return out


def invariant(matrices: Array) -> Array:
    """Return an orthonormal basis (3, r) of the vectors that all matrices of a group leave as they are."""
    values, vectors = np.linalg.eigh(matrices.mean(axis=0))
    return np.asarray(vectors[:, values > 0.5])


def turn(angle: float) -> Array:
    """Return the rotation (3, 3) about z by an angle [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def mirror(angle: float) -> Array:
    """Return the mirror (3, 3) at the plane through z and the direction at an angle [rad] from x."""
    return np.asarray(turn(2 * angle) @ np.diag([1.0, -1.0, 1.0]))


def found(body: Body, around: int) -> Symmetry | None:
    """Return the largest symmetry of a tube of that many elements around: turns, else a mirror; None: it has none."""
    for folds in range(around, 1, -1):
        once = _images(body, turn(2 * np.pi / folds)) if around % folds == 0 else None
        if once is not None:
            powers = [tuple(np.arange(len(one)) for one in once)]
            for _ in range(folds - 1):
                powers.append(tuple(one[last] for one, last in zip(once, powers[-1], strict=True)))
            matrices = np.stack([turn(2 * np.pi * k / folds) for k in range(folds)])
            return Symmetry(f"1 of {folds} sectors", matrices, *(np.stack(p) for p in zip(*powers, strict=True)))
    for half in range(2 * around):
        plane = mirror(np.pi * half / around / 2)
        once = _images(body, plane)
        if once is not None:
            both = [np.stack([np.arange(len(one)), one]) for one in once]
            degrees = 90.0 * half / around
            return Symmetry(f"half, mirrored at {degrees:g} deg", np.stack([np.eye(3), plane]), *both)
    return None


def _images(body: Body, matrix: Array) -> tuple[Integers, Integers, Integers] | None:
    """Return where a matrix takes nodes, elements and pressed faces; None where it does not take all to their like."""
    from scipy.spatial import cKDTree

    mesh = body.mesh
    within = CLOSE * float(np.ptp(mesh.nodes, axis=0).max())
    out = []
    for points in (mesh.nodes[mesh.hexes].mean(axis=1), mesh.nodes, mesh.nodes[mesh.pressed].mean(axis=1)):
        away, image = (np.asarray(part) for part in cKDTree(points).query(points @ matrix.T))
        if len(points) and (away.max() > within or len(np.unique(image)) < len(points)):
            return None
        out.append(image.astype(np.int64))
        if len(out) == 1:
            alike = (body.law[image] == body.law) & (body.kappa[image] == body.kappa)
            if not (alike.all() and (body.numbers[image] == body.numbers).all()):
                return None
    elements, nodes, faces = out
    kept = (mesh.fixed[nodes] == mesh.fixed).all() and np.isin(nodes[mesh.tied], mesh.tied).all()
    return (nodes, elements, faces) if kept else None
