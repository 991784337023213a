"""The equilibrium gap: where the whole displacement is known, balance of forces there is linear in the moduli.

One sparse bounded least squares gives all of them: exact for exact data, brittle for noisy (relative
noise of 1e-3 destroys it), so a seed and not the method.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from data.errors import BadInput
from data.signal import Array
from fem.voxels import Voxels

MOST_TURNS = 50


@dataclass(frozen=True, eq=False)
class Gap:
    """Moduli (v,) [Pa], the forces left unbalanced over the load's, and which moduli a bound stopped."""

    moduli: Array
    unbalanced: float
    bounded: Array


def gap(voxels: Voxels, x: Array, pressure: float, least: float, most: float) -> Gap:
    """Return the moduli in bounds [Pa] that best balance a pressure [Pa] at positions x (n, 3) [m].

    Raises BadInput for positions of the wrong shape, or that turn an element inside out.
    """
    if x.shape != voxels.mesh.nodes.shape or not np.isfinite(x).all():
        raise BadInput("positions", f"have shape {x.shape}", f"expected {voxels.mesh.nodes.shape}, finite")
    forces = voxels.onto(x).T @ voxels.unit_forces(x)
    known = voxels.known_forces(x) + pressure * voxels.system.body.fluid(x)[0]
    load = voxels.onto(x).T @ known.ravel()
    moduli, bounded = bounded_least_squares(forces.tocsc(), -load, least, most)
    left = float(np.linalg.norm(forces @ moduli + load) / (np.linalg.norm(load) or 1.0))
    return Gap(moduli, left, bounded)


def bounded_least_squares(matrix: Any, right: Array, least: float, most: float) -> tuple[Array, Array]:
    """Return x (v,) in bounds with the least |matrix x - right|, and which are at a bound, by block pivoting.

    Portugal, Judice and Vicente, Mathematics of Computation 63 (1994): all unknowns that break a
    condition change side together; after three turns without fewer of them, one at a time.
    """
    from scipy.sparse.linalg import splu

    normal, slope = (matrix.T @ matrix).tocsc(), matrix.T @ right
    side = np.zeros(matrix.shape[1], dtype=int)  # -1: at least, 1: at most, 0: free
    x, fewest, patience = np.full(len(side), least), len(side) + 1, 3
    for _ in range(MOST_TURNS * 4):
        free = side == 0
        x = np.where(side < 0, least, np.where(side > 0, most, 0.0))
        if free.any():
            lu = splu(normal[free][:, free].tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
            x[free] = lu.solve(slope[free] - (normal @ x)[free])
            x[free] += lu.solve((matrix.T @ (right - matrix @ x))[free])
        gradient = matrix.T @ (matrix @ x - right)
        tiny = 1e-12 * np.abs(slope).max()
        wrong = np.where(free, (x > most * (1 + 1e-12)) * 1 - (x < least * (1 - 1e-12)), 0)
        back = ((side < 0) & (gradient < -tiny)) | ((side > 0) & (gradient > tiny))
        broken = np.flatnonzero((wrong != 0) | back)
        if not len(broken):
            break
        if len(broken) < fewest:
            fewest, patience = len(broken), 3
        elif patience:
            patience -= 1
        else:
            broken = broken[-1:]
        side[broken] = wrong[broken]
    return np.clip(x, least, most), side != 0
