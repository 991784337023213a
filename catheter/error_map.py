"""Where a map of materials is wrong, voxel by voxel: in modulus, in displacement and in strain (thesis Fig. 6.18)."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from data.signal import Array

if TYPE_CHECKING:
    from catheter.reconstruction import Case
    from fem.grid import Indices
    from fem.voxels import Standing


@dataclass(frozen=True, eq=False)
class ErrorMap:
    """What one equilibrium has otherwise than another, in every voxel of a grid.

    modulus: relative; displacement [m]: the farthest of the voxel's nodes; strain: the largest Frobenius norm of the
    difference of the Green-Lagrange strains at the voxel's integration points.
    """

    modulus: Array
    displacement: Array
    strain: Array


def error_map(case: "Case", made: "Standing") -> ErrorMap:
    """Return where a map in equilibrium differs from the case's truth at its last pressure."""
    true, mesh, body = case.whole[-1], case.voxels.mesh, case.voxels.system.body
    apart = np.linalg.norm(made.state.x - true.state.x, axis=1)[mesh.hexes].max(axis=1)
    difference = _strain(body.deformation(made.state.x)) - _strain(body.deformation(true.state.x))
    strain = np.linalg.norm(difference, axis=(-2, -1)).max(axis=1)
    modulus = np.exp(made.log) / case.truth - 1
    return ErrorMap(
        modulus.reshape(case.grid),
        _most(apart, case.voxels.which, case.voxels.count).reshape(case.grid),
        _most(strain, case.voxels.which, case.voxels.count).reshape(case.grid),
    )


def _strain(deformation: Array) -> Array:
    return np.asarray((np.swapaxes(deformation, -1, -2) @ deformation - np.eye(3)) / 2)


def _most(by_element: Array, which: "Indices", count: int) -> Array:
    """Return the largest value of each voxel's elements (v,)."""
    found = np.zeros(count)
    np.maximum.at(found, which[which >= 0], by_element[which >= 0])
    return found
