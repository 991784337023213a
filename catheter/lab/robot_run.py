"""A walking robot as `run` shows it: gait, parts, end-effector, and what is published beside what is simulated."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from catheter.gait import Gait, walk
from catheter.robot import Segment, layout, published
from catheter.task import Task
from data.signal import Array

if TYPE_CHECKING:
    from catheter.circuit import Circuit
    from catheter.end_effector import Answer
    from catheter.lab.scene import Scene

EVENTS_S = {"tB": 0.03, "tC": 0.17, "tE": 1.02, "tF": 1.16}  # published, thesis Fig 3.13
STROKE_MM = 28.0  # published, section 3.1.2
MEASURED_MM, SPREAD_MM = 27.0, 4.0  # measured, section 3.1.2: 27 +- 4


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot that walked: its gait, the cannula's task, segments from rear to front, end-effector.

    ends: "bender" and "twister", or nothing.
    """

    title: str
    gait: Gait
    task: Task
    segments: tuple[Segment, Segment, Segment]
    ends: Mapping[str, "Answer"] = field(default_factory=dict)


def walked(scene: "Scene", circuit: "Circuit", progress: Callable[[float], None]) -> Robot:
    """Return a scene's robot, with its end-effector where the scene has one: that is solved here."""
    tables = scene.tables
    task, extender = tables.get("task") or Task(), tables["extender"]
    gait = walk(circuit, tables["source"], tables["marks"], extender, tables.get("walk"))
    ends = _ends(scene, gait.time_s, progress) if "bender_line" in tables else {}
    spiral = task.design(*published())
    return Robot(scene.heading.title, gait, task, layout(task, spiral, extender), ends)


def _ends(scene: "Scene", time_s: Array, progress: Callable[[float], None]) -> dict[str, "Answer"]:
    from catheter.end_effector import End, answer

    found, tables = {}, scene.tables
    for name, what, before in (("bender", "bending", 0.0), ("twister", "twist", 0.5)):
        end = End(shape=tables[name], pattern=tables[f"{name}_map"], line=tables[f"{name}_line"], what=what)
        found[name] = answer(end, time_s, lambda share, before=before: progress(before + share / 2))  # type: ignore[misc]
    return found


def notes(robot: Robot) -> list[str]:
    """Return what a reader of the dashboard must know: where numbers are from, and what is drawn by convention."""
    made, inferred = robot.gait.made, robot.gait.made.inferred
    pushes = made.stroke_m <= made.pull_m
    moves, other = ("front moves from B to C", "rear") if pushes else ("rear moves from E to F", "front")
    told = [
        f"Extender {1e3 * made.extender.length:g} mm" + (f": {inferred}." if inferred else "."),
        f"No traction model: the {moves} only; what the extender gains or loses otherwise is drawn as slip of the"
        f" {other}.",
        "No contact model: free helices are wider than the cannula; their radius is cut to its room, reach and turns"
        " kept, the arc not."
        " Lengths of valves are drawn.",
    ]
    if robot.ends:
        told.append(
            "End-effector: printed tubes of chapter 6, quasi-static finite elements, drawn as an arc and an even twist."
            " Their pressures are ours: the thesis prints no feed, place or angle."
        )
    return told
