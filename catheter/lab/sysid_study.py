"""Reports on identification: derivatives, subsets, what is found again, recordings, extreme cases."""

import time
from functools import cache, partial
from typing import Any

import numpy as np

from catheter.actuator import AREA_M2, ML, Servo, move
from catheter.bench import Plant
from catheter.bench_runs import CONSTRAINED, UNCONSTRAINED
from catheter.lab.report import Progress, Report, Row, measure
from data.signal import Array
from sysid.excitation import Chirp

PUBLISHED = {"unconstrained": (UNCONSTRAINED, ("x^3", "x^2", "xdd^2")), "constrained": (CONSTRAINED, ("x^3",))}


@cache
def chirp_truth(seconds: float) -> tuple[Array, Any]:
    """Return (time s, exact motion in mL and s) of the bench's chirp at 83 Hz; 1800 s are the thesis's."""
    from sysid.motion import Motion

    run = move(Servo(), Chirp(duration_s=seconds, start=0.01 if seconds > 1000 else 0.05), 83.0)
    x, xd, xdd = (AREA_M2 / ML * one for one in (run.place_m, run.speed_m_s, run.acceleration_m_s2))
    return run.time_s, Motion(x, xd, xdd, method="exact", half=(0, 0), noise=0.0)


def noisy(value: Array, decibels: float, seed: int) -> Array:
    """Return the value (n,) with white noise at a signal-to-noise ratio of standard deviations, in dB."""
    deviation = float(value.std()) * 10 ** (-decibels / 20)
    return value + deviation * np.random.default_rng(seed).standard_normal(len(value))


def polynomial_force(plant: Plant, motion: Any) -> Array:
    """Return the published force (thesis eq. 3.35, 3.36) over x in mL, (n,) N."""
    x, xdd = motion.position, motion.acceleration
    return np.asarray(plant.cubic * x**3 + plant.square * x**2 + plant.inertia * xdd**2 + plant.constant)


def derivatives(*, quick: bool, progress: Progress) -> Report:
    """Acceleration from a noisy position: three methods, three noise levels."""
    from sysid.motion import DEFAULT, METHODS, motion

    time_s, exact = chirp_truth(180.0 if quick else 1800.0)
    rows, levels = [], (30, 40, 60)
    for done, decibels in enumerate(levels):
        x = noisy(exact.position, decibels, 1)
        for method in METHODS:

            def error_of(found: Any) -> float:
                known = found.known
                wrong = found.acceleration[known] - exact.acceleration[known]
                return float(np.std(wrong) / np.std(exact.acceleration))

            rows.append(measure(method, f"{decibels} dB", partial(motion, time_s, x, method), error_of))
        progress((done + 1) / len(levels))
    return Report(
        name="derivatives",
        title=f"Acceleration of the bench's chirp from a noisy position, {len(time_s)} samples",
        level="signal to noise",
        error="relative error",
        rows=rows,
        notes=[f"The default is {DEFAULT}. Widths are chosen by the noise, by one rule for all methods."],
    )


def selection(*, quick: bool, progress: Progress) -> Report:
    """All 512 subsets: by one reduction, and by non-negative least squares on the raw rows of each."""
    from sysid.identify import TERMS, columns_of
    from sysid.reduction import reduce_rows
    from sysid.selection import select

    _, exact = chirp_truth(180.0 if quick else 1800.0)
    columns = columns_of(exact)
    force = noisy(polynomial_force(UNCONSTRAINED, exact), 40, 1)
    checked = range(5, 512, 64 if quick else 16)
    direct, seconds = _direct(columns, force, checked)
    select(reduce_rows(TERMS, columns[:100], force[:100]))  # what is compiled on first use is not timed
    progress(0.8)

    def error_of(found: Any) -> float:
        scale = np.abs(columns).max(axis=0)
        wrong = [np.abs((found.weights[m] - w[1:]) * scale).max() for m, w in direct.items()]
        return float(max(wrong) / np.abs(force).max())

    ours = measure(
        "this project: QR once, then every subset", f"{len(force)}",
        lambda: select(reduce_rows(TERMS, columns, force), constant_free=False), error_of,
    )  # fmt: skip
    loop = Row(method="scipy nnls on the raw rows, 512 times", level=f"{len(force)}", error=0.0, seconds=seconds)
    return Report(
        name="selection",
        title="All 512 subsets of nine terms: largest difference of a weight from direct solution",
        level="samples",
        error="difference",
        rows=[ours, loop],
        notes=[
            f"{seconds / ours.seconds:.0f} times faster. The loop is timed on {len(direct)} subsets and scaled to 512; "
            "weights are compared on those, times their column's largest value, over the largest force."
        ],
    )


def _direct(columns: Array, force: Array, masks: range) -> tuple[dict[int, Array], float]:
    """Return (weights of the constant and all terms by subset, seconds for 512 such) by scipy on the raw rows."""
    from scipy.optimize import nnls

    whole = np.column_stack([np.ones(len(force)), columns])
    nnls(np.eye(3), np.ones(3))
    found, begun = {}, time.perf_counter()
    for mask in masks:
        kept = [0, *(bit + 1 for bit in range(columns.shape[1]) if (mask >> bit) & 1)]
        weights = np.zeros(whole.shape[1])
        weights[kept] = nnls(whole[:, kept], force)[0]
        found[mask] = weights
    return found, (time.perf_counter() - begun) * 512 / len(masks)


def identification(*, quick: bool, progress: Progress) -> Report:
    """What is put into simulated recordings, and how often and how well it is found again."""
    from catheter.lab.recovery import bench_rows, bias_rows, coverage_rows, measured_rows, terms_rows

    seconds, seeds = (180.0, 10) if quick else (1800.0, 50)
    rows = terms_rows(seconds, seeds)
    progress(0.4)
    rows += coverage_rows(seconds, 4 * seeds)
    progress(0.7)
    rows += bias_rows(seconds, 2 if quick else 5)
    rows += measured_rows(seconds, seeds // 5)
    rows += bench_rows(2 * seeds)
    return Report(
        name="identification",
        title="Simulated recordings: what is found again",
        level="noise",
        error="error",
        rows=rows,
        notes=[
            f"Chirp of {seconds:g} s, published F_unc and F_con, x in mL. 'terms missed': share of {seeds} seeds in "
            f"which a rule did not pick exactly the published terms. 'coverage': share of {4 * seeds} seeds whose "
            "95 % interval holds the truth, less 0.95. 'bias': of the weight on xdd^2 when x, xd, xdd come from the "
            "noisy position.",
            "Contradiction in the thesis: F_unc > F_con for every x > 0 with the printed coefficients, although the "
            "text says that the constrained bender pushes harder.",
        ],
    )


def sysid_recordings(*, quick: bool, progress: Progress, recording: str | None) -> Report:
    """The nine-term model and the models with memory on one recording, in-sample and held out."""
    from pathlib import Path

    from catheter.lab.recording_commands import SHIPPED
    from catheter.lab.replay import Replay
    from data.recording import Recording
    from sysid.estimate import Bootstrap
    from sysid.identify import TERMS, Identify, identify

    resamples = 40 if quick else 400
    with Recording(Path(recording) if recording else SHIPPED) as opened:
        replay = Replay(opened)
        experiment, title, best = replay.experiment, replay.title, replay.best
    if experiment is None or best is None:
        from data.errors import BadInput

        raise BadInput(opened.path, "; ".join(replay.left_out), "name a recording with a response and an input")
    x = experiment.input / (np.abs(experiment.input).max() or 1.0)
    found = identify(experiment.time_s, x, experiment.response, Identify(signed=True), Bootstrap(resamples=resamples))
    progress(1.0)
    spread = found.reduction.response_deviation
    names = " ".join(found.chosen.names[1:]) or "constant only"
    share = dict(zip(TERMS, found.chosen.inclusion["1 %"], strict=True))
    included = ", ".join(f"{name} {100 * part:.0f} %" for name, part in share.items() if part >= 0.05)
    errors = [
        (f"nine terms, 1 % rule: {names}", "in-sample", found.chosen.rmse, found.seconds),
        ("nine terms", "every other tenth held out", found.held_out, found.seconds),
        ("nine terms", "second half held out", found.second_half, found.seconds),
        (f"with memory: {best.model.name}", "in-sample", best.rmse, best.seconds),
        ("with memory", best.split, best.held_out_rmse, best.seconds),
    ]
    rows = [Row(method=name, level=level, error=rmse / spread, seconds=s) for name, level, rmse, s in errors]
    notes = [
        f"Standard deviation of {experiment.response_name}: {spread:.5g}. Nine terms, signed: fit "
        f"{found.chosen.fit_percent:.1f} %, RMSE {found.chosen.rmse:.4g}, held out {found.held_out:.4g}; with memory: "
        f"RMSE {best.rmse:.4g}, held out {best.held_out_rmse:.4g}.",
        f"Included over block-bootstrap resamples: {included or 'none'}.",
        *found.motion.notes,
    ]
    return Report(
        name="sysid-recordings",
        title=f"{title}: error over the response's standard deviation",
        level="data",
        error="RMSE / deviation",
        rows=rows,
        notes=notes,
    )


def sysid_stability(*, quick: bool, progress: Progress) -> Report:
    """Extreme cases: each solved to its optimality conditions, or refused with numbers and a remedy."""
    from catheter.lab.recovery import stability_rows

    rows = stability_rows(20_000 if quick else 7_171_200)
    progress(1.0)
    return Report(
        name="sysid-stability",
        title="Extreme cases: how far the optimality conditions are from holding, or the refusal",
        level="case",
        error="violation",
        rows=rows,
        notes=[
            "Violation: the largest slope of the squares that should be 0 or negative, columns and force of length 1."
        ],
    )
