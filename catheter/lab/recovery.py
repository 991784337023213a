"""Rows of the identification reports: truth put in, truth found again; extreme cases."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from catheter.actuator import AREA_M2, Servo
from catheter.bench_runs import (
    AccumulatorBench,
    ConeValve,
    PressureRamp,
    Sensors,
    ValveBench,
    accumulator,
    cracking,
    valve,
)
from catheter.lab.report import Row
from catheter.lab.sysid_study import PUBLISHED, chirp_truth, noisy, polynomial_force
from data.errors import CatheterError
from data.signal import Array
from sysid.accumulator import fit_accumulator
from sysid.estimate import standard_errors
from sysid.excitation import Sine, Steps
from sysid.identify import TERMS, columns_of, identify, reduce_stream
from sysid.motion import METHODS, motion
from sysid.orifice import fit_cracking, fit_orifice
from sysid.reduction import Reduction, reduce_rows
from sysid.selection import RULES, Selection, select


def terms_rows(seconds: float, seeds: int) -> list[Row]:
    """How often each rule misses the published terms, for exact regressors."""
    _, exact = chirp_truth(seconds)
    columns, rows = columns_of(exact), []
    for loading, (plant, terms) in PUBLISHED.items():
        clean = polynomial_force(plant, exact)
        for decibels in (40, 20):
            begun, missed = time.perf_counter(), dict.fromkeys(RULES, 0)
            for seed in range(seeds):
                found = select(reduce_rows(TERMS, columns, noisy(clean, decibels, seed)))
                for rule in RULES:
                    missed[rule] += set(found.names(found.choose(rule))) != set(terms)
            spent = (time.perf_counter() - begun) / seeds
            rows += [
                Row(method=f"{loading}: terms missed, {rule}", level=f"{decibels} dB", error=n / seeds, seconds=spent)
                for rule, n in missed.items()
            ]
    return rows


def coverage_rows(seconds: float, seeds: int) -> list[Row]:
    """How far the 95 % intervals' coverage is from 0.95, for exact regressors at 40 dB."""
    _, exact = chirp_truth(seconds)
    columns, rows = columns_of(exact), []
    for loading, (plant, terms) in PUBLISHED.items():
        clean, begun = polynomial_force(plant, exact), time.perf_counter()
        weights = {"1": plant.constant, "x^3": plant.cubic, "x^2": plant.square, "xdd^2": plant.inertia}
        inside: dict[str, int] = dict.fromkeys(("1", *terms), 0)
        for seed in range(seeds):
            reduction = reduce_rows(TERMS, columns, noisy(clean, 40, 1000 + seed))
            found = select(reduction)
            mask = found.mask(terms)
            errors = standard_errors(reduction, found, mask)[0]
            values = [found.constants[mask], *(found.weights[mask, TERMS.index(n)] for n in found.names(mask))]
            for name, value, error in zip(("1", *found.names(mask)), values, errors, strict=True):
                inside[name] += abs(value - weights[name]) <= 1.959964 * error
        spent = (time.perf_counter() - begun) / seeds
        rows += [
            Row(method=f"{loading}: coverage of {name}", level="40 dB", error=n / seeds - 0.95, seconds=spent)
            for name, n in inside.items()
        ]
    return rows


def bias_rows(seconds: float, seeds: int) -> list[Row]:
    """Bias of the weight on xdd^2 when the regressors come from the noisy position."""
    time_s, exact = chirp_truth(seconds)
    plant, terms = PUBLISHED["unconstrained"]
    clean, rows = polynomial_force(plant, exact), []
    for method in METHODS:
        for decibels in (40, 60):
            begun, biases = time.perf_counter(), []
            for seed in range(1 if method.startswith("Kalman") else seeds):  # it takes a hundred times longer
                moved = motion(time_s, noisy(exact.position, decibels, seed), method)
                force = noisy(clean, 40, 500 + seed)[moved.known]
                found = select(reduce_rows(TERMS, columns_of(moved)[moved.known], force))
                biases.append(found.weights[found.mask(terms), TERMS.index("xdd^2")] / plant.inertia - 1)
            spent = (time.perf_counter() - begun) / len(biases)
            level = f"{decibels} dB position"
            rows.append(Row(method=f"bias, {method}", level=level, error=float(np.mean(biases)), seconds=spent))
    return rows


def measured_rows(seconds: float, seeds: int) -> list[Row]:
    """How often each rule misses the published terms when x, xd, xdd come from a position at 40 dB too."""
    time_s, exact = chirp_truth(seconds)
    rows = []
    for loading, (plant, terms) in PUBLISHED.items():
        clean, begun, missed = polynomial_force(plant, exact), time.perf_counter(), dict.fromkeys(RULES, 0)
        cubic = []
        for seed in range(seeds):
            moved = motion(time_s, noisy(exact.position, 40, seed))
            force = noisy(clean, 40, 500 + seed)[moved.known]
            found = select(reduce_rows(TERMS, columns_of(moved)[moved.known], force))
            cubic.append(found.weights[found.mask(terms), 0] / plant.cubic - 1)
            for rule in RULES:
                missed[rule] += set(found.names(found.choose(rule))) != set(terms)
        spent, level = (time.perf_counter() - begun) / seeds, "40 dB force and position"
        rows += [
            Row(method=f"{loading}: terms missed, {rule}", level=level, error=n / seeds, seconds=spent)
            for rule, n in missed.items()
        ]
        rows.append(Row(method=f"{loading}: bias of x^3", level=level, error=float(np.mean(cubic)), seconds=spent))
    return rows


def bench_rows(seeds: int) -> list[Row]:
    """Valve coefficient and advice, cracking pressures, accumulator: the largest errors over the seeds."""
    wrong, advice, strokes = [], 0, time.perf_counter()
    for seed in range(seeds):
        off = np.random.default_rng(seed).choice([-1, 1]) * np.random.default_rng(seed + 1).uniform(0.03, 0.2)
        truth = 3.05e-7 * (1 + off)
        run = valve(
            Steps(most=2.355), Servo(), ValveBench(coefficient=truth), Sensors(volume_db=34, pressure_db=34, seed=seed)
        )
        found = fit_orifice(*valve_signals(run), area_m2=AREA_M2)
        wrong.append(abs(found.coefficient / truth - 1))
        advice += found.advice(3.05e-7) != ("tighten" if off > 0 else "loosen")
    each = (time.perf_counter() - strokes) / seeds
    cracks, begun = [], time.perf_counter()
    missed = 0
    for seed in range(max(5, seeds // 5)):
        run = cracking(PressureRamp(), ConeValve(), Sensors(rate=500.0, seed=seed))
        for one in fit_cracking(run.signals["/pressure", "pressure"], run.signals["/flow", "flow"]):
            limit = float(run.truth[f"valve.{one.direction}"].split()[0])
            cracks.append(abs(one.pressure_pa / limit - 1))
            missed += not one.low_pa <= limit <= one.high_pa
    crack_s = (time.perf_counter() - begun) / max(5, seeds // 5)
    run = accumulator(Sine(amplitude=1.45), Servo(), AccumulatorBench(), Sensors(rate=100.0))
    begun = time.perf_counter()
    fitted = fit_accumulator(run.signals["/volume", "ratio"], run.signals["/pressure", "pressure"])
    took = time.perf_counter() - begun
    truths = np.array([float(run.truth[f"accumulator.c{n}"].split()[0]) for n in range(1, 5)])
    off_by = float(np.abs(fitted.coefficients / truths - 1).max()) if fitted.order == 4 else float("nan")
    return [
        Row(method="valve K, largest error", level="34 dB", error=max(wrong), seconds=each),
        Row(method="valve advice, share wrong", level="34 dB", error=advice / seeds, seconds=each),
        Row(method="cracking pressure, largest error", level="40 dB", error=max(cracks), seconds=crack_s),
        Row(method="cracking, intervals that miss", level="40 dB", error=missed / len(cracks), seconds=crack_s),
        Row(method=f"accumulator, order {fitted.order}, worst c", level="50 dB", error=off_by, seconds=took),
    ]


def valve_signals(run: Any) -> tuple[Array, Array, Array, Array]:
    """Return (time s, place m, pressure drop Pa, command V) of a valve run."""
    signals = run.signals
    drop = signals["/pressure/1", "pressure"] - signals["/pressure/2", "pressure"]
    return run.time_s, signals["/stroke", "displacement"], drop, signals["/drive", "command"]


def violation(reduction: Reduction, found: Selection) -> float:
    """Return how far the optimality conditions are from holding, over all subsets, all lengths made 1."""
    total = reduction.total
    matrix, target = total[1:, 1:-1], total[1:, -1]
    length = np.linalg.norm(matrix, axis=0)
    length = np.where(length > 0, length, 1)
    size = float(np.linalg.norm(target)) or 1.0
    slopes = (target - found.weights @ matrix.T) @ (matrix / length) / size
    allowed = (np.arange(len(slopes))[:, None] >> np.arange(len(length))) & 1 == 1
    active = np.abs(np.where(found.weights > 0, slopes, 0.0)).max()
    return float(max(active, np.where(allowed & (found.weights == 0), slopes, 0.0).max(), -found.weights.min()))


def stability_rows(long: int) -> list[Row]:
    """Solve or refuse the extreme cases of the issue; `long` is the streamed recording's samples."""
    draw = np.random.default_rng(3)
    plain = draw.normal(size=(3000, 3))
    names = ("a", "b", "c")
    close = np.column_stack([plain[:, 0], plain[:, 0] + 1e-12 * plain[:, 1], plain[:, 2]])
    clock, wave = np.arange(3000) / 83, np.sin(np.arange(3000) / 40) * 10 + 12
    torn = wave.copy()
    torn[500:700] = torn[1500:1510] = np.nan
    cases: dict[str, Callable[[], float]] = {
        "collinear, condition 1e12": lambda: _solved(names, close, close @ np.ones(3) + plain[:, 1]),
        "1e9 between columns": lambda: _solved(names, plain * [1e-9, 1, 1e9], plain @ np.ones(3) + plain[:, 1]),
        "all-zero force": lambda: _solved(names, plain, np.zeros(3000)),
        "NaN stretches": lambda: _identified(clock, torn, wave**3),
        "constant input": lambda: _identified(clock, np.full(3000, 7.0), wave),
        "one sample": lambda: _identified(clock[:1], wave[:1], wave[:1]),
        "NaN in the rows": lambda: _solved(names, plain * [np.nan, 1, 1], plain[:, 0]),
        f"{long} samples streamed": lambda: _streamed(long),
    }
    rows = []
    for name, case in cases.items():
        begun, failed, error = time.perf_counter(), "", float("nan")
        try:
            error = case()
        except CatheterError as refusal:
            failed = f"refused: {refusal}"
        rows.append(Row(method=name, level="", error=error, seconds=time.perf_counter() - begun, failed=failed))
    return rows


def _solved(names: tuple[str, ...], columns: Array, response: Array) -> float:
    reduction = reduce_rows(names, columns, response)
    return violation(reduction, select(reduction))


def _identified(time_s: Array, x: Array, y: Array) -> float:
    found = identify(time_s, x, y)
    return violation(found.reduction, found.selection)


def _streamed(samples: int) -> float:
    def pieces() -> Iterator[tuple[Array, Array, Array]]:
        draw = np.random.default_rng(0)
        for first in range(0, samples, 300_000):
            time_s = np.arange(first, min(samples, first + 300_000)) / 83
            x = 14 + 12 * np.sin(time_s / 3) + 0.01 * draw.standard_normal(len(time_s))
            yield time_s, x, 7.88e-4 * x**3 + 0.05 * draw.standard_normal(len(time_s))

    reduction = reduce_stream(pieces())
    return violation(reduction, select(reduction))
