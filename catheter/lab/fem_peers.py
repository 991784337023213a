"""TWIST to 20 kPa, ours beside felupe, one after the other in one run; felupe lives in an environment of its own."""

import json
import os
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from catheter.lab.report import Row
from data.errors import BadInput
from fem.tube import Tube

VARIABLE = "CATHETER_PEERS"  # names the Python of an environment with felupe
TWIST_DEG = -4.2280854425  # six codes agree (spec/fem.md 2)
KPA = 1e3


def peer_rows(tube: Tube) -> tuple[list[Row], list[str]]:
    """Return rows of relative error and seconds, and notes on iterations.

    Without the environment variable there are rows of ours only. Raises BadInput where it names
    no Python that has felupe.
    """
    body = tube.body()
    tube.inflate([KPA])  # compiled before the clock starts
    rows, notes = [], []
    for _ in range(2):
        started = time.perf_counter()
        run = tube.inflate(np.array([5, 10, 15, 20]) * KPA)
        seconds = time.perf_counter() - started
    rows.append(_row("this project", float(np.degrees(run.twist[-1])), seconds))
    notes.append(f"TWIST to 20 kPa, this project: {run.iterations.sum()} Newton iterations in four steps.")
    python = os.environ.get(VARIABLE, "")
    if not python:
        return rows, [*notes, f"Peers were left out: {VARIABLE} names no Python with felupe."]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "twist.npz"
        np.savez(path, **_exported(body))
        for solver in ("symmetric", "default"):
            found = _peer(python, path, solver)
            rows.append(_row(f"felupe {found['version']}, {solver} solver", found["twist_deg"], found["seconds"]))
            notes.append(f"TWIST to 20 kPa, felupe, {solver} solver: {found['iterations']} Newton iterations.")
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


def _peer(python: str, path: Path, solver: str) -> Any:
    script = Path(__file__).parent / "peer_felupe.py"
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    try:
        done = subprocess.run(
            [python, str(script), str(path), solver],
            capture_output=True,
            text=True,
            check=True,
            env=environment,
            cwd=path.parent,
            timeout=900,
        )
        return json.loads(done.stdout.splitlines()[-1])
    except (OSError, subprocess.SubprocessError, ValueError, IndexError) as error:
        said = getattr(error, "stderr", "") or str(error)
        raise BadInput(
            VARIABLE, f"{python!r} does not run felupe: {said.strip()[-200:]}", "pip install felupe"
        ) from error
