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

from data.errors import CannotWrite, CatheterError
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
    """Time a solve, the fastest of 20 or of what fits in half a second, and measure its error.

    A solve that fails is a row that says so.
    """
    seconds, total = math.inf, 0.0
    for _ in range(20):
        started = time.perf_counter()
        try:
            answer = solve()
        except (CatheterError, ValueError, RuntimeError, ArithmeticError, np.linalg.LinAlgError) as error:
            spent = time.perf_counter() - started
            return Row(method=method, level=level, error=math.nan, seconds=spent, failed=f"failed: {error}"[:200])
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


def writable(folder: Path) -> None:
    """Make a folder, and those above it, unless it is there. Raises CannotWrite."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CannotWrite(folder, f"cannot be made a folder: {error.strerror}") from error


def write(report: Report, folder: Path) -> list[Path]:
    """Write NAME.csv, NAME.png and NAME.json (machine, versions, notes) into a folder; return them.

    Files of an earlier run are replaced: ask `paths` first. Raises CannotWrite.
    """
    writable(folder)
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
    from catheter.lab import plot

    figure = plot.sheet("" if report.draw is None else report.title)
    if report.draw:
        report.draw(figure)
    else:
        plot.work_precision(figure, report.rows, error=report.error, title=report.title)
    plot.save(figure, path)
