"""TWIST to 20 kPa, ours beside felupe and NGSolve, one after the other in one run, each in its own environment."""

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from catheter.lab.peers import run_peer
from catheter.lab.report import Row
from data.errors import CatheterError
from fem.tube import Tube

TWIST_DEG = -4.2280854425  # six independent codes agree
KPA = 1e3
FELUPE, NGSOLVE = ("felupe==11.3.0",), ("ngsolve==6.2.2608", "numpy", "scipy")
PEERS: tuple[tuple[str, str, tuple[str, ...], dict[str, Any]], ...] = (  # name, script, requirements, task
    ("felupe 11.3.0, symmetric solver", "felupe_twist.py", FELUPE, {"solver": "symmetric"}),
    ("felupe 11.3.0, default solver", "felupe_twist.py", FELUPE, {"solver": "default"}),
    ("NGSolve 6.2.2608, sparse Cholesky", "ngsolve_twist.py", NGSOLVE, {}),
)


def peer_rows(tube: Tube, *, peers: bool) -> tuple[list[Row], list[str]]:
    """Return rows of relative error and seconds, and notes on iterations; of ours only, unless peers are asked for."""
    started = time.perf_counter()
    tube.inflate([KPA])  # compiled, or read from numba's cache, before the clock starts
    first = time.perf_counter() - started
    seconds, notes = np.inf, []
    for _ in range(3):
        started = time.perf_counter()
        run = tube.inflate(np.array([5, 10, 15, 20]) * KPA)
        seconds = min(seconds, time.perf_counter() - started)
    rows = [_row("this project", float(np.degrees(run.twist[-1])), seconds)]
    factors = sum(point.factors for point in run.points)
    notes.append(
        f"TWIST to 20 kPa, this project: {run.iterations.sum()} Newton iterations in four steps, {factors} factors; "
        f"mesh, setup and all in its time; compilation or its cache {first:.1f} s, apart."
    )
    if not peers:
        return rows, [*notes, "felupe and NGSolve were left out: --peers runs them too."]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "twist.npz"
        np.savez(path, **_exported(tube.body()))
        for name, script, requirements, task in PEERS:
            try:
                found = run_peer(script, requirements, task | {"mesh": str(path)})
            except CatheterError as failure:
                rows.append(Row(method=name, level="32 x 32 x 1", error=np.nan, seconds=np.nan, failed=str(failure)))
                continue
            rows.append(_row(name, found["twist_deg"], found["seconds"]))
            notes.append(
                f"TWIST to 20 kPa, {name}: {found['iterations']} Newton iterations, setup {found['setup_s']:.1f} s "
                f"apart, {found['seconds'] / seconds:.1f} times our time."
            )
    return rows, notes


def _row(name: str, twist_deg: float, seconds: float) -> Row:
    error = abs(twist_deg / TWIST_DEG - 1)
    return Row(method=f"TWIST to 20 kPa, {name}", level="32 x 32 x 1", error=error, seconds=seconds)


def _exported(body: Any) -> dict[str, Any]:
    """Return a mesh and its materials in the reference file's form."""
    mesh = body.mesh
    stiffness = np.stack([2 * body.numbers[:, 0], body.kappa], axis=1) / 1e6
    kinds, part = np.unique(stiffness, axis=0, return_inverse=True)
    return {
        "nodes_mm": mesh.nodes * 1e3,
        "hexes": mesh.hexes,
        "material": part,
        "mu_MPa": kinds[:, 0],
        "kappa_MPa": kinds[:, 1],
        "pressure_quads": mesh.pressed,
        "fixed_nodes": np.flatnonzero(mesh.fixed.all(axis=1)),
        "ring_nodes": mesh.ring,
    }
