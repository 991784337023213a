"""Simulated experiments, recorded as the bench would record them, and marked as simulated."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path

from catheter.bench import Run, simulate
from catheter.lab.scene import Scene
from data.errors import BadInput
from data.recorder import Recorder
from data.signal import Signal
from data.topics import STANDARD


def record(scene: Scene, out: Path, *, overwrite: bool = False) -> Run:
    """Simulate a bender scene and write its recording; the same scene gives the same bytes.

    Raises BadInput for a scene of another kind or an impossible one, CannotWrite for the output.
    """
    if scene.heading.kind != "bender":
        raise BadInput(f"scene {scene.heading.title!r}", f"is a {scene.heading.kind} scene", "a bender can be recorded")
    run = simulate(scene.drive, scene.bench, scene.plant, scene.noise)
    origin = {
        "kind": "simulated",
        "title": scene.heading.title,
        "who": "catheter-robot-toolkit",
        "licence": "Apache-2.0",
    }
    columns = {
        "/drive": (run.command_v, "command"),
        "/volume": (run.volume_m3, "volume"),
        "/pressure": (run.pressure_pa, "pressure"),
        "/force": (run.force_n, "force"),
    }
    with Recorder(out, origin, scene=scene.text, truth=_truth(scene), flush_s=None, replace=overwrite) as recorder:
        signals = {}
        for name, (values, component) in columns.items():
            listed = STANDARD[name]
            unit = listed.units[listed.components.index(component)]
            recorder.add(
                replace(listed, components=(component,), units=(unit,), note="simulated", rate_hz=scene.bench.rate)
            )
            signals[name] = Signal(run.time_s, values, unit, name=name)
        recorder.write_signals(signals)
    return run


def _truth(scene: Scene) -> Mapping[str, str]:
    tables = {name: asdict(getattr(scene, name)) for name in ("drive", "bench", "plant", "noise")}
    return {f"{name}.{key}": repr(value) for name, table in tables.items() for key, value in table.items()}
