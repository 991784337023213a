"""The commands that design: fibre angles of a spiral, cones of a valve."""

import argparse
from dataclasses import fields, replace
from typing import TYPE_CHECKING

from catheter.lab.dashboard import check_view, save_view, view_options
from data.errors import BadInput, CatheterError

if TYPE_CHECKING:
    from catheter.lab.outcome import Outcome
    from catheter.lab.scene import Scene
    from catheter.refine import Polish
    from catheter.task import Task


EXAMPLES = {  # by SI unit, what an option is given as
    "m": ("LENGTH", "'5 mm'"),
    "rad": ("ANGLE", "'1 deg'"),
    "m^-2": ("WEIGHT", "'1 mm^-2'"),
    "rad^-2": ("WEIGHT", "'1 rad^-2'"),
    "": ("NUMBER", "a number"),
}


def free_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `free`; the task's take their names from its fields."""
    from catheter.task import Task

    parser.add_argument("scene", nargs="?", default="free", help="a shipped scene (free), or a .toml file")
    for each in fields(Task):
        name, (metavar, example) = each.name.replace("_", "-"), EXAMPLES[each.metadata["unit"]]
        example = " or ".join(each.metadata["choices"]) or example
        help_text = f"{each.name.replace('_', ' ')}, as {example} (default: the scene's)"
        parser.add_argument(f"--{name}", dest=f"task_{each.name}", metavar=metavar, help=help_text)
    parser.add_argument("--pareto", action="store_true", help="also list the Pareto front of R, lambda_x and delta")
    view_options(parser, "the spiral inflating, the cost field", flag="--out")
    parser.add_argument("--force", action="store_true", help="overwrite dashboard and picture")


def valve_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `valve`."""
    parser.add_argument("scene", nargs="?", help="a shipped scene (valve), or a .toml file, with what is wanted")
    parser.add_argument("--angle", metavar="ANGLE", help="cone angle, as '35 deg'; with --thickness")
    parser.add_argument("--thickness", metavar="LENGTH", help="cone thickness, as '0.075 inch'; with --angle")
    parser.add_argument("--ratio", type=float, help="choose a cone of this Prev/Pfwd - 1")
    parser.add_argument("--forward", metavar="PRESSURE", help="choose a cone that cracks forward at, as '20 kPa'")
    parser.add_argument("--reverse", metavar="PRESSURE", help="choose a cone that cracks in reverse at, as '12 psi'")
    view_options(parser, "the map of the ratio", flag="--out")
    parser.add_argument("--force", action="store_true", help="overwrite dashboard and picture")


def _asked(options: argparse.Namespace) -> tuple["Scene", "Task"]:
    """Return the scene and its task, with what the command line changes in it."""
    from catheter.lab.scene import Scene
    from catheter.task import Task
    from data.options import read

    scene = Scene.load(options.scene)
    if scene.heading.kind != "free":
        raise BadInput(f"scene {options.scene}", f"is a {scene.heading.kind} scene", "a free scene has a [task]")
    given: dict[str, object] = {}
    for each in fields(Task):
        text = getattr(options, f"task_{each.name}")
        if text is not None:
            given[each.name] = text if each.metadata["unit"] or each.metadata["choices"] else _number(each.name, text)
    checked = read(Task, given, "command line")
    return scene, replace(scene.tables["task"], **{name: getattr(checked, name) for name in given})


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise BadInput(f"command line, {name}", f"is {text!r:.60}", "expected a number") from error


def free_(options: argparse.Namespace) -> "Outcome":
    """Search the fibre angles of a spiral, polish the best, and say what it is worth."""
    from catheter.lab.free_view import search_parts, search_values, tolerance_parts
    from catheter.lab.outcome import Outcome
    from catheter.lab.robot_view import robot_parts, robot_values
    from catheter.refine import polish, tolerance
    from catheter.search import search

    drawn = check_view(options, options.scene)
    scene, task = _asked(options)
    found = search(task)
    try:
        polished: Polish | str = polish(task, found.ties[0])
    except CatheterError as error:
        polished = f"no continuous optimum: {error}"
    suffers = tolerance(task, found.best, scene.tables["scatter"])
    values = search_values(found, polished, suffers) | robot_values(task, found.best, scene.tables["extender"])
    parts = [*search_parts(scene, found, polished), *tolerance_parts(suffers)]
    outcome = Outcome(values, parts + robot_parts(task, found.best, scene.tables["extender"]))
    if options.pareto:
        _add_front(outcome, task)
    if drawn:
        from catheter.lab.views.designs import TIMELINE, save_free

        save_view(outcome, options, lambda path: save_free(task, found.best, path), count=TIMELINE)
    return outcome


def _add_front(outcome: "Outcome", task: "Task") -> None:
    from catheter.lab.free_view import degrees
    from catheter.lab.outcome import table
    from catheter.pareto import pareto

    front = pareto(task)
    numbers = zip(front.radius_m.tolist(), front.length_ratio.tolist(), front.twist_rad.tolist(), strict=True)
    found = [
        {"angles_deg": angles, "radius_mm": 1e3 * radius, "lambda_x": ratio, "delta_rad": twist}
        for angles, (radius, ratio, twist) in zip(degrees(front.angles), numbers, strict=True)
    ]
    rows = [
        [*(f"{x:g}" for x in p["angles_deg"]), f"{p['radius_mm']:.3f}", f"{p['lambda_x']:.4f}", f"{p['delta_rad']:.3g}"]
        for p in found
    ]
    title = f"Pareto front: {len(rows)} designs that no other beats in R, lambda_x and delta at once"
    outcome.values["pareto"] = found
    outcome.parts.append(table(["alpha", "beta", "gamma", "R mm", "lambda_x", "delta rad"], rows, title, words=0))


def valve_(options: argparse.Namespace) -> "Outcome":
    """List the measured cones and what the thesis claims of them; interpolate or choose one."""
    from catheter.lab.valve_view import valve_outcome

    drawn = check_view(options)
    outcome = valve_outcome(options)
    if drawn:
        from catheter.lab.views.designs import save_valves

        save_view(outcome, options, save_valves)
    return outcome
