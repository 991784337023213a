"""Which voxels the data determine: singular values, and the posterior standard deviation of each log modulus."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.signal import Array
from fem.inverse import Inversion, Problem, Reconstruction

HALF = 0.5  # a voxel is determined where data halve the variance that its neighbours alone would leave


@dataclass(frozen=True, eq=False)
class Determined:
    """singular (v,): of the misfits' slope over log moduli, descending; sd (v,): of log moduli, given data and prior.

    seen (v,): whether the data, more than the prior, say what a voxel is.
    """

    singular: Array
    sd: Array
    seen: NDArray[np.bool_]


def determined(problem: Problem, found: Reconstruction, pairs: Any, options: Inversion) -> Determined:
    """Return what the data determine of a map, misfits and prior quadratic around it.

    Neighbours' differences are taken as normal, with the variance of the variation's prior, 2 prior^2: the
    variation's own curvature, infinite on a flat map, would call everything known.

    Data without noise are taken to be off by what is left of the misfit, or 1e-9 of the largest value seen.
    """
    slope = problem.slope(found.standings)
    curvature = slope.T @ slope
    noise = max(found.noise, found.misfit if not found.noise else 0.0, 1e-9)
    prior = np.asarray((pairs.T @ pairs).toarray()) / (2 * options.prior**2)
    prior[np.diag_indices(len(prior))] += 1 / np.log(options.most / options.least) ** 2  # the bounds' own width
    data = curvature / noise**2
    inverse = np.linalg.inv(data + prior)
    share = np.einsum("ij,ji->i", inverse, data)  # of each log modulus, what the data rather than the prior say
    singular = np.zeros(len(prior))
    known = np.linalg.svd(np.linalg.qr(slope, mode="r"), compute_uv=False)
    singular[: len(known)] = known
    return Determined(singular, np.sqrt(np.diag(inverse)), share > HALF)
