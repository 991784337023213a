"""Many reports in one go: each in a process of its own, so that one that fails, hangs or eats memory stops no other."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any

from catheter.lab.report import Progress, machine, writable
from data.files import fresh

INDEX = "index"
UNEXPLAINED = "no error, and no word why"
MOST_S = 1800.0  # of one report; --quick: a tenth
HEADER = ("report", "kind", "rows", "failed", "seconds", "outcome")


@dataclass(frozen=True, kw_only=True)
class Job:
    """One report to make: its name, what kind it is (the folder it goes to), further options of its command line.

    timed: its seconds are a result, so that nothing else may run beside it.
    """

    name: str
    kind: str
    timed: bool = False
    options: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Made:
    """What became of a report: how many rows, what each row that failed says, seconds; `why` there is none, or ""."""

    job: Job
    rows: int
    failures: tuple[str, ...]
    seconds: float
    why: str
    files: tuple[str, ...]

    @property
    def cells(self) -> list[str]:
        """Return what the index shows, in the order of HEADER."""
        told = self.why or "made"
        return [self.job.name, self.job.kind, str(self.rows), str(len(self.failures)), f"{self.seconds:.1f}", told]


class _Children:
    """The processes that run now, so that all of them can be ended."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._running: set[subprocess.Popen[str]] = set()
        self.ended = False

    def run(self, command: Sequence[str], timeout_s: float, *, threads: str) -> tuple[int, str, str]:
        """Return (exit code, output, errors) of a command in a process group of its own; -1 when it took too long.

        threads: of linear algebra, "": as many as it likes.
        """
        with self._lock:
            if self.ended:
                return -1, "", "interrupted"
            pipe = subprocess.PIPE
            env = os.environ | ({"OMP_NUM_THREADS": threads, "OPENBLAS_NUM_THREADS": threads} if threads else {})
            child = subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, start_new_session=True, env=env)
            self._running.add(child)
        try:
            out, err = child.communicate(timeout=timeout_s)
        except subprocess.TimeoutExpired:
            _end(child)
            child.communicate()
            return -1, "", f"no answer within {timeout_s:.0f} s: ended"
        else:
            return child.returncode, out, err
        finally:
            with self._lock:
                self._running.discard(child)

    def end(self) -> None:
        """End all of them, and start no more."""
        with self._lock:
            self.ended = True
            for child in self._running:
                _end(child)


def _end(child: "subprocess.Popen[str]") -> None:
    with suppress(ProcessLookupError):
        os.killpg(child.pid, signal.SIGKILL)


def gather(jobs: Sequence[Job], folder: Path, *, quick: bool, progress: Progress) -> list[Made]:
    """Make every report into folder/KIND, and return what became of each, in the order of `jobs`.

    Those that are timed one after another, undisturbed; the others, and all when quick, as many at once as there
    are cores, so that their times are indicative. An interruption ends what runs, and is raised.
    """
    children = _Children()
    found: dict[str, Made] = {}
    alone = [job for job in jobs if job.timed and not quick]
    together = [job for job in jobs if not job.timed or quick]
    for some, workers in ((alone, 1), (together, os.cpu_count() or 1)):
        pool = ThreadPoolExecutor(workers)
        try:
            for finished in as_completed([pool.submit(_make, job, folder, quick, children) for job in some]):
                made = finished.result()
                found[made.job.name] = made
                progress(len(found) / len(jobs))
        except BaseException:
            children.end()
            raise
        finally:
            pool.shutdown(cancel_futures=True)
    return [found[job.name] for job in jobs]


def _make(job: Job, folder: Path, quick: bool, children: _Children) -> Made:
    command = [sys.executable, "-m", "catheter", "report", job.name, "--json", "--force"]
    command += ["--out", str(folder / job.kind), *job.options, *(["--quick"] if quick else [])]
    started = time.monotonic()
    threads = "" if job.timed and not quick else "1"  # side by side their threads would wait for each other
    code, out, err = children.run(command, MOST_S / 10 if quick else MOST_S, threads=threads)
    seconds = time.monotonic() - started
    try:
        told: Mapping[str, Any] = json.loads(out)
    except ValueError:
        told = {}
    if "rows" not in told:
        words = str(told.get("error") or (err.strip().splitlines() or [f"ended with code {code}"])[-1])
        return Made(job=job, rows=0, failures=(), seconds=seconds, why=words[:300], files=())
    failures = tuple(filter(None, map(_failure, told["rows"])))
    files = tuple(told["files"])
    return Made(job=job, rows=len(told["rows"]), failures=failures, seconds=seconds, why="", files=files)


def _failure(row: Mapping[str, Any]) -> str:
    """Return what a row that failed says of itself, "" for one that did not; one without words is said to be."""
    if "verdict" in row:  # of the thesis
        return f"{row['place']}, {row['quantity']}: {row['reason']}" if row["verdict"] == "failed" else ""
    where = f"{row['method']}, {row['level']}"
    if row["failed"]:
        return f"{where}: {row['failed']}"
    return f"{where}: {UNEXPLAINED}" if row["error"] is None else ""  # JSON's null is a number that is none


def _listed(made: Made) -> dict[str, Any]:
    return dict(zip(HEADER, made.cells, strict=True)) | {"failures": made.failures, "files": made.files}


def failures(found: Sequence[Made]) -> list[str]:
    """Return what every row that failed says, after its report's name."""
    return [f"{made.job.name}: {text}" for made in found for text in made.failures]


def index_paths(folder: Path) -> list[Path]:
    """Return the files of the index."""
    return [folder / f"{INDEX}.{ending}" for ending in ("csv", "json", "rrd")]


def write_index(found: Sequence[Made], folder: Path) -> list[Path]:
    """Write index.csv, index.json and index.rrd, a dashboard of all pictures. Raises CannotWrite."""
    from catheter.lab.views import report as view

    writable(folder)
    table_path, about_path, view_path = index_paths(folder)
    rows = [made.cells for made in found]
    with fresh(table_path, replace=True) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([HEADER, *rows])
    with fresh(about_path, replace=True) as temporary:
        listed = [_listed(made) for made in found]
        temporary.write_text(json.dumps({"reports": listed, **machine()}, indent=1), encoding="utf-8")
    pictures = {
        f"{made.job.kind}, {Path(path).stem}": Path(path)
        for made in found
        for path in made.files
        if path.endswith(".png")
    }
    with fresh(view_path, replace=True) as temporary:
        view.save(temporary, "Reports", header=HEADER, rows=rows, notes=failures(found), pictures=pictures)
    return [table_path, about_path, view_path]
