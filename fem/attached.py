"""Places fixed to a tube's outer skin, such as markers glued to it: where they are when the nodes have moved.

Each belongs to an element of the outermost layer and stays at its place in that element's parent cube, a
little outside of it where the mesh's flat faces cut off the round: its motion is linear in the nodes'.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from data.errors import BadInput
from data.signal import Array
from fem.element import SIGNS, serendipity
from fem.grid import EDGES, Indices, Mesh, faces, skin

NEAR, TURNS = 9, 12  # elements tried for each place, and Newton steps towards it in each

BESIDE = 1.1  # how far along the skin a place may be beside its element, whose half width is 1


@dataclass(frozen=True, eq=False)
class Attached:
    """Places on a mesh's skin: rows (3m, 3n), sparse, give them from node positions; off (m,): from the skin [m]."""

    rows: Any
    off: Array

    def at(self, x: Array) -> Array:
        """Return the places (m, 3) [m] when the nodes are at x (n, 3)."""
        return np.asarray(self.rows @ x.ravel()).reshape(-1, 3)


def attached(mesh: Mesh, places: Array) -> Attached:
    """Return places (m, 3) [m] at rest as fixed to the outer skin of a tube's mesh.

    Raises BadInput for places of the wrong shape, and for a mesh without voxels outside.
    """
    if places.ndim != 2 or places.shape[1] != 3 or not np.isfinite(places).all():
        raise BadInput("places", f"have shape {places.shape}", "expected (m, 3), finite")
    layer = _outermost(mesh)
    near = min(NEAR, len(layer))
    middles = mesh.nodes[faces(mesh.hexes[layer], "w1")[:, :4]].mean(axis=1)
    far = np.linalg.norm(places[:, None] - middles, axis=-1)
    tried = layer[np.argpartition(far, near - 1, axis=1)[:, :near]]  # (m, near)
    corners = mesh.nodes[mesh.hexes[tried.ravel()]]
    wanted = np.repeat(places, near, axis=0)
    parent = _parent(corners, wanted, mesh.order)
    on = np.clip(parent, -1.0, 1.0)
    on[:, 0] = 1.0  # the parent cube's first axis leads outwards
    off = np.linalg.norm(_mapped(corners, on, mesh.order) - wanted, axis=1).reshape(-1, near)
    best = off.argmin(axis=1)
    one = np.arange(len(places)) * near + best
    inside = np.clip(parent[one], [-np.inf, -BESIDE, -BESIDE], [np.inf, BESIDE, BESIDE])
    shape, _ = serendipity(SIGNS, EDGES, inside, mesh.order)
    return Attached(_rows(mesh, mesh.hexes[tried.ravel()[one]], shape), off[np.arange(len(places)), best])


def _outermost(mesh: Mesh) -> Indices:
    """Return the elements of voxels whose outer face no other element shares."""
    alone = {tuple(one) for one in np.sort(skin(mesh)[0], axis=1).tolist()}
    outer = np.sort(faces(mesh.hexes, "w1")[:, :4], axis=1).tolist()
    found = np.flatnonzero([part >= 0 and tuple(one) in alone for part, one in zip(mesh.part, outer, strict=True)])
    if not len(found):
        raise BadInput("mesh", "has no voxel outside", "places are attached to a tube's wall")
    return found.astype(np.int32)


def _mapped(corners: Array, parent: Array, order: int) -> Array:
    """Return the points (p, 3) at parent coordinates (p, 3) of elements (p, a, 3)."""
    shape, _ = serendipity(SIGNS, EDGES, parent, order)
    return np.asarray(np.einsum("pa,pad->pd", shape, corners))


def _parent(corners: Array, places: Array, order: int) -> Array:
    """Return the parent coordinates (p, 3) of places (p, 3) in elements (p, a, 3), by Newton; kept near the cube."""
    parent = np.zeros_like(places)
    for _ in range(TURNS):
        shape, slope = serendipity(SIGNS, EDGES, parent, order)
        left = places - np.einsum("pa,pad->pd", shape, corners)
        turned = np.einsum("pad,pac->pcd", slope, corners)
        parent = np.clip(parent + np.linalg.solve(turned, left[..., None])[..., 0], -3.0, 3.0)
    return parent


def _rows(mesh: Mesh, hexes: Indices, shape: Array) -> Any:
    from scipy.sparse import csr_array

    count, nodes = shape.shape
    rows = np.repeat(3 * np.arange(count)[:, None] + np.arange(3), nodes, axis=0).reshape(count, nodes, 3)
    columns = 3 * hexes[..., None] + np.arange(3)
    values = np.broadcast_to(shape[..., None], columns.shape)
    return csr_array((values.ravel(), (rows.ravel(), columns.ravel())), shape=(3 * count, mesh.nodes.size))
