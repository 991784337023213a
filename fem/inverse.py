"""From what is seen of a body under pressure to the moduli of its voxels: regularised Gauss-Newton in their logarithm.

Minimised is |misfit|^2 + 2 weight TV(log moduli) within bounds. The weight is not set by hand: it is
the noise's variance over `prior`, the mean difference in log modulus expected between neighbours. While the
misfit is larger than the noise, a share `eager` of it stands for the noise, so that the weight falls with
the misfit (Yamashita and Fukushima, Computing Suppl. 15, 2001): to nothing where data are exact. The noise is
what the observations state, all of them or none; it is never estimated, and data that state none count as exact.

A step s moves a modulus to E (1 + s) where it stiffens and E / (1 - s) where it softens: a voxel
much softer than its neighbours takes up strain linearly in its modulus, one much stiffer in its compliance.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from data.errors import BadInput, DidNotConverge
from data.options import option
from data.signal import Array
from fem.observation import Observation
from fem.regular import Variation, boxed
from fem.sensitivity import sensitivity
from fem.voxels import Standing, Voxels

EXACT = 1e-20  # mean squared misfit over the largest value seen, below which nothing is left to explain
SMALL_GAIN, SMALL_STEP = 1e-3, 1e-7
LEAST_REACH = 1e-4  # of a step in log modulus, below which a shorter one is not tried
FLAT, BROKEN = 0.05, 1.0  # log range of a map that counts as one modulus, and the spread that breaks its symmetry


@dataclass(frozen=True, kw_only=True)
class Inversion:
    """How a map is sought; the same settings serve exact and noisy data.

    least, most: bounds of the moduli [Pa]. prior, edge: see fem.regular, in log modulus. eager: the
    share of the misfit's variance taken for noise on the way. robust: misfits beyond so many noises
    count less (Huber), 0 for none. most_iterations: linearisations.
    """

    least: float = option(0.05e6, unit="Pa", least=1.0)
    most: float = option(20e6, unit="Pa", least=1.0)
    prior: float = option(0.3, least=1e-6)
    edge: float = option(0.01, least=1e-6)
    eager: float = option(0.01, least=0.0, most=1.0)
    robust: float = option(4.0, least=0.0)
    most_iterations: int = option(60, least=1)

    def __post_init__(self) -> None:
        """Check the bounds."""
        if not 0 < self.least < self.most:
            raise BadInput("bounds", f"are {self.least:g} to {self.most:g} Pa", "expected 0 < least < most")


@dataclass(frozen=True, eq=False)
class Iteration:
    """One linearisation: its number, the seconds until then, root mean square misfit, weight, largest log change.

    misfit is in noises where they are given, otherwise over the largest value seen; outliers count as in the search.
    log (v,): the map's log moduli; shapes: where it puts the nodes (n, 3) at each pressure [m].
    """

    number: int
    seconds: float
    misfit: float
    weight: float
    change: float
    log: Array = field(repr=False)
    shapes: tuple[Array, ...] = field(repr=False)


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """A map: moduli (v,) [Pa], the equilibria at each pressure, and how it was found.

    noise: of a misfit, in its unit (see Iteration): 1 where it is given, else 0. bounded (v,): -1 at the
    least modulus, 1 at the most. strengthened: times the seed was doubled until it could bear the pressure.
    """

    moduli: Array
    standings: tuple[Standing, ...]
    history: tuple[Iteration, ...]
    noise: float
    weight: float
    bounded: Array
    strengthened: int
    why: str

    @property
    def misfit(self) -> float:
        """Root mean square misfit at the end."""
        return self.history[-1].misfit

    @property
    def seconds(self) -> float:
        """Wall time [s]."""
        return self.history[-1].seconds


def reconstruct(  # noqa: PLR0917, in the order they are thought of
    voxels: Voxels,
    observations: Sequence[Observation],
    seed: Array,
    variation: Any,
    options: Inversion | None = None,
    progress: Callable[[Iteration], None] | None = None,
) -> Reconstruction:
    """Return the map in bounds that explains what was seen, from a seed of moduli (v,) [Pa].

    variation: neighbours' differences (p, v), see fem.regular.neighbours. A seed that cannot bear the
    pressure is doubled until it can. A search that ends with one modulus everywhere and leaves something to
    explain (a pure twist has no slope there) is repeated once from a seed scattered about its own. Maps past
    their limit point on the way are stepped back from. Raises
    BadInput for observations without order, DidNotConverge if no map in bounds bears the pressure.
    """
    options, tell = options or Inversion(), progress or (lambda _: None)
    found = _Search(voxels, list(observations), options, variation).run(seed, tell)
    if found.why == "explained" or np.ptp(np.log(found.moduli)) > FLAT:
        return found
    apart = np.exp(BROKEN * np.random.default_rng(0).standard_normal(voxels.count))
    again = _Search(voxels, list(observations), options, variation).run(seed * apart, tell)
    if again.misfit >= found.misfit:
        return found
    return replace(again, why=f"{again.why}, from a seed whose symmetry was broken")


@dataclass(eq=False)
class Problem:
    """Observations beside the forward problem: stacked, whitened misfits and their slopes."""

    voxels: Voxels
    observations: list[Observation]

    def __post_init__(self) -> None:
        """Check that noise is given for all, or for none."""
        if not self.observations:
            raise BadInput("observations", "are none", "give one at least")
        given = [one.sd > 0 for one in self.observations]
        if any(given) != all(given):
            raise BadInput("observations", "some are exact, others noisy", "give every one its noise, or none")
        self.noisy = all(given)
        self.pressures = sorted({one.pressure for one in self.observations})
        largest = max(one.size for one in self.observations) or 1.0
        self.scale = [one.weight**0.5 / (one.sd or largest) for one in self.observations]

    def at(self, standings: Sequence[Standing], one: Observation) -> Standing:
        """Return the equilibrium an observation belongs to."""
        return standings[self.pressures.index(one.pressure)]

    def misfit(self, standings: Sequence[Standing]) -> Array:
        """Return all misfits (k,), in noises or over the largest value."""
        pairs = zip(self.scale, self.observations, strict=True)
        return np.concatenate([scale * one.misfit(self.at(standings, one).state.x) for scale, one in pairs])

    def slope(self, standings: Sequence[Standing]) -> Array:
        """Return d(misfits) / d(log moduli) (k, v)."""
        from scipy.sparse import csr_array, vstack

        parts, order = [], []
        for pressure, standing in zip(self.pressures, standings, strict=True):
            mine = [k for k, one in enumerate(self.observations) if one.pressure == pressure]
            rows = [csr_array(self.scale[k] * self.observations[k].slope(standing.state.x)) for k in mine]
            found = sensitivity(self.voxels, standing, vstack(rows).tocsr())
            parts += np.split(found, np.cumsum([r.shape[0] for r in rows])[:-1])
            order += mine
        return np.vstack([parts[order.index(k)] for k in range(len(parts))])

    def start(self, log: Array, highest: float) -> tuple[list[Standing], int]:
        """Return a seed's equilibria, its moduli doubled until it bears the pressures, and how often they were."""
        for doubled in range(40):
            try:
                first = self.voxels.inflate(log, self.pressures[0])
                return self.moved([first] * len(self.pressures), log), doubled
            except DidNotConverge:
                if (log >= highest).all():
                    raise
                log = np.minimum(log + np.log(2), highest)
        raise DidNotConverge("no map in bounds bears the pressure; raise the upper bound")

    def moved(self, standings: Sequence[Standing], log: Array) -> list[Standing]:
        """Return the equilibria of another map. Raises DidNotConverge."""
        pairs = zip(standings, self.pressures, strict=True)
        return [self.voxels.moved(standing, log, pressure, shares=8) for standing, pressure in pairs]


class _Search(Problem):
    """The search's state from step to step."""

    def __init__(self, voxels: Voxels, observations: list[Observation], options: Inversion, pairs: Any) -> None:
        super().__init__(voxels, observations)
        self.options, self.variation = options, Variation(pairs, options.edge)
        self.low, self.high = np.log(options.least), np.log(options.most)
        self.damping, self.reach = 1e-3, 2.0
        self.noise = 1.0 if self.noisy else 0.0

    def run(self, seed: Array, progress: Callable[[Iteration], None]) -> Reconstruction:
        started, history = time.perf_counter(), list[Iteration]()
        log = np.log(np.clip(seed, self.options.least, self.options.most))
        standings, doubled = self.start(log, self.high)
        change, idle, why = np.inf, 0, "most iterations"
        for number in range(self.options.most_iterations + 1):
            misfit = self.misfit(standings)
            log = standings[0].log
            mean = float((self._robust(misfit) * misfit**2).mean())
            weight = self._weight(mean, min(1.0, len(misfit) / len(log)))
            seconds = time.perf_counter() - started
            shapes = tuple(one.state.x for one in standings)
            history.append(Iteration(number, seconds, mean**0.5, weight, change, log, shapes))
            progress(history[-1])
            if (mean <= EXACT and not self.noisy) or change <= SMALL_STEP or idle >= 2:
                why = "explained" if mean <= max(EXACT, 2 * self.noise**2) else "settled"
                break
            if number == self.options.most_iterations:
                break
            found = self._step(standings, misfit, weight)
            if found is None:
                why = "no step explains more"
                break
            standings, gain = found
            change = float(np.abs(standings[0].log - log).max())
            idle = idle + 1 if gain < SMALL_GAIN else 0
        log = standings[0].log
        bounded = (log >= self.high - 1e-9) * 1 - (log <= self.low + 1e-9)
        return Reconstruction(np.exp(log), tuple(standings), tuple(history), self.noise, weight, bounded, doubled, why)

    def _weight(self, mean: float, told: float) -> float:
        """Return the weight of the variation beside the mean squared misfit; told: values a voxel, 1 at most.

        A few values must not be drowned by the variation of many voxels.
        """
        return max(self.noise**2, self.options.eager * told * mean) / self.options.prior

    def _robust(self, misfit: Array) -> Array:
        """Return Huber's weights of misfits."""
        if not (self.options.robust and self.noisy):
            return np.ones(len(misfit))
        usual = self.options.robust * max(self.noise, 1.4826 * float(np.median(np.abs(misfit))))
        return np.minimum(1.0, usual / np.maximum(np.abs(misfit), 1e-300))

    def _step(self, standings: list[Standing], misfit: Array, weight: float) -> tuple[list[Standing], float] | None:
        """Return better equilibria and the share of the objective gained; None: there are none."""
        trust = self._robust(misfit)
        slope = self.slope(standings) * np.sqrt(trust)[:, None]
        misfit = misfit * np.sqrt(trust)
        curvature, rise = slope.T @ slope, slope.T @ misfit
        log = standings[0].log
        before = float(misfit @ misfit) + 2 * weight * self.variation.value(log)
        while self.reach > LEAST_REACH:
            step, goal = self._proposed(curvature, rise, weight, log)
            turned = 2 * weight * (self.variation.value(goal) - self.variation.value(log))
            foreseen = -float(2 * rise @ step + step @ (curvature @ step)) - turned
            try:
                trial = self.moved(standings, goal)
                left = self.misfit(trial) * np.sqrt(trust)
                gained = float(misfit @ misfit - left @ left) - turned
            except DidNotConverge:
                gained = -np.inf
            if gained > 1e-4 * foreseen > 0:
                self._adapt(gained / foreseen)
                return trial, gained / before
            if foreseen <= 1e-12 * before:
                return None
            self.damping = max(10 * self.damping, 1e-6)
            self.reach = float(np.abs(goal - log).max()) / 3
        return None

    def _adapt(self, ratio: float) -> None:
        """Trust the linearisation as far as it held."""
        if ratio > 0.75:
            self.reach = min(2 * self.reach, 4.0)
        if ratio > 0.5:
            self.damping = max(0.1 * self.damping, 1e-9)
        elif ratio < 0.25:
            self.damping *= 4
            self.reach /= 2

    def _proposed(self, curvature: Array, rise: Array, weight: float, log: Array) -> tuple[Array, Array]:
        """Return the step of the linearised problem and the log moduli it leads to (v,)."""
        low = -np.expm1(np.minimum(log - self.low, self.reach))
        high = np.expm1(np.minimum(self.high - log, self.reach))
        goal, step = log, np.zeros_like(log)
        for _ in range(4):
            bent = weight * self.variation.curvature(goal)
            whole = curvature + bent
            rounding = 1e-12 * np.trace(whole)  # where the data say nothing of a map's level, a step keeps it
            whole[np.diag_indices(len(log))] += (self.damping * np.trace(curvature) + rounding) / len(log)
            step = boxed(whole, rise + bent @ log, low, high)
            before, goal = goal, np.clip(log + np.sign(step) * np.log1p(np.abs(step)), self.low, self.high)
            if np.abs(goal - before).max() < 1e-2:
                break
        return step, goal
