"""Structured hexahedral meshes over any lattice of positions, blocks among them.

Hexahedra and quadrilaterals are ordered as VTK
orders them, with 8 and 4 nodes (order 1) or 20 and 8 (order 2). Pressed quadrilaterals are
anticlockwise as seen from the fluid.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput
from data.signal import Array

Indices = NDArray[np.int32]

CORNERS = np.array([(0, 0, 0), (0, 0, 1), (1, 0, 1), (1, 0, 0), (0, 1, 0), (0, 1, 1), (1, 1, 1), (1, 1, 0)])
EDGES = np.array([(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)])
SIDES = np.array([(0, 1), (1, 2), (2, 3), (3, 0)])
FACES = {  # corners of a hexahedron's faces in lattice directions, anticlockwise as seen from outside
    "u0": (0, 1, 5, 4),
    "u1": (2, 3, 7, 6),
    "v0": (0, 3, 2, 1),
    "v1": (4, 5, 6, 7),
    "w0": (0, 4, 7, 3),
    "w1": (1, 2, 6, 5),
}


@dataclass(frozen=True, eq=False)
class Mesh:
    """Nodes (n, 3) [m], hexes (e, 8 or 20), and what is held and pressed.

    part (e,) is the printable voxel an element belongs to, or -1 for a cap; pressed (q, 4 or 8);
    fixed (n, 3) says which components stay where they are; ring are the nodes whose motion is the
    mesh's twist and extension; tied are nodes that move as one rigid body, without any: empty.
    """

    nodes: Array
    hexes: Indices
    part: Indices
    pressed: Indices
    fixed: NDArray[np.bool_]
    ring: Indices
    tied: Indices

    @property
    def order(self) -> int:
        """1 for 8-node elements, 2 for 20-node ones."""
        return 1 if self.hexes.shape[1] == 8 else 2


@dataclass(frozen=True, eq=False)
class Lattice:
    """Elements (nu, nv, nw) over a lattice of positions: nodes (n, 3), hexes (nu, nv, nw, a), index of lattice points.

    index (U, V, W) is -1 where a lattice point carries no node (order 2: middles of faces and cells).
    """

    nodes: Array
    hexes: Indices
    index: Indices

    def face(self, name: str) -> Indices:
        """Return the quadrilaterals of a face of the lattice, such as "w0", seen from outside, (.., .., 4 or 8)."""
        at = ("uvw".index(name[0]), -int(name[1]))
        return faces(np.take(self.hexes, at[1], axis=at[0]), name)


def faces(hexes: Indices, name: str) -> Indices:
    """Return the face of that name of each hexahedron (..., 8 or 20), (..., 4 or 8), seen from outside."""
    corners = list(FACES[name])
    if hexes.shape[-1] == 8:
        return hexes[..., corners]
    edges = {frozenset(pair): 8 + k for k, pair in enumerate(EDGES.tolist())}
    middles = [edges[frozenset((corners[a], corners[b]))] for a, b in SIDES.tolist()]
    return hexes[..., corners + middles]


def lattice(positions: Array, order: int = 1, *, closed: bool = False) -> Lattice:
    """Return the mesh over positions (U, V, W, 3) [m], numbered v-layer by v-layer.

    closed: u runs around and meets itself. Order 2 takes every second point of each direction as
    a corner. Raises BadInput for an order or a number of points that makes no elements.
    """
    points = np.array(positions.shape[:3])
    cells = (points - [not closed, 1, 1]) // order
    whole = cells * order + [not closed, 1, 1]
    if order not in (1, 2) or (cells < 1).any() or (whole != points).any() or (closed and cells[0] < 3):
        raise BadInput("lattice", f"{tuple(points)} points of order {order}", "expected whole elements (3 around)")
    grid = np.indices(tuple(points))
    present = (grid % order).sum(axis=0) <= 1
    swept = np.full(points[[1, 0, 2]], -1, dtype=np.int32)  # v is the slowest, so that rings are numbered in turn
    swept[present.transpose(1, 0, 2)] = np.arange(present.sum())
    index = swept.transpose(1, 0, 2)
    nodes = positions.transpose(1, 0, 2, 3)[present.transpose(1, 0, 2)]
    offsets = CORNERS * order
    if order == 2:
        offsets = np.vstack([offsets, (offsets[EDGES[:, 0]] + offsets[EDGES[:, 1]]) // 2])
    base = np.indices(tuple(cells)) * order
    u, v, w = (base[d][..., None] + offsets[:, d] for d in range(3))
    return Lattice(nodes, index[u % points[0], v, w], index)


def merge(groups: list[Array], within: float) -> tuple[Array, list[Indices]]:
    """Return the nodes of all groups, those closer than `within` [m] taken as one, and each group's new numbers."""
    from scipy.spatial import cKDTree

    every = np.vstack(groups)
    first = np.arange(len(every))
    pairs = cKDTree(every).query_pairs(within, output_type="ndarray")
    np.minimum.at(first, pairs.max(axis=1), pairs.min(axis=1))
    kept, number = np.unique(first, return_inverse=True)
    return np.asarray(every[kept]), np.split(number.astype(np.int32), np.cumsum([len(g) for g in groups])[:-1])


def block(sizes: tuple[float, float, float], divisions: tuple[int, int, int], *, order: int = 1) -> Lattice:
    """Return a block from the origin, sizes and divisions (x, y, z) [m]: u runs along z, v along x, w along y.

    v, the slowest, is the x direction, so that a long block is numbered in slices.
    """
    counts = [n * order for n in divisions]
    x, y, z = (s * np.arange(n + 1) / n for s, n in zip(sizes, counts, strict=True))
    zz, xx, yy = np.meshgrid(z, x, y, indexing="ij")
    return lattice(np.stack([xx, yy, zz], axis=-1), order)


def solid(nodes: Array, hexes: Indices, fixed: NDArray[np.bool_], pressed: Indices | None = None) -> Mesh:
    """Return a mesh of one part without rings or rigid bodies; hexes (..., a), pressed (..., b), fixed (n, 3)."""
    hexes = hexes.reshape(-1, hexes.shape[-1]).astype(np.int32)
    count, none = 4 if hexes.shape[1] == 8 else 8, np.empty(0, dtype=np.int32)
    quads = np.empty((0, count), dtype=np.int32) if pressed is None else pressed.reshape(-1, count).astype(np.int32)
    return Mesh(nodes, hexes, np.zeros(len(hexes), dtype=np.int32), quads, fixed, none, none)


def skin(mesh: Mesh) -> tuple[Indices, Indices]:
    """Return the corners (q, 4) of the faces that one element has alone, seen from outside, and their parts (q,)."""
    corners = np.concatenate([faces(mesh.hexes, name)[:, :4] for name in FACES])
    part = np.tile(mesh.part, len(FACES))
    _, first, count = np.unique(np.sort(corners, axis=1), axis=0, return_index=True, return_counts=True)
    alone = np.sort(first[count == 1])
    return corners[alone], part[alone]
