"""Many variants of the robot's circuit at once: maps over valves, periods, stiffnesses, and build scatter."""

import os
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from catheter.circuit import DENSITY_KG_M3, DISCHARGE, Circuit
from catheter.drive import SquareWave
from catheter.hydraulics import Solver
from catheter.periodic import Closing
from catheter.tuning import EXTENDER, Marks, Score, check_robot, score_of
from data.errors import BadInput, DidNotConverge
from data.options import option
from data.signal import Array

GRID_AREA_M2 = 5e-7  # the thesis's grid step, of orifice area
GRID_COUNT = 118  # K up to K1
GRID_SOLVER = Solver(tolerance=3e-6)
SETTLE = 5.0  # tolerances; integration noise alone can move a slow cell's state by 3


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
    check_robot(circuit)
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
    return score_of(marks, events, extender, cycles)


def _batch(tables: Array, breaks: Array, pieces: Array, marks: Marks, solver: Solver) -> tuple[Array, Array, Array]:
    from catheter.circuit_kernel import many

    columns, levels = marks.levels()
    limits = (SETTLE * solver.tolerance, Closing().most_cycles, solver.tolerance, solver.most_steps)
    compiled: Any = many
    found = compiled(tables, breaks, pieces, columns, levels, EXTENDER, *limits)
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


@dataclass(frozen=True, kw_only=True)
class Scatter:
    """How exactly a robot is built: relative standard deviations of K, stiffness and rest volume.

    The thesis tunes K to 2 %; stiffness and volume are assumed, for parts dipped by hand.
    """

    coefficient: float = option(0.02, least=0.0, most=1.0)
    stiffness: float = option(0.05, least=0.0, most=1.0)
    volume: float = option(0.05, least=0.0, most=1.0)
    samples: int = option(1000, least=1, most=1_000_000)
    seed: int = option(2019, least=0)


def built(
    circuit: Circuit, source: SquareWave, marks: Marks, scatter: Scatter, *, executor: Executor | None = None
) -> Score:
    """Return the score of robots (samples,) built with log-normal scatter about a circuit. Raises as `sweep`."""
    draw = np.random.default_rng(scatter.seed)
    shape = (scatter.samples, len(circuit.segments))
    coefficient = np.array([segment.valve.coefficient for segment in circuit.segments])
    vary = Variations(
        coefficient=coefficient * np.exp(scatter.coefficient * draw.standard_normal(shape)),
        stiffness=np.exp(scatter.stiffness * draw.standard_normal(shape)),
        volume=np.exp(scatter.volume * draw.standard_normal(shape)),
    )
    return sweep(circuit, source, marks, vary, executor=executor)
