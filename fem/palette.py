"""From moduli to printable materials: nearest, dithered, and chosen by mechanics; compared by what would be printed.

Thesis 6.2 bins (Algorithm 4, its edges corrected to midpoints) and dithers (Algorithm 5, its error taken
before the voxel is overwritten, and wrapped around the tube). What it asks for as future work, a choice by
what the body does, is `diffused` and `swapped`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cholesky

from data.errors import BadInput, DidNotConverge
from data.signal import Array
from fem.inverse import Problem
from fem.voxels import Standing

Choice = NDArray[np.int64]
RIDGE = 1e-6  # of the mean curvature: what the data does not determine stays where it is
SHARES = ((1, 0, 7 / 16), (-1, 1, 3 / 16), (0, 1, 5 / 16), (1, 1, 1 / 16))  # Floyd and Steinberg, 1976


def checked(palette: Sequence[float]) -> Array:
    """Return a palette's moduli (m,) [Pa]. Raises BadInput unless they are positive and ascend."""
    moduli = np.asarray(palette, dtype=np.float64)
    if moduli.ndim != 1 or not len(moduli) or not (moduli > 0).all() or not (np.diff(moduli) > 0).all():
        raise BadInput("palette", f"is {palette}", "expected moduli above 0, ascending")
    return moduli


def binned(moduli: Array, palette: Sequence[float], *, log: bool = False) -> Choice:
    """Return the number of the nearest material of each voxel, same shape; log: nearest in logarithm."""
    change = np.log if log else np.asarray
    levels = change(checked(palette))
    return np.asarray(np.searchsorted((levels[1:] + levels[:-1]) / 2, change(moduli)))


def dithered(moduli: Array, palette: Sequence[float], *, log: bool = False) -> Choice:
    """Return materials of a tube's voxels (around, along), each voxel's error shed on those not yet chosen.

    Ring by ring from the base; what would fall on a voxel already chosen moves to the next ring, what
    would leave the tip is lost.
    """
    levels = np.log(checked(palette)) if log else checked(palette)
    left = np.log(moduli) if log else np.array(moduli, dtype=np.float64)
    around, along = left.shape
    chosen = np.empty(left.shape, dtype=np.int64)
    for j in range(along):
        for i in range(around):
            value = left[i, j]
            chosen[i, j] = np.abs(levels - value).argmin()
            error = value - levels[chosen[i, j]]
            for right, up, share in SHARES:
                next_ring = j + (up or int(i + right >= around))
                if next_ring < along:
                    left[(i + right) % around, next_ring] += share * error
    return chosen


def steps(now: Array, then: Array) -> Array:
    """Return the step of the linearisation that leads from moduli to others (see fem.inverse); broadcasts."""
    ratio = then / now
    return np.asarray(np.where(ratio >= 1, ratio - 1, 1 - 1 / ratio))


def shed(  # noqa: PLR0917
    moduli: Array, palette: Sequence[float], curvature: Array, rise: Array, order: Choice, count: int
) -> Array:
    """Return moduli (v,) of which the first `count` of `order` are materials, the others of it moved to make up for it.

    curvature (o, o) and rise (o,) are S^T S and S^T misfit of the voxels in `order`, over log moduli. Each
    voxel takes the material nearest to its best value; then all that are left take the values that best make up
    for its error (exact minimisers of the quadratic: Hassibi and Stork, NIPS 5, 1993).
    """
    levels, size = checked(palette), len(order)
    whole = curvature + RIDGE * np.trace(curvature) / size * np.eye(size)
    factor = cho_factor(whole)
    # row k of the inverse's upper Cholesky factor is what is left of the inverse once k voxels are chosen
    inverse = cholesky(cho_solve(factor, np.eye(size)), lower=False)
    wanted, found = moduli[order], moduli.copy()
    shift = -cho_solve(factor, rise)
    for k in range(count):
        options = steps(wanted[k], levels)
        pick = int(np.abs(options - shift[k]).argmin())
        found[order[k]] = levels[pick]
        error = (shift[k] - options[pick]) / inverse[k, k]
        shift[k:] -= error * inverse[k, k:]
    rest = shift[count:]
    found[order[count:]] *= np.where(rest >= 0, 1 + rest, 1 / (1 - np.minimum(rest, 0)))
    found[order[count:]] = np.clip(found[order[count:]], levels[0], levels[-1])
    return found


@dataclass(frozen=True, eq=False)
class Printed:
    """Materials chosen (v,), the equilibria of what would be printed, and how far from the target it is.

    misfit: root mean square, largest: the largest misfit, both as fem.inverse whitens them. solved: forward problems.
    """

    chosen: Choice
    standings: tuple[Standing, ...]
    misfit: float
    largest: float
    solved: int


def printed(problem: Problem, chosen: Choice, palette: Sequence[float], start: Sequence[Standing] | None) -> Printed:
    """Return what a choice does, solved; start: equilibria to reach it from, None: from rest."""
    log = np.log(checked(palette))[chosen.ravel()]
    found = [problem.voxels.inflate(log, p) for p in problem.pressures] if start is None else problem.moved(start, log)
    return _judged(problem, chosen.ravel(), found, 1)


def _judged(problem: Problem, chosen: Choice, standings: Sequence[Standing], solved: int) -> Printed:
    misfit = problem.misfit(standings)
    rms, largest = float(np.sqrt((misfit**2).mean())), float(np.abs(misfit).max())
    return Printed(chosen, tuple(standings), rms, largest, solved)


def diffused(problem: Problem, start: Sequence[Standing], palette: Sequence[float], *, parts: int = 8) -> Printed:
    """Return a choice by mechanics: the most sensitive voxels first, each one's error shed on the others (`shed`).

    After each of `parts` the body is solved again and its sensitivity with it. Raises DidNotConverge
    where a half-chosen map does not bear the pressure.
    """
    standings, left = list(start), np.arange(problem.voxels.count)
    for part in range(parts, 0, -1):
        slope, misfit = problem.slope(standings)[:, left], problem.misfit(standings)
        order = np.argsort(-(slope**2).sum(axis=0), kind="stable")
        curvature, rise = (slope.T @ slope)[np.ix_(order, order)], (slope.T @ misfit)[order]
        count = -(-len(left) // part)
        moduli = shed(np.exp(standings[0].log), palette, curvature, rise, left[order], count)
        standings = problem.moved(standings, np.log(moduli))
        left = np.sort(left[order[count:]])
    return _judged(problem, binned(np.exp(standings[0].log), palette, log=True), standings, parts)


def swapped(
    problem: Problem,
    first: Printed,
    palette: Sequence[float],
    *,
    rounds: int = 12,
    power: float = 2.0,
    progress: Callable[[Printed], None] | None = None,
) -> Printed:
    """Return a choice whose simulated misfit is lower: swaps foreseen by the sensitivity, verified by solving.

    The misfit is the power mean of all: 2 the root mean square, more minds the largest (in a round each counts by its
    size: iteratively reweighted least squares).

    In each round the sensitivity at the present choice foretells what swaps do; they are taken one after
    another while they lower the foretold misfit, then all solved; if it did not fall, a quarter of them.
    """
    levels, best, solved = checked(palette), first, first.solved
    for _ in range(rounds):
        misfit, slope = problem.misfit(best.standings), problem.slope(best.standings)
        weight = (1 + misfit**2 / ((misfit**2).mean() or 1.0)) ** (power / 2 - 1)
        curvature, rise = slope.T @ (weight[:, None] * slope), slope.T @ (weight * misfit)
        swaps = _foreseen(levels, best.chosen, curvature, rise)
        better = None
        while swaps and better is None:
            chosen = best.chosen.copy()
            for voxel, material in swaps:
                chosen[voxel] = material
            try:
                solved += 1
                trial = printed(problem, chosen, palette, best.standings)
                lower = _mean(problem.misfit(trial.standings), power) < _mean(misfit, power) * (1 - 1e-6)
                better = trial if lower else None
            except DidNotConverge:
                better = None
            swaps = swaps[: len(swaps) // 4]
        if better is None:
            break
        best = better
        if progress:
            progress(best)
    return Printed(best.chosen, best.standings, best.misfit, best.largest, solved)


def _mean(misfit: Array, power: float) -> float:
    return float((np.abs(misfit) ** power).mean() ** (1 / power))


def _foreseen(levels: Array, chosen: Choice, curvature: Array, rise: Array) -> list[tuple[int, int]]:
    """Return the swaps (voxel, material) that lower the foretold misfit, each the best after those before it."""
    options = steps(levels[chosen][:, None], levels[None, :])  # (v, m)
    now, at = np.zeros(len(chosen)), chosen.copy()
    slope, diagonal, taken = rise.copy(), np.diag(curvature), list[tuple[int, int]]()
    for _ in range(len(chosen)):
        move = options - now[:, None]
        change = 2 * slope[:, None] * move + diagonal[:, None] * move**2
        voxel, material = np.unravel_index(int(change.argmin()), change.shape)
        if change[voxel, material] >= -1e-12 * float(np.abs(rise).max() + 1e-300):
            break
        slope += curvature[:, voxel] * move[voxel, material]
        now[voxel], at[voxel] = options[voxel, material], material
        taken.append((int(voxel), int(material)))
    return taken
