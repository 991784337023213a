"""Points along a line: put in order, repeated ones dropped, and crossings found."""

import numpy as np

from data.errors import BadInput
from data.signal import Array

MOST_SORTED = 3000  # points


def repaired(xyz: Array, radius: Array, place: str) -> tuple[Array, Array, list[str]]:
    """Return points and radii in order, without repeated ones, and what was done. Raises BadInput."""
    notes = []
    kept = np.append(True, np.linalg.norm(np.diff(xyz, axis=0), axis=1) > 1e-9 * np.ptp(xyz, axis=0).max(initial=0.0))
    if not kept.all():
        notes.append(f"{int((~kept).sum())} repeated point(s) dropped.")
    xyz, radius = xyz[kept], radius[kept]
    if len(xyz) < 4:
        raise BadInput(place, f"has {len(xyz)} different points", "a smooth centreline needs 4")
    if not _in_order(xyz):
        order = _path_through(xyz)
        if order is None or not _in_order(xyz[order]):
            found = "has points out of order that follow no single line"
            raise BadInput(place, found, "order them along the vessel, one branch, and sample it evenly")
        if np.argmin(np.abs(order)) > len(order) / 2:  # begin at the end nearer to the first point given
            order = order[::-1]
        xyz, radius = xyz[order], radius[order]
        notes.append("The points were out of order: sorted along the line.")
    return xyz, radius, notes


def _in_order(xyz: Array) -> bool:
    """Return whether no step turns back."""
    steps = np.diff(xyz, axis=0)
    return bool(((steps[1:] * steps[:-1]).sum(axis=1) > 0).all())


def _path_through(xyz: Array) -> "Array | None":
    """Return the order of points along their minimum spanning tree, None where it branches."""
    from scipy.sparse.csgraph import depth_first_order, minimum_spanning_tree
    from scipy.spatial.distance import cdist

    if len(xyz) > MOST_SORTED:
        return None
    distance = cdist(xyz, xyz)
    if (distance + np.eye(len(xyz)) == 0).any():  # a point visited twice would be no edge of the tree
        return None
    tree = minimum_spanning_tree(distance)
    neighbours = np.bincount(np.concatenate(tree.nonzero()), minlength=len(xyz))
    if neighbours.max() > 2:
        return None
    return np.asarray(depth_first_order(tree, int(np.argmin(neighbours)), directed=False)[0])


def crossing(xyz: Array, w: Array, radius: Array) -> tuple[int, int] | None:
    """Return two stations of a tube whose walls overlap though they are no neighbours, the nearest pair, or None.

    Neighbours are those within half a circle of their radii along the line: as near as a tube may bend.
    """
    from scipy.spatial.distance import cdist

    sums = radius[:, None] + radius
    room = cdist(xyz, xyz) - sums
    room[np.abs(w[:, None] - w) <= np.pi / 2 * sums * (1 + 1e-3)] = np.inf
    at = np.unravel_index(int(np.argmin(room)), room.shape)
    return (int(at[0]), int(at[1])) if room[at] < 0 else None
