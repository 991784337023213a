"""Tuning the valves: the events of a cycle, the objective on them, its exact slope, maps and optima.

Events of the three-segment robot (thesis Fig 3.3), as volume coefficients pass two levels:
B: the front actuator is anchored, C: the rear one touches, E: the front one lets go, F: the rear
one is no longer anchored. The extender between them should move between B and C, and E and F.
"""

import os
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from catheter.circuit import DENSITY_KG_M3, DISCHARGE, Circuit
from catheter.drive import SquareWave
from catheter.hydraulics import Solver
from catheter.periodic import Closing, periodic
from data.errors import BadInput, DidNotConverge
from data.options import option
from data.signal import Array

NAMES = ("tB", "tC", "tE", "tF")
FRONT, EXTENDER, REAR = range(3)
GRID_AREA_M2 = 5e-7  # the thesis's grid step, of orifice area
GRID_COUNT = 118  # K up to K1
GRID_SOLVER = Solver(tolerance=3e-5)


@dataclass(frozen=True, kw_only=True)
class Marks:
    """Volume coefficients at which a spiral touches the cannula and is anchored in it, and the objective.

    Both are inputs: the thesis prints 1.30 and, for contact, 1.13 in its methods and 1.12 in its
    Fig 3.13. product: J = a^2 + b^2 - (a - b)^2 = 2ab (thesis eq. 3.24); equal: a^2 + b^2 - |a - b|,
    where equal strokes weigh more. a and b are magnitudes: with signs as printed in (3.22), the
    largest J would be 0.
    """

    anchored: float = option(1.30, least=1.0, most=1e3)
    contact: float = option(1.13, least=1.0, most=1e3)
    objective: str = option("product", choices=("product", "equal"))

    def levels(self) -> tuple[Array, Array]:
        """Return the watched state columns (4,) and, (2, 4), direction and level in x of events B, C, E, F."""
        a, c = self.anchored - 1.0, self.contact - 1.0
        return np.array([FRONT, REAR, FRONT, REAR]), np.array([[1.0, 1.0, -1.0, -1.0], [a, c, c, a]])


@dataclass(frozen=True, eq=False)
class Score:
    """Events and objective of C cycles, each (C,) or (C, 4) for B, C, E, F; NaN where there is no such event."""

    events_s: Array
    extender: Array
    forward: Array
    reverse: Array
    objective: Array
    cycles: Array


@dataclass(frozen=True, eq=False)
class Slope:
    """J and its derivatives by the flow coefficients K (N,), relative stiffnesses (N,) and the period."""

    objective: float
    coefficient: Array
    stiffness: Array
    period: float


def _score(marks: Marks, events_s: Array, extender: Array, cycles: Array) -> Score:
    """a = |V2(C) - V2(B)| if C follows B, b = |V2(E) - V2(F)|; a term whose event is missing is 0."""
    ordered = events_s[:, 1] > events_s[:, 0]
    forward = np.where(ordered, np.abs(extender[:, 1] - extender[:, 0]), 0.0)
    reverse = np.nan_to_num(np.abs(extender[:, 2] - extender[:, 3]))
    together = 2 * forward * reverse
    if marks.objective == "equal":
        together = forward**2 + reverse**2 - np.abs(forward - reverse)
    return Score(events_s, extender, forward, reverse, together, cycles)


def _check_robot(circuit: Circuit) -> None:
    if len(circuit.segments) != 3:
        raise BadInput(
            "circuit", f"has {len(circuit.segments)} segments", "the events are those of front, extender, rear"
        )


def evaluate(circuit: Circuit, source: SquareWave, marks: Marks, solver: Solver | None = None) -> Score:
    """Return events and objective (1,) of the periodic cycle. Raises as `periodic`."""
    _check_robot(circuit)
    orbit = periodic(circuit, source.drive(), solver=solver or Solver(tolerance=1e-9))
    events, extender = np.full((1, 4), np.nan), np.full((1, 4), np.nan)
    columns, (directions, levels) = marks.levels()
    for j in range(4):
        times = orbit.run.crossings(int(columns[j]), 1.0 + levels[j], rising=directions[j] > 0)
        if len(times):
            events[0, j], extender[0, j] = times[0], orbit.run.at(times[0])[0, EXTENDER]
    return _score(marks, events, extender, np.array([orbit.cycles]))


def slope(circuit: Circuit, source: SquareWave, marks: Marks, solver: Solver | None = None) -> Slope:
    """Return dJ/dK, dJ/d(relative stiffness) and dJ/dT of the periodic cycle, exact for the numbers computed.

    The cycle's first state depends on a parameter p by dx0/dp = (1 - dx(T)/dx0)^-1 dx(T)/dp; an
    event of column s moves by dt/dp = -(dx_s/dp) / (dx_s/dt). dJ/dT needs nothing new: dx/dt is
    linear in all K together, so a longer period is a larger K. Raises as `periodic`.
    """
    from catheter import circuit_kernel as kernel

    _check_robot(circuit)
    solver, drive, n = solver or Solver(tolerance=1e-9), source.drive(), len(circuit.segments)
    orbit = periodic(circuit, drive, solver=solver)
    start = np.vstack([orbit.run.volume[0] - 1.0, np.eye(n), np.zeros((2 * n, n))])
    tangent = np.vstack([np.zeros((n, 2 * n)), np.eye(2 * n)])
    status, where, steps, _, _, _, state, dense = kernel.integrate(
        *(circuit.table(), drive.breaks_s, drive.pieces, start.ravel(), tangent, solver.tolerance, solver.most_steps)
    )
    if status != kernel.DONE:
        raise DidNotConverge(f"derivatives of the cycle: status {status}, segment {where}; lower the tolerance")
    end = state[steps].reshape(1 + 3 * n, n)
    by_start, by_parameter = end[1 : 1 + n].T, end[1 + n :].T
    first = np.linalg.solve(np.eye(n) - by_start, by_parameter)
    value, change = np.full(4, np.nan), np.zeros((4, 2 * n))
    order = np.full(4, np.nan)
    columns, (directions, levels) = marks.levels()
    for j in range(4):
        i, a = kernel.crossing(state, dense, steps, columns[j], levels[j], directions[j] > 0)
        if i < 0:
            continue
        here = np.array([kernel.between(state, dense, i, a, c) for c in range(state.shape[1])])
        order[j] = i + a
        y, rate = here[:, 0].reshape(1 + 3 * n, n), here[:n, 1]
        total = y[1 + n :].T + y[1 : 1 + n].T @ first
        value[j], sees = y[0, EXTENDER], int(columns[j])
        change[j] = total[EXTENDER] - rate[EXTENDER] * total[sees] / rate[sees]
    return _slope_of(circuit, source.period, marks, order, (value, change))


def _slope_of(circuit: Circuit, period: float, marks: Marks, order: Array, extender: tuple[Array, Array]) -> Slope:
    """Return J's slope from the order of the events, and the extender's volume there and its relative slopes."""
    value, change = extender
    score = _score(marks, order[None], value[None], np.zeros(1))
    a, b = float(score.forward[0]), float(score.reverse[0])
    da = np.sign(value[1] - value[0]) * (change[1] - change[0]) if a > 0 else 0 * change[0]
    db = np.sign(value[2] - value[3]) * (change[2] - change[3]) if b > 0 else 0 * change[0]
    total = 2 * (a * db + b * da)
    if marks.objective == "equal":
        total = 2 * a * da + 2 * b * db - np.sign(a - b) * (da - db)
    n = len(circuit.segments)
    coefficients = np.array([segment.valve.coefficient for segment in circuit.segments])
    if not (coefficients > 0).all():
        raise BadInput("circuit", f"a valve is closed: K = {coefficients}", "no derivative by a closed valve's K")
    by_coefficient = total[:n] / coefficients
    return Slope(float(score.objective[0]), by_coefficient, total[n:], float(total[:n].sum()) / period)


@dataclass(frozen=True, kw_only=True)
class Variations:
    """C variants of a circuit: K itself (C, N), factors on stiffness and rest volume (C, N), periods [s] (C,).

    What is None stays as it is. Neighbours should be alike: each begins where the last ones ended.
    """

    coefficient: ArrayLike | None = None
    stiffness: ArrayLike | None = None
    volume: ArrayLike | None = None
    period: ArrayLike | None = None


def _unfold(circuit: Circuit, source: SquareWave, vary: Variations) -> tuple[Array, Array, Array]:
    """Return tables (C, N, W), breaks (C, 3), pieces (C, 2, 4); BadInput where they cannot be."""
    from catheter import circuit_kernel as kernel

    given = {k: np.asarray(v, dtype=np.float64) for k, v in vars(vary).items() if v is not None}
    counts = {len(array) for array in given.values()}
    if len(counts) != 1:
        raise BadInput("variations", f"have {sorted(counts)} rows", "give at least one, all of one length")
    count, n = counts.pop(), len(circuit.segments)
    for name, array in given.items():
        shape = (count,) if name == "period" else (count, n)
        least = 0.0 if name == "coefficient" else 1e-9
        if array.shape != shape or not (np.isfinite(array) & (array >= least)).all():
            raise BadInput(
                f"variations, {name}", f"{array.shape}, least {array.min(initial=np.inf):g}", f"expected {shape} > 0"
            )
    tables = np.repeat(circuit.table()[None], count, axis=0)
    drive = source.drive()
    stretch = given.get("period", np.full(count, source.period)) / source.period
    if "coefficient" in given:
        tables[:, :, kernel.FLOW] = given["coefficient"]
    if "stiffness" in given:
        tables[:, :, kernel.STIFFNESS] = given["stiffness"]
    if "volume" in given:
        tables[:, :, kernel.PER_VOLUME] /= given["volume"]
    return tables, drive.breaks_s * stretch[:, None], np.repeat(drive.pieces[None], count, axis=0)


def sweep(
    circuit: Circuit,
    source: SquareWave,
    marks: Marks,
    vary: Variations,
    *,
    solver: Solver = GRID_SOLVER,
    executor: Executor | None = None,
    chunks: int | None = None,
) -> Score:
    """Return the score of many variants, each brought to its periodic state, in compiled batches.

    executor: whatever runs functions (concurrent.futures, Dask's); by default a thread for each
    core. Raises DidNotConverge naming the first variant that found no periodic state.
    """
    _check_robot(circuit)
    tables, breaks, pieces = _unfold(circuit, source, vary)
    workers = os.cpu_count() or 1
    parts = np.array_split(np.arange(len(tables)), min(len(tables), chunks or 4 * workers))
    pool = executor or ThreadPoolExecutor(workers)
    try:
        pending = [pool.submit(_batch, tables[p], breaks[p], pieces[p], marks, solver) for p in parts]
        events, extender, cycles = (np.concatenate(found) for found in zip(*(p.result() for p in pending), strict=True))
    finally:
        if executor is None:
            pool.shutdown(cancel_futures=True)
    if (cycles <= 0).any():
        at = int(np.flatnonzero(cycles <= 0)[0])
        what = f"variant {at} of {len(cycles)}: no periodic state after {-cycles[at]} cycles"
        raise DidNotConverge(
            f"{what}, {int((cycles <= 0).sum())} such; try another tolerance than {solver.tolerance:g}"
        )
    return _score(marks, events, extender, cycles)


def _batch(tables: Array, breaks: Array, pieces: Array, marks: Marks, solver: Solver) -> tuple[Array, Array, Array]:
    from catheter.circuit_kernel import many

    columns, levels = marks.levels()
    limits: tuple[Any, ...] = (solver.tolerance, Closing().most_cycles, solver.tolerance, solver.most_steps)
    found: Any = many(tables, breaks, pieces, columns, levels, EXTENDER, *limits)
    return tuple(map(np.asarray, found))  # type: ignore[return-value]


def grid_coefficients(count: int = GRID_COUNT, area_step_m2: float = GRID_AREA_M2) -> Array:
    """Return K of 1, 2, ... area steps (count,): the thesis's grid."""
    return np.asarray(np.arange(1, count + 1) * DISCHARGE * area_step_m2 * np.sqrt(2 / DENSITY_KG_M3))


def coefficient_map(
    circuit: Circuit,
    source: SquareWave,
    marks: Marks,
    grid: Array | None = None,
    *,
    solver: Solver = GRID_SOLVER,
    executor: Executor | None = None,
) -> Score:
    """Return the score over K2 and K3 of a grid (G,), cells in rows of K2: reshape objective to (G, G)."""
    axis = grid_coefficients() if grid is None else grid
    second, third = (np.array(part) for part in np.meshgrid(axis, axis, indexing="ij"))
    third[1::2] = third[1::2, ::-1]  # to and fro, so that neighbours in the batch are neighbours on the map
    first = np.full(second.size, circuit.segments[0].valve.coefficient)
    coefficient = np.stack([first, second.ravel(), third.ravel()], axis=1)
    found = sweep(circuit, source, marks, Variations(coefficient=coefficient), solver=solver, executor=executor)
    order = np.arange(second.size).reshape(second.shape)
    order[1::2] = order[1::2, ::-1]
    return Score(*(getattr(found, name)[order.ravel()] for name in vars(found)))
