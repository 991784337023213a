"""The studies behind `report hydraulics` and `report hydraulics-stability`."""

import itertools
import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from catheter.hydraulics import Circuit, Drive, Run, Solver, SquareWave, simulate, thesis_circuit
from catheter.lab.report import Progress, Report, Row, measure
from catheter.sweep import Variations, coefficient_map, grid_coefficients, sweep
from catheter.tuning import Marks
from data.signal import Array

OURS = "this project"
CELLS = 200
TIMES_S = np.concatenate([t + np.geomspace(1e-6, 0.999, 200) for t in (0.0, 1.0)])  # after both switches


def hydraulics(*, quick: bool, progress: Progress, peers: bool) -> Report:
    """One cycle of the hydraulic circuit and the map over its valves: ours beside scipy's solvers."""
    rows = work_precision_rows(quick=quick, progress=progress)
    rows += _others(quick=quick, peers=peers)
    cells, notes = map_rows(quick=quick, progress=progress)
    return Report(
        name="hydraulics",
        title="The thesis's circuit, laminar transition 1 Pa: error against run time",
        level="tolerance",
        error="largest error of V/V_rest in a cycle; of map rows, of J",
        rows=rows + cells,
        notes=["Truth: our own solution at 1e-13 (a cycle), 1e-12 (cells).", *notes],
    )


def _others(*, quick: bool, peers: bool) -> list[Row]:
    """Return rows of other programs on the same cycle: CVode by our FMU, and FONSim when peers are asked for."""
    from catheter.lab.circuit_peers import cvode_rows, fonsim_rows

    circuit, start = thesis_circuit(1.0), np.array([1.00003, 1.0028, 1.0925])
    reference = simulate(circuit, SquareWave().drive(), start, Solver(tolerance=1e-13))
    rows = cvode_rows(circuit, start, reference, tuple(10.0 ** -np.arange(3.0, 7.0 if quick else 12.0)))
    return rows + (
        fonsim_rows(circuit, start, reference, (1e-2, 1e-3) if quick else (1e-2, 1e-3, 1e-4)) if peers else []
    )


def hydraulics_stability(*, quick: bool, progress: Progress) -> Report:
    """Stiff and extreme cases of the hydraulic circuit: each solved to its tolerance, or refused."""
    rows, notes = stability_rows(quick=quick, progress=progress)
    return Report(
        name="hydraulics-stability",
        title="Extreme circuits at tolerance 1e-6: solved to it, or refused",
        level="case",
        error="largest error of V/V_rest, relative above 1",
        rows=rows,
        notes=["Truth: our own solution at 1e-11; beside it Radau at 1e-10.", *notes],
    )


def python_slope(circuit: Circuit, pressure_pa: float) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return dx/dt and its Jacobian in plain Python, as a user of scipy would write them, at a constant source."""
    parts = [(s.accumulator, s.valve) for s in circuit.segments]
    n = len(parts)
    laws = [(a.linear_range[0], a.coefficients, a.rest_volume, v.coefficient, _transition(v)) for a, v in parts]

    def links(x: Array) -> tuple[list[float], list[float], list[float]]:
        before, slopes, flows, rates = pressure_pa, [], [], []
        for k, (low, c, _, coefficient, d) in enumerate(laws):
            inside = max(float(x[k]), low)
            p = slope = 0.0
            for factor in (*c[::-1], 0.0):
                slope = slope * inside + p
                p = p * inside + factor
            p += slope * (float(x[k]) - inside)
            drop = before - p
            w = drop * drop + d * d
            slopes.append(slope)
            flows.append(coefficient * drop / w**0.25)
            rates.append(coefficient * (0.5 * drop * drop + d * d) / w**1.25)
            before = p
        return slopes, [*flows, 0.0], [*rates, 0.0]

    def derivative(t: float, x: Array) -> list[float]:
        flows = links(x)[1]
        return [(flows[k] - flows[k + 1]) / laws[k][2] for k in range(n)]

    def jacobian(t: float, x: Array) -> Array:
        slopes, _, rates = links(x)
        made = np.zeros((n, n))
        for k in range(n):
            made[k, k] = -(rates[k] + rates[k + 1]) * slopes[k] / laws[k][2]
            if k:
                made[k, k - 1] = rates[k] * slopes[k - 1] / laws[k][2]
                made[k - 1, k] = rates[k] * slopes[k] / laws[k - 1][2]
        return made

    return derivative, jacobian


def numpy_slope(circuit: Circuit, pressure_pa: float) -> Callable[..., Any]:
    """Return dx/dt in numpy, as the equations are usually typed in: no Jacobian, every line a vector."""
    springs = [segment.accumulator for segment in circuit.segments]
    volume = np.array([spring.rest_volume for spring in springs])
    low = np.array([spring.linear_range[0] for spring in springs])
    laws = np.array([spring.coefficients for spring in springs])
    factor = np.array([segment.valve.coefficient for segment in circuit.segments])
    transition = np.array([_transition(segment.valve) for segment in circuit.segments])
    powers = np.arange(1, laws.shape[1] + 1)

    def derivative(t: float, x: Array) -> Array:
        inside = np.maximum(x, low)[:, None]
        pressure = (laws * inside**powers).sum(axis=1)
        slope = (laws * powers * inside ** (powers - 1)).sum(axis=1)
        pressure += slope * (x - inside[:, 0])
        drop = -np.diff(pressure, prepend=pressure_pa)
        flow = factor * drop / (drop**2 + transition**2) ** 0.25
        return np.asarray(-np.diff(flow, append=0.0) / volume)

    return derivative


def _transition(valve: Any) -> float:
    return float(valve.transition)


def python_cycle(
    circuit: Circuit, method: str, tolerance: float, start: Array, *, plain: bool = False
) -> tuple[Array, Any]:
    """Return the end (N,) of one thesis cycle by scipy with Python functions, and both halves' dense outputs.

    Restarted at the switch, rtol = tolerance, atol = rtol/100. plain: numpy and no Jacobian, as it is
    usually typed in; otherwise plain floats and the exact Jacobian, the best that Python does.
    """
    from scipy.integrate import solve_ivp

    x, halves = start, []
    for pressure, left in ((83e3, 0.0), (0.0, 1.0)):
        derivative, jacobian = (numpy_slope(circuit, pressure), None) if plain else python_slope(circuit, pressure)
        extra: dict[str, Any] = {} if method == "RK45" or plain else {"jac": jacobian}
        solve: Any = solve_ivp
        limits = {"rtol": max(tolerance, 2.3e-14), "atol": tolerance / 100}
        found = solve(derivative, (left, left + 1.0), x, method=method, dense_output=True, **limits, **extra)
        if not found.success:
            raise RuntimeError(found.message)
        x = found.y[:, -1]
        halves.append(found.sol)
    return x, halves


def work_precision_rows(*, quick: bool, progress: Progress) -> list[Row]:
    """Error of one thesis cycle against seconds: every solver restarted at the switch, at the same transition."""
    circuit, drive = thesis_circuit(1.0), SquareWave().drive()
    start = np.array([1.00003, 1.0028, 1.0925])
    reference = simulate(circuit, drive, start, Solver(tolerance=1e-13)).at(TIMES_S)

    def of_run(run: object) -> float:
        assert isinstance(run, Run)
        return float(np.abs(run.at(TIMES_S) - reference).max())

    def of_halves(found: object) -> float:
        first, second = found[1]  # type: ignore[index]
        values = np.hstack([first(TIMES_S[TIMES_S < 1]), second(TIMES_S[TIMES_S >= 1])]).T
        return float(np.abs(1.0 + values - reference).max())

    rows, levels = [], 10.0 ** -np.arange(3, 8 if quick else 13)
    for done, tolerance in enumerate(levels):
        level = f"{tolerance:.0e}"
        solver = Solver(tolerance=float(tolerance))
        rows.append(measure(OURS, level, partial(simulate, circuit, drive, start, solver), of_run))
        for method in ("LSODA", "Radau", "BDF"):
            compiled = replace(solver, method=method)
            run = partial(simulate, circuit, drive, start, compiled)
            rows.append(measure(f"scipy {method}, our compiled functions", level, run, of_run))
        for method in ("LSODA", "Radau", "BDF", "RK45"):
            if method == "RK45" and tolerance < 1e-9:  # explicit: 10 s and more
                continue
            call = partial(python_cycle, circuit, method, float(tolerance), start - 1.0)
            rows.append(measure(f"scipy {method}, Python functions", level, call, of_halves))
        progress((done + 1) / (2 * len(levels)))
    return rows


def _python_cell(circuit: Circuit, tolerance: float, *, plain: bool) -> float:
    """Return J of one map cell the plain way: LSODA cycle after cycle until it closes to 1e-6, then events."""
    from scipy.optimize import brentq

    x = circuit.volume(0.0) - 1.0
    for _ in range(40):
        end, halves = python_cycle(circuit, "LSODA", tolerance, x, plain=plain)
        closed = np.abs(end - x).max() < 1e-6
        x = end
        if closed:
            break
    times, v = [], []
    for half, (left, right), k, level in (
        *((halves[0], (0.0, 1.0), 0, 0.30), (halves[0], (0.0, 1.0), 2, 0.13)),
        *((halves[1], (1.0, 2.0), 0, 0.13), (halves[1], (1.0, 2.0), 2, 0.30)),
    ):
        ends = [half(t)[k] - level for t in (left, right)]
        if ends[0] * ends[1] > 0:
            return 0.0

        def miss(t: float, half: Any = half, k: int = k, level: float = level) -> float:
            return float(half(t)[k] - level)

        times.append(brentq(miss, left, right, xtol=1e-12))
        v.append(half(times[-1])[1])
    if times[1] <= times[0]:
        return 0.0
    return float(2 * abs(v[1] - v[0]) * abs(v[2] - v[3]))


def map_rows(*, quick: bool, progress: Progress) -> tuple[list[Row], list[str]]:
    """Seconds a cell and error in J of the K2-K3 map: ours, and LSODA with Python functions on the same cells."""
    circuit, marks, grid = thesis_circuit(1.0), Marks(), grid_coefficients()
    chosen = np.sort(np.random.default_rng(2019).choice(len(grid) ** 2, 5 if quick else CELLS, replace=False))
    coefficient = np.stack([np.full(len(chosen), 1.64e-6), grid[chosen // len(grid)], grid[chosen % len(grid)]], axis=1)
    exact = sweep(circuit, SquareWave(), marks, Variations(coefficient=coefficient), solver=Solver(tolerance=1e-12))
    rows, notes = [], []
    for tolerance in (1e-4, 1e-5) if quick else (1e-4, 1e-5, 1e-6):
        solver = Solver(tolerance=tolerance)
        spent = []
        for _ in range(1 if quick else 5):
            started, used = time.perf_counter(), time.process_time()
            whole = coefficient_map(circuit, SquareWave(), marks, solver=solver)
            spent.append((time.perf_counter() - started, time.process_time() - used))
        seconds, used = np.min(spent, axis=0)
        error = float(np.abs(whole.objective[chosen] - exact.objective).max())
        cells = whole.objective.size
        name = "K map, a cell: this project, core time"
        rows.append(Row(method=name, level=f"{tolerance:.0e}", error=error, seconds=used / cells))
        notes.append(
            f"Map at tolerance {tolerance:g}: {cells} cells, {int(whole.cycles.sum())} cycles, {seconds:.2f} s on all "
            f"cores ({used:.2f} s of core time), error in J {error:.1e} on {len(chosen)} random cells."
        )
    ways = {"numpy functions": True, "Python floats and exact Jacobian": False}
    for done, (tolerance, way) in enumerate(itertools.product((1e-5, 1e-6, 1e-7), ways)):
        started = time.process_time()
        found = [_python_cell(circuit.with_coefficients(*k), tolerance, plain=ways[way]) for k in coefficient]
        used = time.process_time() - started
        error = float(np.abs(np.array(found) - exact.objective).max())
        name = f"K map, a cell: scipy LSODA, {way}"
        rows.append(Row(method=name, level=f"{tolerance:.0e}", error=error, seconds=used / len(chosen)))
        notes.append(
            f"LSODA, {way}, at {tolerance:g}: {1e3 * used / len(chosen):.1f} ms a cell, error in J "
            f"{error:.1e}; the whole map on one core would take {used / len(chosen) * cells:.0f} s (extrapolated)."
        )
        progress(0.5 + (done + 1) / 12)
    return rows, notes


def extremes() -> dict[str, tuple[Circuit, Drive]]:
    """Return the stiff and extreme cases, each a circuit and a drive; all start at V = 1, unstable in actuator 3."""
    base, cycle = thesis_circuit(1.0), SquareWave().drive()

    def valves(ratio: float) -> Circuit:
        return base.with_coefficients(1.64e-6, 1.64e-6 / math.sqrt(ratio), 1.64e-6 / ratio)

    def volumes(factor: float) -> Circuit:
        springs = [replace(s.accumulator, rest_volume=s.accumulator.rest_volume * factor) for s in base.segments]
        return Circuit(segments=tuple(replace(s, accumulator=a) for s, a in zip(base.segments, springs, strict=True)))

    return {
        "K1/K3 = 1e6": (valves(1e6), cycle),
        "K1/K3 = 1e9": (valves(1e9), cycle),
        "volumes x 1e-3": (volumes(1e-3), cycle),
        "volumes x 1e-6": (volumes(1e-6), cycle),
        "0.01 Hz": (base, SquareWave(period=100.0).drive()),
        "500 Hz": (base, SquareWave(period=2e-3).drive(10)),
        "source 10 MPa": (base, SquareWave(high=1e7).drive()),
        "source -3 kPa": (base, SquareWave(high=-3e3).drive()),
        "source -50 kPa": (base, SquareWave(high=-5e4).drive()),
        "valve 2 closed": (base.with_coefficients(1.64e-6, 0.0, 4.3e-8), cycle),
        "equal pressures": (base, SquareWave(high=0.0).drive()),
        "actuator 3 at V = 1": (base, cycle),
    }


def stability_rows(*, quick: bool, progress: Progress) -> tuple[list[Row], list[str]]:
    """Every extreme case by ours and scipy's stiff solvers at one tolerance: solved to it, or refused."""
    from data.errors import CatheterError

    tolerance, rows, notes, cases = 1e-6, [], [], extremes()
    for done, (name, (circuit, drive)) in enumerate(cases.items()):
        start = np.ones(len(circuit.segments))
        edges = np.linspace(0.0, 1.0, 200) ** 3
        times = np.concatenate([a + (b - a) * edges for a, b in zip(drive.breaks_s, drive.breaks_s[1:], strict=False)])
        try:
            reference = simulate(circuit, drive, start, Solver(tolerance=1e-11)).at(times)
            radau = simulate(circuit, drive, start, Solver(tolerance=1e-10, method="Radau")).at(times)
            notes.append(f"{name}: our reference and Radau at 1e-10 differ by {np.abs(radau - reference).max():.1e}.")
        except CatheterError as error:
            reference = np.full((len(times), len(start)), np.nan)
            notes.append(f"{name}: {error}")

        def error_of(run: object, times: Array = times, reference: Array = reference) -> float:
            assert isinstance(run, Run)
            return float((np.abs(run.at(times) - reference) / np.maximum(1.0, reference)).max())

        for method in ("rodas5p",) if quick else ("rodas5p", "Radau", "BDF", "LSODA"):
            solver = Solver(tolerance=tolerance, method=method)
            label = OURS if method == "rodas5p" else f"scipy {method}, our compiled functions"
            rows.append(measure(label, name, partial(simulate, circuit, drive, start, solver), error_of))
        if not rows[-1].failed and np.isfinite(reference).all():
            books = simulate(circuit, drive, start, Solver(tolerance=tolerance)).accounting_error()
            notes.append(f"{name}: inflow and stored volume differ by {books / tolerance:.2f} tolerances.")
        progress((done + 1) / len(cases))
    return rows, notes
