"""`invert --sweep`: a scene's problem with other targets, seeds and noises, each in a process of its own."""

import argparse
import os
import time
from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np

from catheter.inverse_sweep import Job, Run, sweep, varied
from catheter.lab.outcome import Outcome, progress, table
from data.errors import BadInput

if TYPE_CHECKING:
    from catheter.lab.scene import Scene


def swept(options: argparse.Namespace, scene: "Scene", job: Job) -> Outcome:
    """Return the table of every run: its error, iterations, seconds and end."""
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    for name in ("out", "view"):
        if getattr(options, name) is not None:
            raise BadInput(f"--{name}", "is given for a sweep", "one run has a map")
    if options.workers < 1:
        raise BadInput("--workers", f"is {options.workers}", "expected 1 at least")
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # the processes share the cores: none needs more than one
    jobs, runs, started = varied(job, options.sweep), list[Run](), time.perf_counter()
    with (
        progress(f"{len(jobs)} runs") as advance,
        ProcessPoolExecutor(min(options.workers, len(jobs)), get_context("spawn")) as pool,
    ):
        for run in sweep(jobs, pool):
            runs.append(run)
            advance(len(runs) / len(jobs))
    return _outcome(scene.heading.title, options, runs, time.perf_counter() - started)


def _outcome(title: str, options: argparse.Namespace, runs: list[Run], seconds: float) -> Outcome:
    keys = [axis.partition("=")[0] for axis in options.sweep]
    rows = [
        [
            *(str(getattr(run.wanted, key)) for key in keys),
            *(f"{value:.2e}" for value in (run.quality.largest, run.quality.median)),
            f"{100 * run.quality.right:.1f}",
            str(run.iterations),
            f"{run.seconds:.1f}",
            run.failed or run.ended,
        ]
        for run in runs
    ]
    head = [*keys, "largest error", "median", "right %", "iterations", "s", "end"]
    good = [run.seconds for run in runs if not run.failed]
    least = "" if not good else f", {np.sum(good):.1f} s of searching, {min(good):.1f} to {max(good):.1f} s each"
    values = {
        "simulated": True,
        "title": title,
        "seconds": seconds,
        "workers": options.workers,
        "runs": [
            {key: getattr(run.wanted, key) for key in keys}
            | asdict(run.quality)
            | {"misfit": run.misfit, "iterations": run.iterations, "seconds": run.seconds, "ended": run.ended}
            | ({"failed": run.failed} if run.failed else {})
            for run in runs
        ],
    }
    text = (
        f"{len(runs)} runs by {options.workers} processes in {seconds:.1f} s{least}; {len(runs) - len(good)} refused."
    )
    return Outcome(values, [table(head, rows, f"{title} (simulated): errors of the moduli", words=len(keys)), text])
