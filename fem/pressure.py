"""What a pressed surface is: a closed cavity, one that slides in planes, or one with an open rim."""

from typing import Any

import numpy as np

from fem.grid import Mesh


def rim(mesh: Mesh) -> Any:
    """Return the pressed surface's free edges (r, 2), node numbers."""
    quads = mesh.pressed[:, :4].astype(np.int64)
    sides = np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2)
    edges, counts = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)
    return edges[(counts == 1) & (edges[:, 0] != edges[:, 1])]


def closed(mesh: Mesh) -> bool:
    """Return whether the surface ends on fixed nodes only: its volume then is a potential of the pressure."""
    return len(mesh.pressed) > 0 and bool(mesh.fixed[rim(mesh)].all())


def symmetric(mesh: Mesh) -> bool:
    """Return whether the pressure's tangent is symmetric: every free edge is fixed, or slides in its plane.

    An edge adds p/6 (dx x dl) . dy and the like, which vanishes where all three lie in one plane.
    """
    edges = rim(mesh)
    ends, fixed = mesh.nodes[edges], mesh.fixed[edges]
    level = np.abs(ends[:, 0] - ends[:, 1]) < 1e-9 * np.ptp(mesh.nodes, axis=0).max()
    return bool((fixed.all(axis=(1, 2)) | (fixed.all(axis=1) & level).any(axis=1)).all())
