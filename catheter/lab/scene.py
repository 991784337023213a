"""Scenes: TOML files that say what an experiment is. What is computed from one is asked for."""

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from importlib import import_module
from pathlib import Path
from typing import Any

from data.ask import Ask
from data.errors import BadInput, nearest
from data.options import find_toml, load_toml, option, parse_toml, read, shipped_names, to_toml

FOLDER = Path(__file__).parents[2] / "data" / "scenes"

_BENDER = {
    "servo": "catheter.actuator.Servo",
    "plant": "catheter.bench.Plant",
    "relaxation": "catheter.bench_runs.Relaxation",
    "sensors": "catheter.bench_runs.Sensors",
    "ask": "data.ask.Ask",
}
_ON_BENCH = {name: _BENDER[name] for name in ("servo", "sensors", "ask")}

# The tables each kind of scene may have, beside [scene], and the options they hold: a scene imports its own only.
TABLES: dict[str, dict[str, str]] = {
    "recording": {"ask": "data.ask.Ask"},
    "bender": {
        "drive": "catheter.bench.Schedule",
        "bench": "catheter.bench.Bench",
        "plant": "catheter.bench.Plant",
        "noise": "catheter.bench.Noise",
        "ask": "data.ask.Ask",
    },
    "free": {"task": "catheter.task.Task", "scatter": "catheter.refine.Scatter", "extender": "catheter.robot.Extender"},
    "cone": {"wanted": "catheter.valve.Wanted"},
    "locomotion": {
        "source": "catheter.drive.SquareWave",
        "circuit": "catheter.circuit.Circuit",
        "marks": "catheter.tuning.Marks",
        "extender": "catheter.robot.Extender",
    },
    "robot": {
        "source": "catheter.drive.SquareWave",
        "circuit": "catheter.circuit.Circuit",
        "marks": "catheter.tuning.Marks",
        "extender": "catheter.robot.Extender",
        "task": "catheter.task.Task",
        "walk": "catheter.gait.Walk",
        "bender": "catheter.inflatable.Shape",
        "bender_map": "catheter.inflatable.Pattern",
        "bender_line": "catheter.end_effector.Line",
        "twister": "catheter.inflatable.Shape",
        "twister_map": "catheter.inflatable.Pattern",
        "twister_line": "catheter.end_effector.Line",
    },
    "tube": {
        "tube": "catheter.inflatable.Shape",
        "map": "catheter.inflatable.Pattern",
        "path": "catheter.inflatable.Path",
    },
    "shape": {
        "vessel": "catheter.centreline.Source",
        "actuator": "catheter.motions.Actuator",
        "spiral": "catheter.motions.Spiral",
        "bend": "catheter.motions.Bend",
        "twist": "catheter.motions.Twist",
        "balloon": "catheter.motions.Balloon",
    },
    "printed": {
        "tube": "catheter.inflatable.Shape",
        "map": "catheter.inflatable.Pattern",
        "print": "catheter.printed_bench.Print",
        "ramp": "catheter.printed_bench.Ramp",
        "cameras": "catheter.printed_bench.Cameras",
        "gauge": "catheter.printed_bench.Gauge",
        "ask": "data.ask.Ask",
    },
    "marked": {
        "tube": "catheter.inflatable.Shape",
        "map": "catheter.inflatable.Pattern",
        "print": "catheter.printed_bench.Print",
        "stairs": "catheter.marker_bench.Stairs",
        "markers": "catheter.marker_bench.Markers",
        "gauge": "catheter.printed_bench.Gauge",
        "inversion": "fem.inverse.Inversion",
        "ask": "data.ask.Ask",
    },
    "inverse": {
        "tube": "catheter.inflatable.Shape",
        "map": "catheter.inflatable.Pattern",
        "wanted": "catheter.reconstruction.Wanted",
        "inversion": "fem.inverse.Inversion",
        "palette": "catheter.reconstruction.Palette",
    },
    "inverse-block": {
        "block": "catheter.reconstruction.Cube",
        "wanted": "catheter.reconstruction.Wanted",
        "inversion": "fem.inverse.Inversion",
    },
    "inverse-shape": {
        "vessel": "catheter.centreline.Source",
        "actuator": "catheter.motions.Actuator",
        "spiral": "catheter.motions.Spiral",
        "bend": "catheter.motions.Bend",
        "twist": "catheter.motions.Twist",
        "balloon": "catheter.motions.Balloon",
        "reach": "catheter.reach.Reach",
        "inversion": "fem.inverse.Inversion",
        "palette": "catheter.reconstruction.Palette",
    },
    "chirp": {"drive": "sysid.excitation.Chirp", **_BENDER},
    "ramp": {"drive": "sysid.excitation.Ramp", **_BENDER},
    "staircase": {"drive": "sysid.excitation.Staircase", **_BENDER},
    "accumulator": {
        "drive": "sysid.excitation.Sine",
        "accumulator": "catheter.bench_runs.AccumulatorBench",
        **_ON_BENCH,
    },
    "valve": {"drive": "sysid.excitation.Steps", "valve": "catheter.bench_runs.ValveBench", **_ON_BENCH},
    "cracking": {
        "drive": "catheter.bench_runs.PressureRamp",
        "valve": "catheter.bench_runs.ConeValve",
        "sensors": "catheter.bench_runs.Sensors",
        "ask": "data.ask.Ask",
    },
}


@dataclass(frozen=True, kw_only=True)
class Heading:
    """The `[scene]` table: what kind of experiment, and what a reader calls it."""

    kind: str = option(choices=tuple(TABLES))
    title: str


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A checked scene: the options of each of its tables by name, and the text it was read from.

    A table that was left out holds its defaults; one without defaults is not there.
    """

    heading: Heading
    text: str
    tables: Mapping[str, Any]

    @property
    def ask(self) -> Ask:
        """What a replay of it is asked."""
        found: Ask = self.tables["ask"]
        return found

    @classmethod
    def load(cls, name: str | Path) -> "Scene":
        """Return a shipped scene by name, or one from a .toml file.

        Raises BadInput naming file, table and key of whatever is unknown or impossible in it.
        """
        path = find_toml(name, FOLDER, "scene")
        tables, text = load_toml(path)
        return cls.parse(_included(tables, path) if "include" in tables else text, str(path))

    @classmethod
    def parse(cls, text: str, place: str) -> "Scene":
        """Return a scene from its text; `place` is what errors name. Raises BadInput as `load`."""
        tables = parse_toml(text, place)
        heading = read(Heading, tables.pop("scene", {}), f"{place}, [scene]")
        known = TABLES[heading.kind]
        for name in tables:
            if name not in known:
                raise BadInput(f"{place}, [{name}]", f"is no table of a {heading.kind} scene", nearest(name, known))
        kinds = {name: _class(path) for name, path in known.items()}
        options = {
            name: read(kind, tables.get(name, {}), f"{place}, [{name}]")
            for name, kind in kinds.items()
            if name in tables or all(f.default is not MISSING or f.default_factory is not MISSING for f in fields(kind))
        }
        return cls(heading=heading, text=text, tables=options)


def recorded_scene(recording: Path, name: str | None, needed: tuple[str, ...]) -> Scene:
    """Return the named scene, or else the one a recording holds; needed: the tables it must have. Raises BadInput."""
    from data.recording import Recording

    if name:
        scene = Scene.load(name)
    else:
        with Recording(recording) as opened:
            text = opened.scene
        if not text:
            raise BadInput(recording, "does not say what was recorded", "name the actuator's scene: --scene printed")
        scene = Scene.parse(text, f"{recording}, scene")
    if lacking := [table for table in needed if table not in scene.tables]:
        raise BadInput(f"scene {scene.heading.title!r}", f"has no [{lacking[0]}]", "name the actuator's scene")
    return scene


def _class(path: str) -> Any:
    module, _, name = path.rpartition(".")
    return getattr(import_module(module), name)


def _included(tables: dict[str, Any], path: Path) -> str:
    """Return the text of a scene with the tables of the fits it includes; the scene's own keys win.

    A fit's `[fit]` table, which says what it was made from, is left out.
    """
    files = tables.pop("include")
    if not isinstance(files, list) or not all(isinstance(one, str) for one in files):
        raise BadInput(f"{path}, include", f"is {files!r:.60}", "expected a list of .toml files")
    merged: dict[str, Any] = {}
    for one in files:
        for name, table in load_toml(path.parent / one)[0].items():
            if not isinstance(table, dict):
                raise BadInput(f"{path.parent / one}, {name}", f"is {table!r:.60}", "a fit has tables only")
            merged[name] = merged.get(name, {}) | table
    merged.pop("fit", None)
    own = {name: merged.pop(name, {}) | table if isinstance(table, dict) else table for name, table in tables.items()}
    return to_toml(own | merged)


def names() -> list[str]:
    """Return the names of the scenes that come with the project."""
    return shipped_names(FOLDER)
