"""Simulated experiments, recorded as the bench would record them, and marked as simulated."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from catheter import bench_runs
from catheter.bench import Run, simulate
from catheter.bench_runs import BenchRun
from catheter.lab.scene import Scene
from data.errors import BadInput
from data.recorder import Recorder
from data.signal import Signal
from data.topics import STANDARD, standard

if TYPE_CHECKING:
    from catheter.lab.record_actuator import ActuatorRun

RUNS: dict[str, Callable[..., BenchRun]] = {
    "chirp": bench_runs.bender,
    "ramp": bench_runs.bender,
    "staircase": bench_runs.bender,
    "accumulator": bench_runs.accumulator,
    "valve": bench_runs.valve,
    "cracking": bench_runs.cracking,
}


def record(scene: Scene, out: Path, *, overwrite: bool = False) -> "Run | BenchRun | ActuatorRun":
    """Simulate a scene and write its recording; the same scene gives the same bytes.

    Raises BadInput for a scene that is not simulated or an impossible one, CannotWrite for the output.
    """
    if scene.heading.kind == "inverse":
        from catheter.lab.record_actuator import record_actuator

        return record_actuator(scene, out, _origin(scene), overwrite=overwrite)
    if scene.heading.kind in RUNS:
        return _record_run(scene, out, overwrite)
    if scene.heading.kind != "bender":
        raise BadInput(f"scene {scene.heading.title!r}", f"is a {scene.heading.kind} scene", "a bender can be recorded")
    run = simulate(*(scene.tables[name] for name in ("drive", "bench", "plant", "noise")))
    origin = _origin(scene)
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
                replace(
                    listed, components=(component,), units=(unit,), note="simulated", rate_hz=scene.tables["bench"].rate
                )
            )
            signals[name] = Signal(run.time_s, values, unit, name=name)
        recorder.write_signals(signals)
    return run


def _origin(scene: Scene) -> dict[str, str]:
    return {
        "kind": "simulated",
        "title": scene.heading.title,
        "who": "catheter-robot-toolkit",
        "licence": "Apache-2.0",
    }


def _record_run(scene: Scene, out: Path, overwrite: bool) -> BenchRun:
    """Record one of the bench's experiments: the topics and components that it gives."""
    options = {name: table for name, table in scene.tables.items() if name != "ask"}
    run = RUNS[scene.heading.kind](**options)
    truth = {
        f"{name}.{key}": repr(value) for name, table in options.items() for key, value in asdict(table).items()
    } | dict(run.truth)
    topics = {topic: [one for name, one in run.signals if name == topic] for topic, _ in run.signals}
    with Recorder(out, _origin(scene), scene=scene.text, truth=truth, flush_s=None, replace=overwrite) as recorder:
        whole = {}
        for name, components in topics.items():
            listed = standard(name)
            units = tuple(listed.units[listed.components.index(one)] for one in components)
            rate_hz = scene.tables["sensors"].rate
            recorder.add(replace(listed, components=tuple(components), units=units, note="simulated", rate_hz=rate_hz))
            values = np.stack([run.signals[name, one] for one in components], axis=1)
            if len(set(units)) == 1:
                whole[name] = Signal(run.time_s, values, units[0], components=tuple(components), name=name)
                continue
            for at, row in zip(run.time_s.tolist(), values, strict=True):  # a signal has one unit
                recorder.write(name, at, row)
        recorder.write_signals(whole)
    return run


def _truth(scene: Scene) -> Mapping[str, str]:
    tables = {name: asdict(scene.tables[name]) for name in ("drive", "bench", "plant", "noise")}
    return {f"{name}.{key}": repr(value) for name, table in tables.items() for key, value in table.items()}
