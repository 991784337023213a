"""The commands that design: fibre angles of a spiral, cones of a valve."""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import MISSING, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from data.errors import BadInput, CatheterError
from data.files import fresh

if TYPE_CHECKING:
    from catheter.helix import Design
    from catheter.lab.commands import Outcome
    from catheter.lab.scene import Scene
    from catheter.refine import Polish, Tolerance
    from catheter.search import Search
    from catheter.task import Task

ARTEFACT = (
    "The grid's optimum is an artefact of its step: a finer step finds other angles, and the continuous"
    " optimum lies elsewhere. Trust the tolerance, not the third digit of an angle."
)


def add_commands(command: Callable[[str, str], argparse.ArgumentParser]) -> None:
    """Add `free` and `valve` to the command line; the task's options take their names from its fields."""
    from catheter.task import Task

    free = command("free", "search the fibre angles of a spiral (default: the thesis's task)")
    free.add_argument("scene", nargs="?", default="free", help="a shipped scene (free), or a .toml file")
    for each in fields(Task):
        unit, name = each.metadata["unit"], each.name.replace("_", "-")
        example = {"m": "MM, as '5 mm'", "rad": "ANGLE, as '1 deg'", "": "VALUE"}.get(unit, f"VALUE in {unit}")
        free.add_argument(
            f"--{name}", dest=f"task_{each.name}", metavar=example.split(",")[0], help=_help(each, example)
        )
    free.add_argument("--pareto", action="store_true", help="also list the Pareto front of R, lambda_x and delta")
    free.add_argument("--out", metavar="FILE.rrd", help="also write a dashboard: the spiral inflating, the cost field")
    free.add_argument("--force", action="store_true", help="overwrite the dashboard")
    valve = command("valve", "list the conical valves, interpolate one, or choose one")
    valve.add_argument("scene", nargs="?", help="a shipped scene (valve), or a .toml file, with what is wanted")
    valve.add_argument("--angle", metavar="ANGLE", help="cone angle, as '35 deg'; with --thickness")
    valve.add_argument("--thickness", metavar="LENGTH", help="cone thickness, as '0.075 inch'; with --angle")
    valve.add_argument("--ratio", type=float, help="choose a cone of this Prev/Pfwd - 1")
    valve.add_argument("--forward", metavar="PRESSURE", help="choose a cone that cracks forward at, as '20 kPa'")
    valve.add_argument("--reverse", metavar="PRESSURE", help="choose a cone that cracks in reverse at, as '12 psi'")
    valve.add_argument("--out", metavar="FILE.rrd", help="also write a dashboard: the map of the ratio")
    valve.add_argument("--force", action="store_true", help="overwrite the dashboard")


def _help(each: Any, example: str) -> str:
    default = "" if each.default in (None, MISSING) else f"; default {each.default:.6} {each.metadata['unit']}".rstrip()
    return f"{each.name.replace('_', ' ')} ({example.replace('%', '%%')}{default})"


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
    return scene, replace(scene.task, **{name: getattr(checked, name) for name in given})


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise BadInput(f"command line, {name}", f"is {text!r:.60}", "expected a number") from error


def free_(options: argparse.Namespace) -> "Outcome":
    """Search the fibre angles of a spiral, polish the best, and say what it is worth."""
    from catheter.lab.commands import Outcome
    from catheter.lab.robot_view import robot_parts, robot_values
    from catheter.refine import polish, tolerance
    from catheter.search import search

    scene, task = _asked(options)
    found = search(task)
    try:
        polished: Polish | str = polish(task, found.ties[0])
    except CatheterError as error:
        polished = f"no continuous optimum: {error}"
    suffers = tolerance(task, found.best, scene.scatter)
    values = _search_values(found, polished, suffers) | robot_values(task, found.best, scene.extender)
    parts = [*_search_parts(scene, found, polished), *_tolerance_parts(suffers)]
    outcome = Outcome(values, parts + robot_parts(task, found.best, scene.extender))
    if options.pareto:
        _add_front(outcome, task)
    if options.out:
        from catheter.lab.views.designs import save_free

        save_view(outcome, options, lambda path: save_free(task, found.best, path))
    return outcome


def save_view(outcome: "Outcome", options: argparse.Namespace, save: Callable[[Path], None]) -> None:
    """Write a dashboard where --out asks for it, and say so. Raises CannotWrite."""
    out = Path(options.out)
    with fresh(out, options.force) as temporary:
        save(temporary)
    outcome.values["view"] = str(out)
    outcome.parts.append(f"Dashboard: {out}   (look at it with: rerun {out})")


def _add_front(outcome: "Outcome", task: "Task") -> None:
    from catheter.lab.commands import table
    from catheter.pareto import pareto

    front = pareto(task)
    numbers = zip(front.radius_m.tolist(), front.length_ratio.tolist(), front.twist_rad.tolist(), strict=True)
    found = [
        {"angles_deg": angles, "radius_mm": 1e3 * radius, "lambda_x": ratio, "delta_rad": twist}
        for angles, (radius, ratio, twist) in zip(_degrees(front.angles), numbers, strict=True)
    ]
    rows = [
        [*(f"{x:g}" for x in p["angles_deg"]), f"{p['radius_mm']:.3f}", f"{p['lambda_x']:.4f}", f"{p['delta_rad']:.3g}"]
        for p in found
    ]
    title = f"Pareto front: {len(rows)} designs that no other beats in R, lambda_x and delta at once"
    outcome.values["pareto"] = found
    outcome.parts.append(table(["alpha", "beta", "gamma", "R mm", "lambda_x", "delta rad"], rows, title, words=0))


def _degrees(angles: Any) -> Any:
    """Return angles in degrees as lists, without the rounding of the way there and back."""
    return (np.degrees(angles).round(9) + 0.0).tolist()


def shape_values(shape: "Design") -> dict[str, Any]:
    """Return a design as --json shows it: degrees and millimetres."""
    return {
        "alpha_deg": _degrees(shape.alpha_rad),
        "beta_deg": _degrees(shape.beta_rad),
        "gamma_deg": _degrees(shape.gamma_rad),
        "volume_ratio": shape.volume_ratio,
        "torsion": shape.torsion,
        "axial_stretch": shape.axial,
        "radial_stretch": shape.radial,
        "limiter_stretch": shape.limiter,
        "radius_mm": 1e3 * shape.radius_m,
        "angle_deg": float(np.degrees(shape.angle_rad)),
        "lambda_x": shape.length_ratio,
        "delta_rad": shape.twist_rad,
        "pitch_mm": 1e3 * shape.pitch_m,
        "turns": shape.turns,
    }


def _search_values(found: "Search", polished: "Polish | str", suffers: "Tolerance") -> dict[str, Any]:
    task = found.task
    other = replace(task, torsion="exact" if task.torsion == "thesis" else "thesis")
    return {
        **shape_values(found.best),
        "cost": found.cost,
        "ties_deg": _degrees(found.ties),
        "runner_up_deg": _degrees(found.runner_up),
        "runner_up_cost": found.runner_up_cost,
        "step_deg": _degrees(task.step),
        "cells": found.cells,
        "pairs": found.pairs,
        "feasible_pairs": found.feasible_pairs,
        "over_constrained": found.over_constrained,
        "slack": found.slack,
        "valid": found.valid,
        "seconds": found.seconds,
        "other_torsion": shape_values(other.design(*found.ties[0])),
        "polish": _polish_values(polished),
        "tolerance": _tolerance_values(suffers),
        "warning": ARTEFACT,
    }


def _polish_values(polished: "Polish | str") -> dict[str, Any]:
    if isinstance(polished, str):
        return {"failed": polished}
    ends = {"cost": polished.cost, "slope_per_rad": polished.slope, "boundary": polished.boundary}
    return shape_values(polished.design) | ends


def _tolerance_values(suffers: "Tolerance") -> dict[str, Any]:
    return {
        "bars": [
            {"what": b.what, "by": b.by, "unit": b.unit, "radius_mm": [1e3 * r for r in b.radius_m], "cost": b.cost}
            for b in suffers.bars
        ],
        "quantiles": [0.05, 0.5, 0.95],
        "radius_mm": [1e3 * r for r in suffers.radius_m],
        "cost": suffers.cost,
        "infeasible_share": suffers.failed,
    }


def _search_parts(scene: "Scene", found: "Search", polished: "Polish | str") -> Iterator[Any]:
    from catheter.lab.commands import table

    task, best = found.task, found.best
    yield (
        f"{scene.heading.title}: {_degrees(task.step):g} deg grid of {found.cells:,} designs at"
        f" V = {task.volume_ratio:g}, {found.seconds:.2f} s"
    )
    yield (
        f"{found.feasible_pairs:,} of {found.pairs:,} pairs reach it; with a third fibre {found.valid:,}"
        f" designs are valid,\n{found.over_constrained:,} over-constrained, {found.slack:,} slack."
    )
    other = replace(task, torsion="exact" if task.torsion == "thesis" else "thesis")
    rows = [_row("grid", best, found.cost), _row("runner-up", task.design(*found.runner_up), found.runner_up_cost)]
    physical = other.design(*found.ties[0])
    rows.append(_row(f"{other.torsion} torsion", physical, other.cost_of(physical)))
    if not isinstance(polished, str):
        rows.insert(2, _row("polished", polished.design, polished.cost))
    header = ["design", "alpha", "beta", "gamma", "cost", "R mm", "lambda_x", "twist", "pitch", "turns"]
    yield table(
        header,
        rows,
        f"Angles in deg, R, pitch in mm, twist in rad; target R {1e3 * task.wanted_radius:g}; {task.torsion} torsion",
    )
    if isinstance(polished, str):
        yield polished
    elif polished.boundary:
        yield f"The continuous optimum lies at a boundary: {polished.boundary}."
    yield ARTEFACT


def _tolerance_parts(suffers: "Tolerance") -> Iterator[Any]:
    from catheter.lab.commands import table

    yield table(
        ["moved by", "R mm, down", "R mm, up", "cost, down", "cost, up"],
        [[_by(b), *(f"{1e3 * r:.3f}" for r in b.radius_m), *(f"{c:.4g}" for c in b.cost)] for b in suffers.bars],
        "Tolerance: one thing moved by its standard deviation",
    )
    r, c = [1e3 * x for x in suffers.radius_m], suffers.cost
    yield (
        f"All at once, {suffers.scatter.samples:,} draws: R {r[0]:.2f} to {r[2]:.2f} mm, cost {c[0]:.3g} to {c[2]:.3g}"
        f" (5 to 95 %), {suffers.failed:.1%} infeasible"
    )


def _row(name: str, shape: "Design", cost: float) -> list[str]:
    angles = [f"{x:.6g}" for x in np.degrees([shape.alpha_rad, shape.beta_rad, shape.gamma_rad]).round(3)]
    numbers = [f"{1e3 * shape.radius_m:.3f}", f"{shape.length_ratio:.4f}", f"{shape.twist_rad + 0.0:.3g}"]
    return [name, *angles, f"{cost:.3g}", *numbers, f"{1e3 * shape.pitch_m:.2f}", f"{shape.turns:.2f}"]


def _by(bar: Any) -> str:
    size, unit = {"rad": (np.degrees(bar.by), " deg"), "m": (1e3 * bar.by, " mm")}.get(bar.unit, (bar.by, ""))
    return f"{bar.what} +-{size:.3g}{unit}"


def valve_(options: argparse.Namespace) -> "Outcome":
    """List the measured cones and what the thesis claims of them; interpolate or choose one."""
    from catheter.lab.valve_view import valve_outcome

    outcome = valve_outcome(options)
    if options.out:
        from catheter.lab.views.designs import save_valves

        save_view(outcome, options, save_valves)
    return outcome
