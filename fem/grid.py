"""Structured hexahedral meshes: any lattice, tubes, caps, blocks.

Frames: a tube's axis is z, its base ring lies at z = 0, i counts elements anticlockwise from the x
axis as seen from +z, j along z from the base. Hexahedra and quadrilaterals are ordered as VTK
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


def tube_lattice(length: float, outer_radius: float, wall: float, divisions: tuple[int, int, int], order: int) -> Lattice:
    """Return the lattice of a straight tube, divisions (around, along, through the wall)."""
    around, along, through = (n * order for n in divisions)
    angle = 2 * np.pi * np.arange(around) / around
    radius = outer_radius - wall + wall * np.arange(through + 1) / through
    z = length * np.arange(along + 1) / along
    x, y = (f(angle)[:, None, None] * radius + 0 * z[:, None] for f in (np.cos, np.sin))
    return lattice(np.stack([x, y, np.broadcast_to(z[:, None], x.shape)], axis=-1), order, closed=True)


def voxels_of(divisions: tuple[int, int, int], voxels: tuple[int, int]) -> Indices:
    """Return the voxel i * along + j of each element of a tube, (around, along, through).

    Raises BadInput unless voxels are whole groups of elements.
    """
    if any(v < 1 or d % v for d, v in zip(divisions, voxels, strict=False)):
        raise BadInput("tube, divisions", f"are {divisions}", f"expected multiples of the {voxels} voxels")
    i, j, _ = np.indices(divisions, dtype=np.int32)
    return np.asarray(i * voxels[0] // divisions[0] * voxels[1] + j * voxels[1] // divisions[1], dtype=np.int32)


def tube(
    length: float,
    outer_radius: float,
    wall: float,
    divisions: tuple[int, int, int],
    *,
    voxels: tuple[int, int] = (32, 32),
    cap: float = 0.0,
    order: int = 1,
) -> Mesh:
    """Return a tube closed at z = length, its base ring fixed; lengths in m.

    divisions: elements (around, along, through the wall). cap: thickness of an elastic disc beyond
    the end that shares the end ring's nodes, or 0 for a rigid cap. Raises BadInput for sizes that
    make no tube.
    """
    if not 0 < wall < outer_radius or not length > 0 or not cap >= 0:
        raise BadInput("tube", f"length {length:g}, outer radius {outer_radius:g}, wall {wall:g}, cap {cap:g} m",
                       "expected 0 < wall < outer radius, 0 < length, 0 <= cap")
    part = voxels_of(divisions, voxels)
    body = tube_lattice(length, outer_radius, wall, divisions, order)
    end = body.index[:, -1]
    hexes, bore = _rings(body.hexes), _rings(body.face("w0")[:, :, None])
    numbers = part.transpose(1, 0, 2).reshape(-1)
    if cap:
        nodes, hexes, lid = _disc(body, hexes, divisions, cap, order)
        tied = np.empty(0, dtype=np.int32)
    else:
        nodes, lid = _rigid_lid(body, order)
        tied = np.concatenate([end[end >= 0], np.arange(len(body.nodes), len(nodes))]).astype(np.int32)
    fixed = np.zeros((len(nodes), 3), dtype=bool)
    fixed[body.index[:, 0][body.index[:, 0] >= 0]] = True
    numbers = np.append(numbers, np.full(len(hexes) - len(numbers), -1)).astype(np.int32)
    ring = np.sort(end[end >= 0]).astype(np.int32)
    return Mesh(nodes, hexes, numbers, np.vstack([bore, lid]).astype(np.int32), fixed, ring, tied)


def _rings(entities: Indices) -> Indices:
    """Return entities (u, v, w, a) as (e, a), ring after ring."""
    return entities.transpose(1, 0, 2, 3).reshape(-1, entities.shape[-1])


def _rigid_lid(body: Lattice, order: int) -> tuple[Array, Indices]:
    """Return the nodes with those of a fan of triangles that closes the end ring, and the fan's pressed faces."""
    rim = body.index[:, -1, 0]
    corners = rim[::order]
    first = len(body.nodes)
    centre = body.nodes[corners].mean(axis=0)
    nodes = np.vstack([body.nodes, centre])
    hub = np.full(len(corners), first)
    lid = np.stack([np.roll(corners, -1), corners, hub, hub], axis=1)  # seen from below, where the fluid is
    if order == 2:
        nodes = np.vstack([nodes, (body.nodes[corners] + centre) / 2])
        spoke = first + 1 + np.arange(len(corners))
        lid = np.hstack([lid, np.stack([rim[1::2], spoke, hub, np.roll(spoke, -1)], axis=1)])
    return nodes, lid


def rod(rim: Array, heights: Array, order: int, *, core: float = 0.55, collar: int = 1) -> list[Lattice]:
    """Return a square core and a collar that fill a disc inside rim points (u, 2), at heights (v,) [m].

    core: half the square's side over the radius; collar: elements from it to the rim. The rim
    begins at +x and runs anticlockwise. Raises BadInput unless it has a multiple of 8 elements.
    """
    around = len(rim) // order
    if around % 8:
        raise BadInput("disc", f"{around} elements around", "its square core needs a multiple of 8")
    side = around * order // 4
    half = core * float(np.hypot(*rim[0]))
    steps = half * (2 * np.arange(side + 1) / side - 1)
    inside = np.stack(np.meshgrid(steps, heights, steps, indexing="ij"), axis=-1)[..., [2, 0, 1]]
    # the core's border, point for point with the rim: from the middle of the side at +x, anticlockwise
    walk = np.arange(len(rim)) * 8 / len(rim)  # 8 half sides
    border = np.stack([_triangle(walk), _triangle(walk - 2)], axis=1) * half
    out = np.arange(collar * order + 1)[:, None] / (collar * order)
    flat = border[:, None] + out * (rim[:, None] - border[:, None])
    return [lattice(inside, order), lattice(raised(flat, heights), order, closed=True)]


def raised(flat: Array, heights: Array) -> Array:
    """Return positions (u, v, w, 3) of flat ones (u, w, 2) at heights (v,)."""
    out = np.empty((len(flat), len(heights), flat.shape[1], 3))
    out[..., :2] = flat[:, None]
    out[..., 2] = heights[:, None]
    return out


def _disc(
    body: Lattice, hexes: Indices, divisions: tuple[int, int, int], thickness: float, order: int
) -> tuple[Array, Indices, Indices]:
    """Return nodes, hexes and pressed faces of the tube with a disc, one element thick, beyond its end."""
    end = body.index[:, -1]
    bore = body.nodes[end[:, 0]]
    heights = bore[0, 2] + thickness * np.arange(order + 1) / order
    wall = body.nodes[np.maximum(end, 0), :2]  # where order 2 has no node, any position: nobody looks
    inner = rod(bore[:, :2], heights, order)
    parts = [*inner, lattice(raised(wall, heights), order, closed=True)]
    nodes, new = merge([body.nodes, *(p.nodes for p in parts)], 1e-7 * float(bore[0, 0]))
    elements = [_rings(number[p.hexes]) for number, p in zip(new[1:], parts, strict=True)]
    under = [number[p.face("v0")].reshape(-1, 4 * order) for number, p in zip(new[1:], inner, strict=False)]
    return nodes, np.vstack([new[0][hexes], *elements]).astype(np.int32), np.vstack(under)


def _triangle(x: Array) -> Array:
    """Return the height of a square's border over the walk along it: 1 for x in -1..1, down to -1 at 3..5."""
    return np.clip(2 - np.abs((x + 4) % 8 - 4), -1, 1)


def merge(groups: list[Array], within: float) -> tuple[Array, list[Indices]]:
    """Return the nodes of all groups, those closer than `within` [m] taken as one, and each group's new numbers."""
    from scipy.spatial import cKDTree

    every = np.vstack(groups)
    first = np.arange(len(every))
    pairs = cKDTree(every).query_pairs(within, output_type="ndarray")
    np.minimum.at(first, pairs.max(axis=1), pairs.min(axis=1))
    kept, number = np.unique(first, return_inverse=True)
    return every[kept], np.split(number.astype(np.int32), np.cumsum([len(g) for g in groups])[:-1])


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
