"""Meshes of tubes and their caps.

Frames: a tube's axis is z, its base ring lies at z = 0, i counts elements anticlockwise from the x
axis as seen from +z, j along z from the base.
"""

import numpy as np

from data.errors import BadInput
from data.signal import Array
from fem.grid import Indices, Lattice, Mesh, lattice, merge


def tube_lattice(
    length: float, outer_radius: float, wall: float, divisions: tuple[int, int, int], order: int
) -> Lattice:
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
        raise BadInput(
            "tube",
            f"length {length:g}, outer radius {outer_radius:g}, wall {wall:g}, cap {cap:g} m",
            "expected 0 < wall < outer radius, 0 < length, 0 <= cap",
        )
    part = voxels_of(divisions, voxels)
    body = tube_lattice(length, outer_radius, wall, divisions, order)
    if not cap:
        return capped(body, part, order)
    nodes, hexes, lid = _disc(body, _rings(body.hexes), divisions, cap, order)
    return _closed(body, part, nodes, hexes, lid, np.empty(0, dtype=np.int32))


def capped(body: Lattice, part: Indices, order: int) -> Mesh:
    """Return a tube of any shape, its base ring fixed, its other end closed by a rigid cap.

    body: a lattice closed around its first axis; part (around, along, through): the voxel of each element.
    """
    nodes, lid = _rigid_lid(body, order)
    end = body.index[:, -1]
    tied = np.concatenate([end[end >= 0], np.arange(len(body.nodes), len(nodes))]).astype(np.int32)
    return _closed(body, part, nodes, _rings(body.hexes), lid, tied)


def _closed(  # noqa: PLR0917
    body: Lattice, part: Indices, nodes: Array, hexes: Indices, lid: Indices, tied: Indices
) -> Mesh:
    end, bore = body.index[:, -1], _rings(body.face("w0")[:, :, None])
    numbers = part.transpose(1, 0, 2).reshape(-1)
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
    spokes = (body.nodes[corners] + centre) / 2 if order == 2 else np.empty((0, 3))
    nodes = np.vstack([body.nodes, spokes, centre])  # the hub last: a rigid body's displacements are its last node's
    hub = np.full(len(corners), len(nodes) - 1)
    lid = np.stack([np.roll(corners, -1), corners, hub, hub], axis=1)  # seen from below, where the fluid is
    if order == 2:
        spoke = first + np.arange(len(corners))
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
    return np.asarray(np.clip(2 - np.abs((x + 4) % 8 - 4), -1, 1))
