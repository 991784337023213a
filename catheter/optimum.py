"""The best valves: J's maximum over coefficients, stiffnesses and the period, by its exact slope."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from catheter.circuit import Accumulator, Circuit
from catheter.drive import SquareWave
from catheter.hydraulics import Solver
from catheter.tuning import Marks, slope
from data.errors import BadInput, DidNotConverge, nearest
from data.options import option
from data.signal import Array


@dataclass(frozen=True, kw_only=True)
class Search:
    """What may change: K1.. (flow coefficients), S1.. (stiffnesses), T (period), each up to `range`-fold.

    per_second: maximise sqrt(J)/T, what the extender exchanges in a second, instead of J: without
    it a longer period is always better.
    """

    free: tuple[str, ...] = ("K2", "K3")
    range: float = option(10.0, least=1.001, most=1e3)
    per_second: bool = False
    flat: float = option(1e-4, least=1e-9, most=0.1)
    most_steps: int = option(200, least=1, most=100_000)


@dataclass(frozen=True, eq=False)
class Optimum:
    """The best circuit and source found, J there, the factors applied, those at their bound, cost."""

    circuit: Circuit
    source: SquareWave
    objective: float
    factors: dict[str, float]
    at_bound: tuple[str, ...]
    evaluations: int


def stiffened(circuit: Circuit, factors: Array) -> Circuit:
    """Return the circuit with every accumulator's pressure times a factor (N,)."""

    def scaled(spring: Accumulator, factor: float) -> Accumulator:
        return replace(spring, coefficients=tuple(c * factor for c in spring.coefficients))

    pairs = zip(circuit.segments, factors, strict=True)
    return replace(circuit, segments=tuple(replace(s, accumulator=scaled(s.accumulator, float(f))) for s, f in pairs))


def _moved(circuit: Circuit, source: SquareWave, names: tuple[str, ...], factors: Array) -> tuple[Circuit, SquareWave]:
    n = len(circuit.segments)
    by_name = dict(zip(names, factors.tolist(), strict=True))
    coefficients = [s.valve.coefficient * by_name.get(f"K{k + 1}", 1.0) for k, s in enumerate(circuit.segments)]
    moved = stiffened(
        circuit.with_coefficients(*coefficients), np.array([by_name.get(f"S{k + 1}", 1.0) for k in range(n)])
    )
    return moved, replace(source, period=source.period * by_name.get("T", 1.0))


def optimum(
    circuit: Circuit,
    source: SquareWave,
    marks: Marks,
    search: Search | None = None,
    solver: Solver | None = None,
) -> Optimum:
    """Return the local maximum next to a circuit and source: start near it, at a map's best cell.

    Smooth objectives go uphill by their exact slope (L-BFGS-B) and must end flat: raises
    DidNotConverge where the relative slope is above `flat`, naming it. The objective "equal" has
    an edge where both strokes are equal, on which its maximum lies, so it is searched without a
    slope (Nelder-Mead). Raises BadInput for unknown names, or a start without any stroke.
    """
    from scipy.optimize import minimize

    search = search or Search()
    names, n = search.free, len(circuit.segments)
    known = [*(f"K{k + 1}" for k in range(n)), *(f"S{k + 1}" for k in range(n)), "T"]
    for name in names:
        if name not in known:
            raise BadInput("search, free", f"{name!r} is unknown", nearest(name, known))
    calls = 0

    def climb(logs: Array) -> tuple[float, Array]:
        nonlocal calls
        calls += 1
        moved, pulse = _moved(circuit, source, names, np.exp(logs))
        found = slope(moved, pulse, marks, solver)
        coefficients = np.array([s.valve.coefficient for s in moved.segments])
        by_log = np.concatenate([found.coefficient * coefficients, found.stiffness, [found.period * pulse.period]])
        gain = by_log[[known.index(name) for name in names]]
        if not search.per_second:
            return -found.objective, -gain
        rate = np.sqrt(found.objective) / pulse.period
        relative = gain / (2 * max(found.objective, 1e-300)) - (np.array(names) == "T")
        return -rate, -rate * relative

    begin, limit = np.zeros(len(names)), float(np.log(search.range))
    if climb(begin)[0] == 0:
        raise BadInput("circuit", "has no stroke at the start of the search", "start at a map's best cell")
    smooth = marks.objective == "product"
    settings: Any = {
        "maxiter": search.most_steps,
        **({"ftol": 1e-14, "gtol": 1e-9} if smooth else {"xatol": 1e-5, "fatol": 1e-9}),
    }
    height = climb if smooth else lambda logs: climb(logs)[0]
    maximise: Any = minimize
    found = maximise(
        height,
        begin,
        jac=smooth,
        method="L-BFGS-B" if smooth else "Nelder-Mead",
        bounds=[(-limit, limit)] * len(names),
        options=settings,
    )
    value, gain = climb(found.x)
    bound = np.abs(found.x) > limit - 1e-9
    steep = np.abs(gain[~bound]).max(initial=0.0) / -value
    if (smooth and steep > search.flat) or (not smooth and not found.success):
        raise DidNotConverge(
            f"optimum: relative slope {steep:.2g} after {calls} cycles ({found.message}); start nearer to it"
        )
    best, pulse = _moved(circuit, source, names, np.exp(found.x))
    factors = dict(zip(names, np.exp(found.x).tolist(), strict=True))
    edge = tuple(name for name, at in zip(names, bound, strict=True) if at)
    objective = slope(best, pulse, marks, solver).objective
    return Optimum(best, pulse, objective, factors, edge, calls)
