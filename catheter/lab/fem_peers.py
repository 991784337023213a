"""TWIST to 20 kPa, ours beside felupe, one after the other in one run; felupe lives in an environment of its own."""

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
FELUPE = "11.3.0"


def peer_rows(tube: Tube, *, peers: bool) -> tuple[list[Row], list[str]]:
    """Return rows of relative error and seconds, and notes on iterations; of ours only, unless peers are asked for."""
    body = tube.body()
    tube.inflate([KPA])  # compiled before the clock starts
    rows, notes = [], []
    for _ in range(2):
        started = time.perf_counter()
        run = tube.inflate(np.array([5, 10, 15, 20]) * KPA)
        seconds = time.perf_counter() - started
    rows.append(_row("this project", float(np.degrees(run.twist[-1])), seconds))
    notes.append(f"TWIST to 20 kPa, this project: {run.iterations.sum()} Newton iterations in four steps.")
    if not peers:
        return rows, [*notes, "felupe was left out: --peers runs it too."]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "twist.npz"
        np.savez(path, **_exported(body))
        for solver in ("symmetric", "default"):
            name = f"felupe {FELUPE}, {solver} solver"
            try:
                found = run_peer("felupe_twist.py", (f"felupe=={FELUPE}",), {"mesh": str(path), "solver": solver})
            except CatheterError as failure:
                rows.append(Row(method=name, level="32 x 32 x 1", error=np.nan, seconds=np.nan, failed=str(failure)))
                continue
            rows.append(_row(name, found["twist_deg"], found["seconds"]))
            notes.append(f"TWIST to 20 kPa, {name}: {found['iterations']} Newton iterations.")
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
