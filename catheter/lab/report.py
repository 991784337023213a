"""Error against run time: methods at several levels, side by side in one run, failures kept."""

import csv
import json
import math
import os
import platform
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from data.errors import BadInput, CannotWrite, CatheterError
from data.files import fresh

Progress = Callable[[float], None]


@dataclass(frozen=True, kw_only=True)
class Row:
    """One method at one level. A method that failed keeps its row: error NaN, `failed` says why."""

    method: str
    level: str
    error: float
    seconds: float
    failed: str = ""

    @property
    def error_text(self) -> str:
        """The error, or why there is none."""
        return self.failed or f"{self.error:.3g}"


@dataclass(frozen=True, kw_only=True)
class Report:
    """A finished report: what the levels and the error are, and a row for each method and level."""

    name: str
    title: str
    level: str
    error: str
    rows: list[Row]
    notes: list[str] = field(default_factory=list)
    draw: Callable[[Any], None] | None = None  # on a matplotlib figure, where a picture of its own says more


def measure(method: str, level: str, solve: Callable[[], object], error_of: Callable[[object], float]) -> Row:
    """Time a solve, the fastest of 5 or of what fits in half a second, and measure its error.

    A solve that fails is a row that says so.
    """
    seconds, total = math.inf, 0.0
    for _ in range(5):
        started = time.perf_counter()
        try:
            answer = solve()
        except (CatheterError, ValueError, RuntimeError, ArithmeticError, np.linalg.LinAlgError) as error:
            spent = time.perf_counter() - started
            return Row(method=method, level=level, error=math.nan, seconds=spent, failed=f"failed: {error}"[:60])
        spent = time.perf_counter() - started
        seconds, total = min(seconds, spent), total + spent
        if total > 0.5:
            break
    return Row(method=method, level=level, error=error_of(answer), seconds=seconds)


def machine() -> dict[str, str]:
    """Return what the numbers were made on: machine, versions, commit, date."""
    root = Path(__file__).parents[2]
    git = ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=12"]
    try:
        commit = subprocess.run(git, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        commit = "not a git checkout"
    packages = ("numpy", "scipy", "numba", "mcap")
    return {
        "machine": f"{platform.machine()} {_processor()}, {os.cpu_count()} cores, {platform.system()}",
        "python": platform.python_version(),
        **{name: version(name) for name in packages},
        "commit": commit,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "")


def paths(name: str, folder: Path) -> list[Path]:
    """Return the files a report writes."""
    return [folder / f"{name}.{ending}" for ending in ("csv", "json", "png")]


def write(report: Report, folder: Path) -> list[Path]:
    """Write NAME.csv, NAME.png and NAME.json (machine, versions, notes) into a folder; return them.

    Files of an earlier run are replaced: ask `paths` first. Raises CannotWrite.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CannotWrite(folder, f"cannot be made a folder: {error.strerror}") from error
    places = paths(report.name, folder)
    with fresh(places[0], replace=True) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["method", report.level, report.error, "seconds", "failed", "report"])
        writer.writerows([r.method, r.level, r.error, r.seconds, r.failed, report.title] for r in report.rows)
    with fresh(places[1], replace=True) as temporary:
        about = {"title": report.title, "notes": report.notes, **machine()}
        temporary.write_text(json.dumps(about, indent=1), encoding="utf-8")
    with fresh(places[2], replace=True) as temporary:
        _draw(report, temporary)
    return places


def _draw(report: Report, path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 5.5), layout="constrained")
    if report.draw:
        report.draw(figure)
    else:
        _plot_errors(report, figure)
    figure.savefig(path, format="png", dpi=130)


def _plot_errors(report: Report, figure: Any) -> None:
    axes = figure.add_subplot()
    for marker, method in zip("osD^v<>pXh" * 3, dict.fromkeys(row.method for row in report.rows), strict=False):
        rows = [row for row in report.rows if row.method == method and math.isfinite(row.error)]
        axes.loglog([r.seconds for r in rows], [r.error for r in rows], marker=marker, label=method)
    if any(row.error == 0 for row in report.rows):  # exact answers have no place on a logarithmic axis
        least = min((row.error for row in report.rows if row.error > 0), default=1.0)
        axes.set_yscale("symlog", linthresh=least)
    axes.set_xlabel("seconds")
    axes.set_ylabel(report.error)
    axes.set_title(report.title, fontsize=10, parse_math=False)
    axes.grid(visible=True, which="both", alpha=0.3)
    axes.legend(fontsize=8)


def _refuse(recording: str | None, name: str) -> None:
    if recording is not None:
        raise BadInput("--recording", f"given for the {name} report", "it makes its own data")


def regression(*, quick: bool, recording: str | None, progress: Progress) -> Report:
    """Non-negative least squares on a bender's chirp whose weights are known exactly."""
    _refuse(recording, "regression")
    from catheter.lab.studies import regression_rows

    return Report(
        name="regression",
        title="Non-negative least squares, 10 terms of a bender's chirp: error against run time",
        level="samples",
        error="relative error",
        rows=regression_rows((1_000, 10_000) if quick else (1_000, 10_000, 149_400), progress),
        notes=["Truth: force made from known weights, without noise; terms of thesis eq. 3.28 in SI."],
    )


def hysteresis(*, quick: bool, recording: str | None, progress: Progress) -> Report:
    """Models with memory by number of operators, on a recording."""
    from catheter.lab.studies import hysteresis_rows

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


def recordings(*, quick: bool, recording: str | None, progress: Progress) -> Report:
    """Reading and writing recordings: ours beside the plain mcap and protobuf decoder, on the same files."""
    _refuse(recording, "recordings")
    from catheter.lab.throughput import recording_rows

    rows, notes = recording_rows((2_000, 20_000) if quick else (10_000, 100_000, 400_000), progress)
    return Report(
        name="recordings",
        title="Recordings of 8 doubles a message, zstd, checksums on: error against run time",
        level="messages",
        error="differing bits",
        rows=rows,
        notes=notes,
    )


def damage(*, quick: bool, recording: str | None, progress: Progress) -> Report:
    """Damaged copies of a recording: how many are read as something else without a word."""
    _refuse(recording, "damage")
    from catheter.lab.damage import damage_rows

    rows, notes = damage_rows(100 if quick else 2_500, progress)
    return Report(
        name="damage",
        title="Damaged copies of a recording: read wrongly in silence, or not reported by `check`",
        level="copies",
        error="silent",
        rows=rows,
        notes=notes,
    )


def _design(name: str) -> Callable[..., Report]:
    """Return a report on the kinematic design, whose study is imported when it is asked for."""

    def made(*, quick: bool, recording: str | None, progress: Progress) -> Report:
        _refuse(recording, name)
        from catheter.lab import free_study, valve_study

        studies = {"free": free_study.free, "stability-free": free_study.stability, "valves": valve_study.valves}
        return studies[name](quick, progress)

    return made


def _elements(name: str) -> Callable[..., Report]:
    """Return a report on the finite elements, whose study is imported when it is asked for."""

    def made(*, quick: bool, recording: str | None, progress: Progress) -> Report:
        _refuse(recording, name)
        from catheter.lab import fem_study

        return {"fem": fem_study.fem, "stability-fem": fem_study.stability}[name](quick, progress)

    return made


REPORTS: dict[str, Callable[..., Report]] = {
    "regression": regression,
    "hysteresis": hysteresis,
    "recordings": recordings,
    "damage": damage,
    **{name: _design(name) for name in ("free", "stability-free", "valves")},
    **{name: _elements(name) for name in ("fem", "stability-fem")},
}
