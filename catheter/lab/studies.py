"""The numerical studies behind the reports: each returns rows of method, level, error, seconds."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from catheter.lab.report import Progress, Report, Row, measure
from data.signal import Array


def regression(*, quick: bool, progress: Progress) -> Report:
    """Non-negative least squares on a bender's chirp whose weights are known exactly."""
    return Report(
        name="regression",
        title="Non-negative least squares, 10 terms of a bender's chirp: error against run time",
        level="samples",
        error="relative error",
        rows=regression_rows((1_000, 10_000) if quick else (1_000, 10_000, 149_400), progress),
        notes=["Truth: force made from known weights, without noise; terms of thesis eq. 3.28 in SI."],
    )


def hysteresis(*, quick: bool, progress: Progress, recording: str | None) -> Report:
    """Models with memory by number of operators, on a recording."""
    counts = (1, 3, 5, 9) if quick else (1, 2, 3, 4, 5, 7, 10, 15, 20)
    rows, what = hysteresis_rows(recording, counts, progress)
    return Report(
        name="hysteresis",
        title=f"Models with memory, {what}",
        level="operators",
        error="RMSE held out",
        rows=rows,
        notes=["A replay uses 5 operators."],
    )


def _chirp_columns(samples: int) -> tuple[Array, Array]:
    """Return thesis eq. 3.28's regressors in SI over an exact chirp, (n, 10), and true weights."""
    time_s = np.arange(samples) / 83.0
    total = samples / 83.0
    rate = 2 * np.pi * 0.01
    length = total / np.log(500.0)
    phase = rate * length * np.expm1(time_s / length)
    x = 14.5e-6 * (1 + np.sin(phase))
    velocity = 14.5e-6 * np.cos(phase) * rate * np.exp(time_s / length)
    acceleration = np.gradient(velocity, time_s)
    columns = np.stack([np.ones(samples), *(s**n for s in (x, velocity, acceleration) for n in (3, 2, 1))], axis=1)
    scale = np.abs(columns).max(axis=0)
    return columns, np.array([1, 5, 3, 2, 0.5, 0, 0.7, 0.3, 0.2, 0]) / scale


def regression_rows(sizes: Sequence[int], progress: Progress) -> list[Row]:
    """Compare our reduced solver with what a user would call instead, on the same rows."""
    from scipy.optimize import lsq_linear, nnls

    from sysid.nonnegative import solve

    def gram(columns: Array, target: Array) -> Array:
        factor = np.linalg.cholesky(columns.T @ columns)
        return np.asarray(nnls(factor.T, np.linalg.solve(factor, columns.T @ target))[0])

    def scaled(solver: Callable[[Array, Array], Array]) -> Callable[[Array, Array], Array]:
        def solve_scaled(columns: Array, target: Array) -> Array:
            scale = np.abs(columns).max(axis=0)
            return np.asarray(solver(columns / scale, target) / scale)

        return solve_scaled

    methods: dict[str, Callable[[Array, Array], Array]] = {
        "this project: QR by blocks, then NNLS": lambda X, y: solve(X, y, 0).weights,
        "Gram matrix of scaled columns, then NNLS": scaled(gram),
        "scipy nnls, scaled raw rows": scaled(lambda X, y: nnls(X, y)[0]),
        "scipy nnls, raw rows in SI": lambda X, y: nnls(X, y)[0],
        "scipy lsq_linear, scaled raw rows": scaled(lambda X, y: lsq_linear(X, y, bounds=(0, np.inf), tol=1e-14).x),
    }
    rows = []
    solve(np.eye(3), np.ones(3), 0)  # what is imported on first use is not timed
    for done, size in enumerate(sizes):
        columns, truth = _chirp_columns(size)
        target, scale = columns @ truth, np.abs(columns).max(axis=0)

        def error_of(weights: object, truth: Array = truth, scale: Array = scale) -> float:
            return float(np.abs((np.asarray(weights) - truth) * scale).max() / (truth * scale).max())

        for name, method in methods.items():
            rows.append(measure(name, f"{size}", partial(method, columns, target), error_of))
        progress((done + 1) / len(sizes))
    return rows


def hysteresis_rows(recording: str | None, counts: Sequence[int], progress: Progress) -> tuple[list[Row], str]:
    """Fit play and stop models with more and more operators; return rows and what they stand on."""
    from catheter.lab.recording_commands import SHIPPED
    from catheter.lab.replay import Replay
    from data.errors import BadInput
    from data.recording import Recording
    from sysid.fit import SPLITS, Fit, Model, compare
    from sysid.terms import Other, Play, Power, Stop, Term

    with Recording(Path(recording) if recording else SHIPPED) as opened:
        replay = Replay(opened)
        experiment = replay.experiment
        if experiment is None:
            raise BadInput(opened.path, "has no response and input", "name a recording that a replay can model")
        base: tuple[Term, ...] = (*map(Power, range(4)), *map(Other, replay.ask.others))
        split = SPLITS[replay.ask.split](experiment)
        rows = []
        for done, count in enumerate(counts):
            shares = np.geomspace(0.002, 0.9, count) if count > 1 else np.array([0.02])
            plays: tuple[Term, ...] = tuple(map(Play, shares))
            stops: tuple[Term, ...] = tuple(map(Stop, shares))
            for name, model in (
                ("play operators, weights >= 0", Model("play", base, plays)),
                ("play operators, signed", Model("play signed", base + plays)),
                ("stop operators, weights >= 0", Model("stop", base, stops)),
            ):
                fits: list[Fit] = [compare([model], experiment, split)[0] for _ in range(3)]
                seconds = min(fit.seconds for fit in fits)
                rows.append(Row(method=name, level=f"{count}", error=fits[0].held_out_rmse, seconds=seconds))
            progress((done + 1) / len(counts))
        signal = replay.signals[replay.ask.response]
        unit = signal.unit if signal.documented else "undocumented"
        return rows, f"{replay.title}: RMSE of {replay.ask.response} [{unit}], {split.name}"
