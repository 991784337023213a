"""Scenes: TOML files that say what an experiment is. What is computed from one is asked for."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from catheter.actuator import Servo
from catheter.bench import Bench, Noise, Plant, Schedule
from catheter.bench_runs import AccumulatorBench, ConeValve, PressureRamp, Relaxation, Sensors, ValveBench
from data.ask import Ask
from data.errors import BadInput, nearest
from data.options import find_toml, load_toml, option, parse_toml, read, shipped_names, to_toml
from sysid.excitation import Chirp, Ramp, Sine, Staircase, Steps

FOLDER = Path(__file__).parents[2] / "data" / "scenes"


@dataclass(frozen=True, kw_only=True)
class Heading:
    """The `[scene]` table: what kind of experiment, and what a reader calls it."""

    kind: str = option(
        choices=("bender", "recording", "chirp", "ramp", "staircase", "accumulator", "valve", "cracking")
    )
    title: str


_BENDER = {"servo": Servo, "plant": Plant, "relaxation": Relaxation, "sensors": Sensors, "ask": Ask}

# The tables each kind of scene may have, beside [scene]; a table left out takes its defaults.
TABLES: dict[str, dict[str, type]] = {
    "recording": {"ask": Ask},
    "bender": {"drive": Schedule, "bench": Bench, "plant": Plant, "noise": Noise, "ask": Ask},
    "chirp": {"drive": Chirp, **_BENDER},
    "ramp": {"drive": Ramp, **_BENDER},
    "staircase": {"drive": Staircase, **_BENDER},
    "accumulator": {"drive": Sine, "servo": Servo, "accumulator": AccumulatorBench, "sensors": Sensors, "ask": Ask},
    "valve": {"drive": Steps, "servo": Servo, "valve": ValveBench, "sensors": Sensors, "ask": Ask},
    "cracking": {"drive": PressureRamp, "valve": ConeValve, "sensors": Sensors, "ask": Ask},
}


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A checked scene: its options by table, and the text it was read from.

    tables: every table of its kind by name, for runs of the bench; drive to ask: a bender scene's.
    """

    heading: Heading
    text: str
    tables: Mapping[str, Any] = field(default_factory=dict)
    drive: Schedule = field(default_factory=Schedule)
    bench: Bench = field(default_factory=Bench)
    plant: Plant = field(default_factory=Plant)
    noise: Noise = field(default_factory=Noise)
    ask: Ask = field(default_factory=Ask)

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
        options: dict[str, Any] = {
            name: read(kind, tables.get(name, {}), f"{place}, [{name}]") for name, kind in known.items()
        }
        if heading.kind in ("bender", "recording"):
            return cls(heading=heading, text=text, tables=options, **options)
        return cls(heading=heading, text=text, tables=options, ask=options["ask"])


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
