"""Scenes: TOML files that say what an experiment is. What is computed from one is asked for."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from catheter.bench import Bench, Noise, Plant, Schedule
from catheter.inflatable import Path as LoadPath
from catheter.inflatable import Pattern, Shape
from catheter.refine import Scatter
from catheter.robot import Extender
from catheter.task import Task
from catheter.valve import Wanted
from data.ask import Ask
from data.errors import BadInput, nearest
from data.options import find_toml, load_toml, option, parse_toml, read, shipped_names

FOLDER = Path(__file__).parents[2] / "data" / "scenes"


@dataclass(frozen=True, kw_only=True)
class Heading:
    """The `[scene]` table: what kind of experiment, and what a reader calls it."""

    kind: str = option(choices=("bender", "recording", "free", "valve", "tube"))
    title: str


# The tables each kind of scene may have, beside [scene]; a table left out takes its defaults.
TABLES: dict[str, dict[str, type]] = {
    "recording": {"ask": Ask},
    "bender": {"drive": Schedule, "bench": Bench, "plant": Plant, "noise": Noise, "ask": Ask},
    "free": {"task": Task, "scatter": Scatter, "extender": Extender},
    "valve": {"wanted": Wanted},
    "tube": {"tube": Shape, "map": Pattern, "path": LoadPath},
}


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A checked scene: its options by table, and the text it was read from."""

    heading: Heading
    text: str
    drive: Schedule = field(default_factory=Schedule)
    bench: Bench = field(default_factory=Bench)
    plant: Plant = field(default_factory=Plant)
    noise: Noise = field(default_factory=Noise)
    ask: Ask = field(default_factory=Ask)
    task: Task = field(default_factory=Task)
    scatter: Scatter = field(default_factory=Scatter)
    extender: Extender = field(default_factory=Extender)
    wanted: Wanted = field(default_factory=Wanted)
    tube: Shape = field(default_factory=Shape)
    map: Pattern = field(default_factory=Pattern)
    path: LoadPath = field(default_factory=LoadPath)

    @classmethod
    def load(cls, name: str | Path) -> "Scene":
        """Return a shipped scene by name, or one from a .toml file.

        Raises BadInput naming file, table and key of whatever is unknown or impossible in it.
        """
        path = find_toml(name, FOLDER, "scene")
        return cls.parse(load_toml(path)[1], str(path))

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
            name: read(kind, tables[name], f"{place}, [{name}]") for name, kind in known.items() if name in tables
        }
        return cls(heading=heading, text=text, **options)


def names() -> list[str]:
    """Return the names of the scenes that come with the project."""
    return shipped_names(FOLDER)
