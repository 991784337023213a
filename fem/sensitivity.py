"""How equilibrium positions change with the voxels' moduli: S = -K_T^-1 dF/dE, exact, without a sum over load steps.

A hyperelastic body has no memory: the converged tangent (follower pressure included) and the forces per
unit of modulus are all there is to it; the thesis's sum over load steps (6.24) and its lambda I (6.26)
are not needed.
"""

from typing import Any

import numpy as np

from data.signal import Array
from fem.voxels import Standing, Voxels

BLOCK = 1024  # right-hand sides solved together: bounds the memory


def direct(voxels: Voxels, standing: Standing, rows: Any) -> Array:
    """Return d(rows . positions) / d(log moduli) (k, v) for rows (k, 3n): one solve for each voxel."""
    slopes, seen = voxels.slopes(standing), rows @ voxels.onto(standing.state.x)
    out = np.empty((seen.shape[0], voxels.count))
    for first in range(0, voxels.count, BLOCK):
        part = slopes[:, first : first + BLOCK].toarray(order="F")
        out[:, first : first + BLOCK] = -(seen @ standing.tangent.solve(part))
    return out


def adjoint(voxels: Voxels, standing: Standing, rows: Any) -> Array:
    """Return the same (k, v): one solve for each row, for few observations or a gradient alone."""
    seen = rows @ voxels.onto(standing.state.x)
    right = seen.toarray() if hasattr(seen, "toarray") else np.asarray(seen)
    return np.asarray(-(voxels.slopes(standing).T @ standing.tangent.solve_transposed(right.T.copy())).T)


def sensitivity(voxels: Voxels, standing: Standing, rows: Any) -> Array:
    """Return d(rows . positions) / d(log moduli) (k, v) by whichever way needs fewer solves."""
    return (direct if voxels.count <= rows.shape[0] else adjoint)(voxels, standing, rows)
