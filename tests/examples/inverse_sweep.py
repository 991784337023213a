"""Reconstruct a scene's map from many random seeds: on this machine's cores, or on a cluster that Dask runs.

    python tests/examples/inverse_sweep.py invert_twist 0:10
    python tests/examples/inverse_sweep.py invert_twist 0:10 tcp://scheduler:8786

The second needs `pip install dask distributed`, and this project installed where the workers run:
`dask scheduler` on one machine, `dask worker tcp://scheduler:8786 --nthreads 1 --nworkers auto` on each.
"""

import sys
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import ExitStack
from multiprocessing import get_context


def main(scene: str, numbers: str, executor: Executor) -> None:
    """Print how each seed ends; executor: wherever the runs are computed."""
    from catheter.inverse_sweep import Job, sweep, varied
    from catheter.lab.scene import Scene

    tables = Scene.load(scene).tables
    job = Job(body=tables["tube"], pattern=tables["map"], wanted=tables["wanted"], inversion=tables["inversion"])
    for run in sweep(varied(job, ["seed=random", f"number={numbers}"]), executor):
        print(
            f"seed {run.wanted.number}: error {run.quality.largest:.1e}, {run.seconds:.1f} s, {run.failed or run.ended}"
        )


if __name__ == "__main__":
    with ExitStack() as stack:
        if len(sys.argv) > 3:
            from distributed import Client  # not a dependency of this project

            pool = stack.enter_context(Client(sys.argv[3])).get_executor()
        else:
            pool = stack.enter_context(ProcessPoolExecutor(mp_context=get_context("spawn")))
        main(sys.argv[1], sys.argv[2], pool)
