"""The command `twin`: a recorded pressure drives a scene's tube; the model's twist beside the measured one."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from catheter.lab.outcome import Outcome, progress, table
from data.errors import BadInput, DidNotConverge
from data.files import check_free, check_inputs
from data.options import to_toml
from data.recorder import Recorder
from data.recording import SIMULATED, UNSTATED, Recording
from data.signal import Signal
from data.topics import Topic, standard

if TYPE_CHECKING:
    from catheter.twin import Twin

NOTE = "simulated: finite elements at rest under the recorded pressure"
MODEL, RESIDUAL, EXTENSION = "/simulated/twist", "/simulated/residual", "/simulated/extension"


def twin_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `twin`."""
    parser.add_argument("scene", help="the actuator's scene: shipped (twist, printed), or a .toml file")
    parser.add_argument("recording", help="an MCAP file with a pressure, and perhaps a twist or a film of it")
    parser.add_argument("--out", metavar="FILE.mcap", help="pressure, model, measurement and residual as a recording")
    parser.add_argument("--pressure", default="/pressure", metavar="TOPIC", help="default: /pressure")
    parser.add_argument(
        "--twist",
        default="/twist",
        metavar="TOPIC",
        help="default: /twist, if it is there; anticlockwise as seen from the tip",
    )
    parser.add_argument("--ambient", default="0 Pa", metavar="PRESSURE", help="recorded pressure at rest (default: 0)")
    parser.add_argument("--lag", default="0 s", metavar="TIME", help="by how much the twist follows the pressure")
    parser.add_argument("--tolerance", default="0.0005 rad", metavar="ANGLE", help="of the model's curve")
    parser.add_argument("--force", action="store_true", help="overwrite the output")


def twin_(options: argparse.Namespace) -> Outcome:
    """Drive a tube's model by a recording."""
    from catheter.filmed import seen
    from catheter.inflatable import Path as Loads
    from catheter.inflatable import build
    from catheter.lab.scene import recorded_scene
    from catheter.response import Fineness
    from catheter.twin import Twinning, twin
    from data.options import read

    source, out = Path(options.recording), Path(options.out) if options.out else None
    if out:
        check_inputs(out, source)
        check_free(out, options.force)
    chosen = read(Twinning, {"ambient": options.ambient, "lag": options.lag}, "command line")
    fineness = read(Fineness, {"tolerance": options.tolerance}, "command line")
    scene = recorded_scene(source, options.scene, ("tube", "map"))
    tube = build(scene.tables["tube"], scene.tables["map"], scene.tables.get("path", Loads()))
    with Recording(source) as recording, progress("equilibria") as advance:
        if out and recording.kind == UNSTATED:
            raise BadInput(source, "does not say whether it was measured or simulated", "record it with its origin")
        if options.twist not in recording.channels and options.twist != "/twist":
            recording.signal(options.twist)  # refuses, with the nearest name
        told = seen(source, scene.tables.get("cameras"), pressure=options.pressure, twist=options.twist)
        try:
            found = twin(tube, told.pressure, told.twist, options=chosen, fineness=fineness, progress=advance)
        except DidNotConverge as error:
            error.add_note("is the recorded pressure absolute? --ambient takes what it is at rest")
            raise
        kind, title = recording.kind, recording.metadata.get("origin", {}).get("title", source.stem)
        if out:
            _save(found, out, options, {"kind": kind, "title": f"{title}, beside {scene.heading.title}"})
    values = _values(found, kind) | {"scene": scene.heading.title, "out": options.out}
    return Outcome(values, _parts(values, found, source))


def _save(found: "Twin", out: Path, options: argparse.Namespace, origin: dict[str, str]) -> None:
    """Write a recording: what was recorded under its own topics, the model under /simulated."""
    clocks = {"pressure": found.time_s, "twist": found.measured_s}
    columns: list[tuple[Topic, str, Any]] = [
        (replace(standard("/pressure"), name=options.pressure), "pressure", found.pressure),
        (Topic(name=MODEL, components=("angle",), units=("rad",), note=NOTE), "pressure", found.twist),
        (Topic(name=EXTENSION, components=("length",), units=("m",), note=NOTE), "pressure", found.extension),
    ]
    if len(found.measured):
        told = f"{NOTE}, minus the recorded twist"
        columns += [
            (Topic(name=options.twist, components=("angle",), units=("rad",)), "twist", found.measured),
            (Topic(name=RESIDUAL, components=("angle",), units=("rad",), note=told), "twist", found.residual),
        ]
    ask = {"response": options.twist if len(found.measured) else MODEL, "input": options.pressure}
    scene = to_toml({"scene": {"kind": "recording", "title": origin["title"]}, "ask": ask})
    with Recorder(out, origin, scene=scene, flush_s=None, replace=options.force) as recorder:
        for topic, _, _ in columns:
            recorder.add(topic)
        recorder.write_signals(
            {one.name: Signal(clocks[clock], value, one.units[0], name=one.name) for one, clock, value in columns}
        )


def _values(found: "Twin", kind: str) -> dict[str, Any]:
    sound = found.twist[np.isfinite(found.twist)]
    return {
        "recording_kind": kind,
        "model_kind": SIMULATED,
        "samples": len(found.time_s),
        "least_pressure_pa": float(np.nanmin(found.pressure)),
        "most_pressure_pa": float(np.nanmax(found.pressure)),
        "least_twist_rad": float(sound.min()),
        "most_twist_rad": float(sound.max()),
        "compared": found.compared,
        "rmse_rad": found.rmse,
        "offset_rad": found.offset,
        "spread_rad": found.spread,
        "equilibria": len(found.response.pressure),
        "curve_error_rad": found.response.error,
        "solver": found.response.solver,
        "iterations": found.response.iterations,
    }


def _parts(values: dict[str, Any], found: "Twin", source: Path) -> list[Any]:
    deg = float(np.degrees(1.0))
    rows = [
        ["pressure, kPa", f"{values['least_pressure_pa'] / 1e3:.3f}", f"{values['most_pressure_pa'] / 1e3:.3f}"],
        ["model's twist, deg (simulated)", *(f"{values[f'{end}_twist_rad'] * deg:.4f}" for end in ("least", "most"))],
    ]
    if values["compared"]:
        low, high = np.nanmin(found.measured), np.nanmax(found.measured)
        rows.append([f"recorded twist, deg ({values['recording_kind']})", f"{low * deg:.4f}", f"{high * deg:.4f}"])
    parts: list[Any] = [
        table(["", "least", "most"], rows, f"{values['scene']} under {source.name} ({values['recording_kind']})"),
        f"{values['equilibria']} equilibria, {values['iterations']} Newton iterations, {values['solver']}; the curve "
        f"between them to {values['curve_error_rad'] * deg:.1e} deg. No inertia, no memory.",
    ]
    if values["compared"]:
        parts.append(
            f"Model minus record over {values['compared']} samples: RMSE {values['rmse_rad'] * deg:.4f} deg, mean "
            f"{values['offset_rad'] * deg:+.4f} deg, {values['spread_rad'] * deg:.4f} deg about it"
        )
    else:
        parts.append("No twist in the recording to compare with")
    if values["out"]:
        parts.append(f"{values['out']} written; see it with: python -m catheter replay {values['out']}")
    return parts
