"""The same misfit and variation by gradients alone: L-BFGS-B with the adjoint, beside Gauss-Newton."""

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from data.errors import DidNotConverge
from data.signal import Array
from fem.inverse import Inversion, Iteration, Problem
from fem.observation import Observation
from fem.regular import Variation
from fem.sensitivity import adjoint
from fem.voxels import Voxels


def gradient(problem: Problem, standings: Sequence[Any]) -> Array:
    """Return d(sum of squared misfits) / d(log moduli) (v,): one solve a pressure."""
    total = np.zeros(problem.voxels.count)
    for scale, one in zip(problem.scale, problem.observations, strict=True):
        standing = problem.at(standings, one)
        row = 2 * scale**2 * (one.slope(standing.state.x).T @ one.misfit(standing.state.x))
        total += adjoint(problem.voxels, standing, np.asarray(row)[None])[0]
    return total


def descend(  # noqa: PLR0917, as fem.inverse.reconstruct
    voxels: Voxels,
    observations: Sequence[Observation],
    seed: Array,
    variation: Any,
    options: Inversion | None = None,
    progress: Callable[[Iteration], None] | None = None,
) -> Array:
    """Return moduli (v,) [Pa] by L-BFGS-B from a seed; arguments as fem.inverse.reconstruct.

    The variation's weight is the noise's variance over the prior from the start, 0 for exact data. A map that
    does not bear the pressure counts as a misfit ten times the seed's.
    """
    from scipy.optimize import minimize

    options = options or Inversion()
    problem, prior = Problem(voxels, list(observations)), Variation(variation, options.edge)
    weight = (1.0 if problem.noisy else 0.0) / options.prior
    low, high = np.log(options.least), np.log(options.most)
    started = time.perf_counter()
    standings, _ = problem.start(np.log(np.clip(seed, options.least, options.most)), high)
    first = float((problem.misfit(standings) ** 2).sum())
    known, count = list(standings), 0

    def value(log: Array) -> tuple[float, Array]:
        nonlocal known
        try:
            known = problem.moved(known, log)
        except DidNotConverge:
            return 10 * first, np.zeros(len(log))
        misfit = problem.misfit(known)
        bent = 2 * weight * (prior.curvature(log) @ log) if weight else 0.0
        return float(misfit @ misfit) + 2 * weight * prior.value(log), gradient(problem, known) + bent

    def each(log: Array) -> None:
        nonlocal count
        count += 1
        if progress:
            rms = float(np.sqrt((problem.misfit(known) ** 2).mean()))
            shapes = tuple(one.state.x for one in known)
            progress(Iteration(count, time.perf_counter() - started, rms, weight, np.nan, log.copy(), shapes))

    log = np.clip(standings[0].log, low, high)
    limits = {"maxiter": 5 * options.most_iterations, "maxcor": 30, "ftol": 1e-15, "gtol": 1e-12}
    search: Any = minimize
    found = search(
        value, log, jac=True, method="L-BFGS-B", bounds=[(low, high)] * len(log), callback=each, options=limits
    )
    return np.asarray(np.exp(found.x))
