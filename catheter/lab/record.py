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
from data.options import parse_toml, to_toml
from data.recorder import Recorder
from data.signal import Signal
from data.topics import STANDARD, markers, standard

if TYPE_CHECKING:
    from catheter.marker_bench import MarkedRun
    from catheter.printed_bench import PrintedRun

RUNS: dict[str, Callable[..., BenchRun]] = {
    "chirp": bench_runs.bender,
    "ramp": bench_runs.bender,
    "staircase": bench_runs.bender,
    "accumulator": bench_runs.accumulator,
    "valve": bench_runs.valve,
    "cracking": bench_runs.cracking,
}


def record(scene: Scene, out: Path, *, overwrite: bool = False) -> "Run | BenchRun | PrintedRun | MarkedRun":
    """Simulate a scene and write its recording; the same scene gives the same bytes.

    Raises BadInput for a scene that is not simulated or an impossible one, CannotWrite for the output.
    """
    if scene.heading.kind in RUNS:
        return _record_run(scene, out, overwrite)
    if scene.heading.kind == "printed":
        return _record_printed(scene, out, overwrite)
    if scene.heading.kind == "marked":
        return _record_marked(scene, out, overwrite)
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


def with_map(scene: Scene, name: str) -> Scene:
    """Return a printed actuator's scene with the voxels of a map, shipped or a .toml file.

    Raises BadInput for a map of another tube, or of other materials than two.
    """
    from catheter.inflatable import Pattern, drawn
    from fem.material import printable
    from fem.voxel_map import load_map

    if scene.heading.kind != "printed":
        raise BadInput("--map", f"is given for a {scene.heading.kind} scene", "a printed actuator has a map")
    made, shape = load_map(name), scene.tables["tube"]
    sizes = {key: getattr(made.sizes, key) for key in ("length", "outer_radius", "wall")}
    if made.voxels.shape != tuple(shape.voxels) or any(abs(getattr(shape, k) - v) > 1e-9 for k, v in sizes.items()):
        raise BadInput(f"map {name}", f"has {made.voxels.shape} voxels, {sizes} m", f"the scene's tube is {shape}")
    soft_first = sorted(made.materials, key=lambda one: printable(one).c1)
    if len(soft_first) != 2:
        raise BadInput(f"map {name}", f"has {len(soft_first)} materials", "expected two")
    stiff = made.voxels == made.materials.index(soft_first[1])
    pattern = drawn(Pattern(soft=soft_first[0], stiff=soft_first[1]), stiff)
    tables = parse_toml(scene.text, "scene")
    kept = {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(pattern).items()}
    tables["map"] = {key: kept[key] for key in ("soft", "stiff", "pattern", "rows")}
    return Scene.parse(to_toml(tables), f"scene with map {name}")


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


def _record_printed(scene: Scene, out: Path, overwrite: bool) -> "PrintedRun":
    """Record a printed actuator: pressure and light on the bench's clock, each camera's frames on its own."""
    import cv2

    from catheter.printed_bench import TOPICS, printed_run

    tables = scene.tables
    run = printed_run(
        tables["tube"], tables["map"], tables["print"],
        ramp=tables["ramp"], cameras=tables["cameras"], gauge=tables["gauge"],
    )  # fmt: skip
    truth = {f"print.{name}": repr(value) for name, value in asdict(tables["print"]).items()}
    truth |= {f"cameras.{name}": repr(getattr(run.cameras, name)) for name in ("top_offset", "side_offset")}
    with Recorder(out, _origin(scene), scene=scene.text, truth=truth, flush_s=None, replace=overwrite) as recorder:
        for name in TOPICS:
            recorder.add(replace(standard(name), note="simulated"))
        times, states = run.led
        recorder.write_signals(
            {
                "/pressure": Signal(run.time_s, run.pressure_pa, "Pa", name="/pressure"),
                "/led": Signal(times, states, "1", name="/led"),
            }
        )
        for camera in ("top", "side"):
            for stamp_s, picture in run.frames(camera):
                jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, run.cameras.quality])[1].tobytes()
                recorder.write_picture(f"/camera/{camera}", stamp_s, jpeg, "jpeg")
    return run


def _record_marked(scene: Scene, out: Path, overwrite: bool) -> "MarkedRun":
    """Record a tube with markers: pressure, and the markers' places in the base's frame."""
    from catheter.marker_bench import marked_run, printed_moduli

    tables = scene.tables
    body = tables["tube"], tables["map"], tables["print"]
    run = marked_run(*body, stairs=tables["stairs"], markers=tables["markers"], gauge=tables["gauge"])
    truth = {f"print.{name}": repr(value) for name, value in asdict(tables["print"]).items()}
    truth["map.moduli_pa"] = " ".join(f"{value:.9g}" for value in printed_moduli(*body))
    components = run.markers.components()
    with Recorder(out, _origin(scene), scene=scene.text, truth=truth, flush_s=None, replace=overwrite) as recorder:
        recorder.add(replace(standard("/pressure"), note="simulated", rate_hz=run.gauge.rate))
        recorder.add(markers(components, note="simulated", rate_hz=run.markers.rate))
        seen = Signal(run.seen_s, run.places, "m", frame="base", components=components, name="/markers")
        recorder.write_signals(
            {"/pressure": Signal(run.time_s, run.pressure_pa, "Pa", name="/pressure"), "/markers": seen}
        )
    return run


def _truth(scene: Scene) -> Mapping[str, str]:
    tables = {name: asdict(scene.tables[name]) for name in ("drive", "bench", "plant", "noise")}
    return {f"{name}.{key}": repr(value) for name, table in tables.items() for key, value in table.items()}
