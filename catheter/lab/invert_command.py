"""The command that inverts: a scene's wanted motion to a material map, or a recording to material constants."""

import argparse
import os
from typing import TYPE_CHECKING, Any

import numpy as np

from catheter.lab.dashboard import where
from catheter.lab.invert_live import Sought, live, outputs, resumed
from catheter.lab.invert_outcome import outcome_of, sure_of
from catheter.lab.outcome import Outcome, table
from data.errors import BadInput, CatheterError
from data.recording import SIMULATED

if TYPE_CHECKING:
    from catheter.inverse_sweep import Job
    from catheter.lab.scene import Scene
    from catheter.reconstruction import Case
    from fem.inverse import Reconstruction

KINDS = ("inverse", "inverse-block")


def invert_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `invert`."""
    parser.add_argument("source", nargs="?", default="invert_twist", help="a scene, or a recording (.mcap)")
    parser.add_argument("--scene", help="for a recording: the actuator's scene (default: the recording's own)")
    parser.add_argument("--seed", choices=("uniform", "gap", "random"), help="where the search starts")
    parser.add_argument(
        "--seen", choices=("all", "outer", "markers", "centreline", "tip", "twist"), help="what is seen"
    )
    parser.add_argument("--noise", type=float, metavar="SHARE", help="of the largest displacement")
    parser.add_argument("--number", type=int, help="of the random streams of noise and seed")
    parser.add_argument("--out", metavar="MAP.npz", help="the map; an interrupted run is continued from it")
    parser.add_argument("--view", metavar="FILE.rrd", help="map unwrapped, shape on target, misfit curve")
    parser.add_argument(
        "--sweep", metavar="KEY=VALUES", action="append", default=[],
        help="many runs, as number=0:10 or noise=0.001,0.01 (any key of [wanted]; again for a second axis)",
    )  # fmt: skip
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes of a sweep (default: all)")
    parser.add_argument("--camera-noise", type=float, default=0.05, metavar="DEG", help="of a recorded twist")
    parser.add_argument("--pressure-noise", type=float, default=0.01, metavar="SHARE", help="of a recorded pressure")
    parser.add_argument("--force", action="store_true", help="begin anew and overwrite the outputs")


def invert_(options: argparse.Namespace) -> Outcome:
    """Invert a scene or a recording."""
    if str(options.source).endswith(".mcap"):
        from catheter.lab.invert_recording import recorded

        return recorded(options)
    from catheter.lab.scene import Scene
    from catheter.reconstruction import solved

    scene = Scene.load(options.source)
    if scene.heading.kind == "inverse-shape":
        from catheter.lab.invert_reach import reached

        return reached(options, scene)
    job = _job(options, scene)
    if options.sweep:
        from catheter.lab.invert_sweep import swept

        return swept(options, scene, job)
    case = job.case()
    out, view = outputs(options)
    seed = resumed(out, case.grid, options.force)
    sought = Sought(scene.heading.title, SIMULATED, case.grid, case.whole[-1].state.x, case.truth)
    with live(sought, out, view) as (tell, shown):
        found = solved(case, job.inversion, seed, tell)
        known = sure_of(case.problem, found, case.variation, job.inversion, shown)
    outcome = outcome_of(sought.title, SIMULATED, case.problem, found, case.truth, known, case.grid)
    outcome.parts += [f"Map: {out}"] if out else []
    palette = scene.tables.get("palette")
    printed = _printable(case, found, palette) if palette and palette.materials else {}
    if printed:
        outcome.values["printable"] = printed
        outcome.parts.append(_palette_table(printed))
    if view:
        outcome.values["view"] = str(view)
        outcome.parts.append(where(view))
    return outcome


def _job(options: argparse.Namespace, scene: "Scene") -> "Job":
    """Return a scene's problem with what the command line says of it. Raises BadInput for another kind of scene."""
    from dataclasses import replace

    from catheter.inverse_sweep import Job

    tables = scene.tables
    if scene.heading.kind not in KINDS:
        raise BadInput(f"scene {options.source}", f"is a {scene.heading.kind} scene", "an inverse scene has a [wanted]")
    given = {key: getattr(options, key) for key in ("seed", "seen", "noise", "number")}
    wanted = replace(tables["wanted"], **{key: value for key, value in given.items() if value is not None})
    if scene.heading.kind == "inverse-block":
        return Job(body=tables["block"], wanted=wanted, inversion=tables["inversion"])
    return Job(body=tables["tube"], pattern=tables["map"], wanted=wanted, inversion=tables["inversion"])


def _printable(case: "Case", found: "Reconstruction", palette: Any) -> dict[str, dict[str, float | str]]:
    """Return what each discretisation of a map would do: displacement errors of all nodes [mm], simulated."""
    from catheter.reconstruction import discretised

    rows: dict[str, dict[str, float | str]] = {}
    for name, made in discretised(case, found, palette):
        if isinstance(made, CatheterError):
            rows[name] = {"failed": str(made)}
            continue
        errors = case.errors(made.standings)
        names = [str(case.names(palette)[k]) for k in made.chosen]
        rows[name] = {
            "rms_mm": 1e3 * float(np.sqrt((errors**2).mean())),
            "largest_mm": 1e3 * float(errors.max()),
            "materials": len(set(names)),
            "solved": made.solved,
            "overstretched": palette.overstretched(case.voxels, made.chosen, made.standings),
            "as_true": float((palette.moduli_of(made.chosen) == case.truth).mean()),
        }
    return rows


def _palette_table(printed: dict[str, dict[str, Any]]) -> Any:
    rows = [
        [name, row["failed"], "", "", "", ""]
        if "failed" in row
        else [
            name,
            f"{row['rms_mm']:.4f}",
            f"{row['largest_mm']:.4f}",
            f"{100 * row['as_true']:.1f}",
            str(row["solved"]),
            str(row["overstretched"]),
        ]
        for name, row in printed.items()
    ]
    head = ["printed map (simulated)", "rms error mm", "largest mm", "as the truth %", "solved", "overstretched"]
    return table(head, rows)
