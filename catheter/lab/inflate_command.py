"""The command that inflates: a printed tube of two materials under pressure, or filled to a volume."""

import argparse
import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from data.errors import BadInput

if TYPE_CHECKING:
    from catheter.lab.outcome import Outcome
    from fem.tube import Inflation


def inflate_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `inflate`."""
    parser.add_argument("scene", nargs="?", default="twist", help="a shipped scene (twist), or a .toml file")
    parser.add_argument(
        "--pressure", action="append", metavar="PRESSURE", help="as '20 kPa', instead of the scene's; repeatable"
    )
    parser.add_argument(
        "--volume",
        action="append",
        type=float,
        metavar="RATIO",
        help="cavity volume over that at rest, instead of the scene's loads; repeatable",
    )


def inflate_(options: argparse.Namespace) -> "Outcome":
    """Inflate a scene's tube and say what became of it at each load."""
    from catheter.inflatable import Path, inflated
    from catheter.lab.scene import Scene
    from data.options import read

    scene = Scene.load(options.scene)
    if scene.heading.kind != "tube":
        raise BadInput(f"scene {options.scene}", f"is a {scene.heading.kind} scene", "a tube scene has a [tube]")
    path = scene.tables["path"]
    if options.pressure or options.volume:
        given = {"pressures": options.pressure, "volume_ratios": options.volume}
        path = replace(
            read(Path, {key: value for key, value in given.items() if value}, "command line"), tolerance=path.tolerance
        )
    started = time.perf_counter()
    run = inflated(scene.tables["tube"], scene.tables["map"], path)
    return _outcome(run, scene.heading.title, time.perf_counter() - started)


def _outcome(run: "Inflation", title: str, seconds: float) -> "Outcome":
    from catheter.lab.outcome import Outcome, table

    ratio = run.volume / run.tube.rest_volume
    columns = {
        "pressure_kpa": run.pressure / 1e3,
        "volume_ratio": ratio,
        "twist_deg": np.degrees(run.twist),
        "extension_mm": run.extension * 1e3,
        "bending_deg": np.degrees(run.bending),
        "energy_mj": run.energy * 1e3,
        "stretch": np.array([run.stretch(k).max() for k in range(len(run.points))]),
    }
    over = [int(run.overstretched(k).sum()) for k in range(len(run.points))]
    rows = [
        {name: float(column[k]) for name, column in columns.items()}
        | {"overstretched": over[k], "stable": bool(run.stable[k]), "iterations": int(run.iterations[k])}
        for k in range(len(run.points))
    ]
    digits = (3, 4, 4, 4, 3, 4, 3)
    shown = [
        [
            *(f"{row[name]:.{n}f}" for name, n in zip(columns, digits, strict=True)),
            str(row["overstretched"]),
            "yes" if row["stable"] else "no",
            str(row["iterations"]),
        ]
        for row in rows
    ]
    head = ["kPa", "V/V0", "twist deg", "ext. mm", "bend deg", "W mJ", "stretch", "over", "stable", "its"]
    parts = [
        table(head, shown, f"{title} (simulated)", words=0),
        f"{len(run.system.free)} unknowns, {run.solver}, {run.iterations.sum()} Newton iterations, {seconds:.2f} s.",
        "Twist: end ring, anticlockwise as seen from +z. over: voxels stretched past their material's elongation.",
    ]
    values = {
        "simulated": True,
        "solver": run.solver,
        "unknowns": len(run.system.free),
        "seconds": seconds,
        "loads": rows,
    }
    return Outcome(values, parts)
