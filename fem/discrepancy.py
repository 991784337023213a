"""How strongly neighbours are held alike: as strongly as the noise allows (Morozov, Soviet Math. Dokl. 7, 1966).

Of all weights of the variation, the largest whose map still explains the data to within their noise. Where no
weight does, because the model and not the noise is what is left, the least misfit that was found stands for it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from data.errors import BadInput
from data.signal import Array
from fem.inverse import Inversion, Iteration, Reconstruction, reconstruct
from fem.observation import Observation
from fem.voxels import Voxels

NEAR = 0.05  # of the noise, that a misfit may be off: twice its own scatter over a thousand values
MOST, FACTOR = 8, 4.0  # maps sought, and the first change of the weight between two of them
WEAKEST = 1 / 64  # of the first weight
ABOVE = 1.05  # of the least misfit, where noise does not explain it


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """A map at the weight that the noise allows: inversion has its prior; level: the misfit aimed at, in noises.

    tried: weight and misfit of every map that was sought, in turn.
    """

    found: Reconstruction
    inversion: Inversion
    level: float
    tried: tuple[tuple[float, float], ...]


def discrepant(  # noqa: PLR0917, as fem.inverse.reconstruct
    voxels: Voxels,
    observations: Sequence[Observation],
    seed: Array,
    variation: Any,
    options: Inversion | None = None,
    progress: Callable[[Iteration], None] | None = None,
) -> Discrepancy:
    """Return the map whose misfit is the noise; arguments as fem.inverse.reconstruct, whose weight is tried first.

    Each map is the seed of the next; the iterations are counted through. Raises BadInput for exact data.
    """
    options, history, seconds = options or Inversion(), list[Iteration](), 0.0
    if not all(one.sd > 0 for one in observations):
        raise BadInput("observations", "are exact", "the discrepancy principle needs their noise")
    known: dict[float, tuple[Reconstruction, Inversion]] = {}

    def sought(weight: float, start: Array) -> float:
        nonlocal seconds
        inversion = replace(options, prior=1 / weight)

        def tell(one: Iteration) -> None:
            history.append(replace(one, number=len(history), seconds=seconds + one.seconds))
            if progress:
                progress(history[-1])

        found = reconstruct(voxels, observations, start, variation, inversion, tell)
        seconds += found.seconds
        known[weight] = found, inversion
        return found.misfit

    first = weight = 1 / options.prior
    misfit, level = sought(weight, seed), 1.0
    while len(known) < MOST and abs(misfit / level - 1) > NEAR:
        tried = {key: found.misfit for key, (found, _) in known.items()}
        if min(tried.values()) > level and weight <= first * WEAKEST:
            level = ABOVE * min(tried.values())
        nearest = min(tried, key=lambda key: abs(np.log(tried[key] / level)))
        weight = _next(tried, level, first)
        if weight in known:
            break
        misfit = sought(weight, known[nearest][0].moduli)
    good = [key for key, (found, _) in known.items() if found.misfit <= level * (1 + NEAR)] or list(known)
    best, inversion = known[max(good)]
    if best.misfit != history[-1].misfit:  # a map's misfit is its history's last
        history.append(replace(best.history[-1], number=len(history), seconds=seconds))
    best = replace(best, history=tuple(history))
    tried_all = tuple((key, found.misfit) for key, (found, _) in known.items())
    return Discrepancy(replace(best, noise=level), inversion, level, tried_all)


def _next(tried: dict[float, float], level: float, first: float) -> float:
    """Return the weight to try next: between those on either side of the level, else further out."""
    below = max((key for key, misfit in tried.items() if misfit <= level), default=None)
    above = min((key for key, misfit in tried.items() if misfit > level), default=None)
    if below is None:
        return max(min(tried) / FACTOR, first * WEAKEST)
    if above is None:
        return max(tried) * FACTOR
    share = np.log(level / tried[below]) / np.log(tried[above] / tried[below])
    return float(below * (above / below) ** np.clip(share, 0.15, 0.85))
