"""The hydraulic circuit in time: `simulate` a chain of accumulators and valves under a source pressure."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from catheter.circuit import Accumulator, Circuit, ConicalValve, Orifice, Segment, thesis_circuit
from catheter.drive import Drive, SquareWave, recorded, sampled
from data.errors import BadInput, DidNotConverge
from data.options import check, option
from data.signal import Array, Signal

__all__ = [
    "Accumulator",
    "Circuit",
    "ConicalValve",
    "Drive",
    "Orifice",
    "Run",
    "Segment",
    "Solver",
    "SquareWave",
    "recorded",
    "sampled",
    "simulate",
    "thesis_circuit",
]

OURS = "rodas5p"
SCIPY = ("Radau", "BDF", "LSODA", "RK45")


@dataclass(frozen=True, kw_only=True)
class Solver:
    """How to integrate: `tolerance` is the local error of V/V_rest; `method` ours or one of scipy's."""

    tolerance: float = option(1e-6, least=1e-13, most=1e-2)
    method: str = option(OURS, choices=(OURS, *SCIPY))
    most_steps: int = option(1_000_000, least=1)

    def __post_init__(self) -> None:
        """Check the ranges."""
        check(self, "solver")


@dataclass(frozen=True, eq=False)
class Run:
    """A simulated run: the ends of its steps (s+1,), volume coefficients there (s+1, N), and all between."""

    circuit: Circuit
    drive: Drive
    solver: Solver
    time_s: Array
    volume: Array
    between: Callable[[Array], Array]
    steps_tried: int

    def at(self, time_s: ArrayLike) -> Array:
        """Return volume coefficients V/V_rest at times (m,), (m, N); NaN outside the run."""
        times = np.atleast_1d(np.asarray(time_s, dtype=np.float64))
        inside = (times >= self.time_s[0]) & (times <= self.time_s[-1])
        return np.where(inside[:, None], self.between(np.clip(times, self.time_s[0], self.time_s[-1])), np.nan)

    def pressure_pa(self, time_s: ArrayLike) -> Array:
        """Return the accumulators' pressures [Pa] at times (m,), (m, N)."""
        columns = zip(self.at(time_s).T, self.circuit.segments, strict=True)
        return np.stack([segment.accumulator.pressure_pa(v) for v, segment in columns], axis=1)

    def flow_m3_s(self, time_s: ArrayLike) -> Array:
        """Return the flow through each valve, towards the end of the chain, at times (m,), (m, N)."""
        from catheter.circuit_kernel import flows

        times = np.atleast_1d(np.asarray(time_s, dtype=np.float64))
        return np.asarray(flows(self.circuit.table(), self.at(times) - 1.0, self.drive.at(times)))

    def crossings(self, segment: int, level: float, *, rising: bool) -> Array:
        """Return the times at which segment 0..N-1's volume coefficient passes a level, found on the dense output.

        Every step is looked at in 8 parts, so a pair of crossings closer than that is not seen.
        """
        parts = np.linspace(0.0, 1.0, 9)[:-1]
        grid = np.append((self.time_s[:-1, None] + np.diff(self.time_s)[:, None] * parts).ravel(), self.time_s[-1])
        sign = 1.0 if rising else -1.0
        value = sign * (self.at(grid)[:, segment] - level)
        starts = np.flatnonzero((value[:-1] < 0) & (value[1:] >= 0))
        low, high = grid[starts], grid[starts + 1]
        for _ in range(60):
            middle = (low + high) / 2
            below = sign * (self.at(middle)[:, segment] - level) < 0 if len(middle) else middle < 0
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return np.asarray(high)

    def signals(self, time_s: Array) -> dict[str, Signal]:
        """Return source, pressures and volumes at times (m,), by topic as a recording names them."""
        pressure, volume = self.pressure_pa(time_s), self.at(time_s)
        found = {"/pressure/source": Signal(time_s, self.drive.at(time_s), "Pa", name="/pressure/source")}
        for k, segment in enumerate(self.circuit.segments):
            v = volume[:, k] * segment.accumulator.rest_volume
            found[f"/pressure/{k + 1}"] = Signal(time_s, pressure[:, k], "Pa", name=f"/pressure/{k + 1}")
            found[f"/volume/{k + 1}"] = Signal(time_s, v, "m^3", name=f"/volume/{k + 1}")
        return found

    def accounting_error(self) -> float:
        """Return |inflow - stored| over the largest volume there was: a check that shares nothing with the steps.

        The inflow is Gauss-Legendre quadrature (16 points in each step) of the first valve's flow,
        taken from the dense output; stored is the change of all volumes.
        """
        nodes, weights = np.polynomial.legendre.leggauss(16)
        width = np.diff(self.time_s)
        times = (self.time_s[:-1, None] + width[:, None] * (nodes + 1) / 2).ravel()
        inflow = float((self.flow_m3_s(times)[:, 0].reshape(-1, 16) @ weights * width / 2).sum())
        rest = np.array([segment.accumulator.rest_volume for segment in self.circuit.segments])
        return abs(inflow - float((self.volume[-1] - self.volume[0]) @ rest)) / float((self.volume * rest).max())


def simulate(circuit: Circuit, drive: Drive, start: ArrayLike | None = None, solver: Solver | None = None) -> Run:
    """Integrate the circuit over a drive, restarting at each of its breaks (thesis eq. 3.21).

    start: volume coefficients V/V_rest (N,), by default at rest without pressure. Raises BadInput
    for a start that cannot be, DidNotConverge with time and numbers for a run that cannot be
    finished: too many steps, steps too small, volumes that are not finite, an emptied accumulator.
    """
    solver = solver or Solver()
    begin = circuit.volume() if start is None else np.array(start, dtype=np.float64)
    if begin.shape != (len(circuit.segments),) or not np.isfinite(begin).all() or not (begin > 0).all():
        raise BadInput("start", f"is {begin}", f"expected {len(circuit.segments)} volume coefficients > 0")
    return _ours(circuit, drive, begin, solver) if solver.method == OURS else _scipy(circuit, drive, begin, solver)


def _ours(circuit: Circuit, drive: Drive, begin: Array, solver: Solver) -> Run:
    from catheter.circuit_kernel import integrate

    n = len(begin)
    none = np.zeros((0, 2 * n))
    found = integrate(
        circuit.table(), drive.breaks_s, drive.pieces, begin - 1.0, none, solver.tolerance, solver.most_steps
    )
    return run_of(circuit, drive, solver, found)


def run_of(circuit: Circuit, drive: Drive, solver: Solver, found: tuple[Any, ...]) -> Run:
    """Return what the compiled integrator returned as a Run; raises DidNotConverge where it gave up."""
    status, where, steps, tried, time, width, state, dense = found
    time, width = time[:steps], width[:steps]
    refuse(status, where, float(time[-1] + width[-1]) if steps else float(drive.breaks_s[0]), tried, solver)
    n = len(circuit.segments)
    state, dense = state[: steps + 1, :n], dense[:steps, :, :n]

    def between(times: Array) -> Array:
        i = np.clip(np.searchsorted(time, times, side="right") - 1, 0, steps - 1)
        a = np.clip((times - time[i]) / width[i], 0.0, 1.0)[:, None]
        inner = dense[i, 0] + a * (dense[i, 1] + a * dense[i, 2])
        return np.asarray(1.0 + (1 - a) * state[i] + a * (state[i + 1] + (1 - a) * inner))

    return Run(circuit, drive, solver, np.append(time, drive.breaks_s[-1]), 1.0 + state, between, int(tried))


def refuse(status: int, where: int, time_s: float, tried: int, solver: Solver) -> None:
    """Raise DidNotConverge with numbers and a remedy, unless the status of an integration is DONE."""
    from catheter import circuit_kernel as kernel

    if status == kernel.DONE:
        return
    what = {
        kernel.TOO_MANY: (f"{tried - 1} steps were not enough", "raise most_steps or the tolerance"),
        kernel.UNDERFLOW: (f"the step became too small after {tried}", "raise the orifices' transition"),
        kernel.NOT_FINITE: (f"segment {where + 1} is not finite", "check pressures, volumes and coefficients"),
        kernel.EMPTIED: (f"accumulator {where + 1} was emptied", "keep the source pressure nearer to 0"),
    }[status]
    raise DidNotConverge(f"circuit at {time_s:.6g} s, tolerance {solver.tolerance:g}: {what[0]}; {what[1]}")


def _scipy(circuit: Circuit, drive: Drive, begin: Array, solver: Solver) -> Run:
    """Integrate with one of scipy's solvers, piece by piece, over our compiled right-hand side and Jacobian."""
    from scipy.integrate import OdeSolution, solve_ivp

    from catheter.circuit_kernel import slopes, source_at

    table, n, x = circuit.table(), len(begin), begin - 1.0
    out, jacobian = np.empty(n), np.zeros((n, n))
    times, states, parts, tried = [np.array([drive.breaks_s[0]])], [x[None]], [], 0
    options: dict[str, Any] = {"rtol": solver.tolerance, "atol": solver.tolerance, "method": solver.method}
    for i, (left, right) in enumerate(pairwise(drive.breaks_s)):

        def slope(t: float, x: Array, i: int = i, left: float = left) -> Array:
            slopes(table, x, source_at(drive.pieces, i, t - left)[0], out, jacobian)
            return out.copy()

        def slope_of_slope(t: float, x: Array, i: int = i, left: float = left) -> Array:
            slopes(table, x, source_at(drive.pieces, i, t - left)[0], out, jacobian)
            return jacobian.copy()

        if solver.method != "RK45":
            options["jac"] = slope_of_slope
        found: Any = solve_ivp(slope, (left, right), x, dense_output=True, **options)
        tried, x = tried + found.nfev, found.y[:, -1]
        if not found.success or not np.isfinite(x).all() or not (x > -1).all():
            raise DidNotConverge(f"circuit at {found.t[-1]:.6g} s with {solver.method}: {found.message}; V = {1 + x}")
        times.append(found.t[1:])
        states.append(found.y[:, 1:].T)
        parts += found.sol.interpolants
    time, state = np.concatenate(times), np.concatenate(states)
    whole = OdeSolution(time, parts)
    return Run(circuit, drive, solver, time, 1.0 + state, lambda t: np.asarray(1.0 + whole(t).T), tried)
