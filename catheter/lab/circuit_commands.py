"""`run locomotion` and `tune`: the hydraulic circuit's commands."""

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from catheter.lab.dashboard import check_view, save_view, view_options
from catheter.lab.outcome import Outcome, progress, table
from data.errors import BadInput

if TYPE_CHECKING:
    from catheter.circuit import Circuit
    from catheter.lab.scene import Scene

WALKS = ("locomotion", "robot")  # kinds of scenes


def run_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `run`."""
    parser.add_argument("scene", help="a shipped scene (locomotion, robot), or a .toml file")
    _fit_option(parser)
    view_options(parser, "the robot walking in its cannula, pressures, volumes, flows, stroke")
    parser.add_argument("--force", action="store_true", help="overwrite dashboard and picture")


def tune_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `tune`."""
    _fit_option(parser)
    parser.add_argument("--scene", default="locomotion", help="a shipped scene (default: locomotion), or a .toml file")
    parser.add_argument(
        "--transition", type=float, default=1.0, metavar="PA", help="laminar transition (default: 1 Pa)"
    )


def _fit_option(parser: argparse.ArgumentParser) -> None:
    text = "put a fitted accumulator or valve into segment N (1 is next to the source)"
    parser.add_argument("--fit", action="append", default=[], metavar="N=FIT.toml", help=text)


def _scene(name: str, fits: Sequence[str]) -> "tuple[Scene, Circuit]":
    from catheter.circuit import thesis_circuit, with_fit
    from catheter.lab.scene import Scene

    scene = Scene.load(name)
    if scene.heading.kind not in WALKS:
        raise BadInput(f"scene {name}", f"is of kind {scene.heading.kind!r}", f"name a {' or '.join(WALKS)} scene")
    circuit = scene.tables.get("circuit") or thesis_circuit()
    for each in fits:
        number, _, path = each.partition("=")
        if not number.isdecimal() or not path:
            raise BadInput("--fit", f"is {each!r:.60}", "write N=FIT.toml")
        circuit = with_fit(circuit, int(number) - 1, Path(path))
    return scene, circuit


def run_(options: argparse.Namespace) -> Outcome:
    """Run a locomotion scene: events, objective and stroke of one periodic cycle, beside the published."""
    from catheter.lab.robot_run import EVENTS_S, STROKE_MM
    from catheter.locomotion import stroke as stroke_of
    from catheter.tuning import NAMES, evaluate

    drawn = check_view(options, options.scene)
    scene, circuit = _scene(options.scene, options.fit)
    source, marks, extender = (scene.tables[name] for name in ("source", "marks", "extender"))
    score = evaluate(circuit, source, marks)
    events = dict(zip(NAMES, score.events_s[0].tolist(), strict=True))
    known = bool(np.isfinite(score.extender[0]).all())  # an event that does not happen is NaN
    stroke = stroke_of(score.extender[0], extender).stroke_m if known else float("nan")
    values: dict[str, Any] = {
        "scene": scene.heading.title,
        "kind": "simulated",
        "events_s": events,
        "J": float(score.objective[0]),
        "forward": float(score.forward[0]),
        "reverse": float(score.reverse[0]),
        "stroke_mm": 1e3 * stroke,
        "extender_length_mm": 1e3 * extender.length,
        "published": {"events_s": EVENTS_S, "stroke_mm": STROKE_MM},
        "mismatch": {
            "events_s": {name: events[name] - EVENTS_S[name] for name in NAMES},
            "stroke_mm": 1e3 * stroke - STROKE_MM,
        },
    }
    rows = [
        [name, f"{1e3 * events[name]:.2f}", f"{1e3 * published:.0f}", f"{1e3 * (events[name] - published):+.1f}"]
        for name, published in EVENTS_S.items()
    ]
    outcome = Outcome(values)
    outcome.parts = [
        f"{scene.heading.title} (simulated, periodic state)",
        table(["event", "ms", "published", "mismatch"], rows),
        f"J = 2ab = {values['J']:.5f}, a = {values['forward']:.5f}, b = {values['reverse']:.5f}"
        if marks.objective == "product"
        else f"J = a^2 + b^2 - |a - b| = {values['J']:.5f}",
        f"Stroke {values['stroke_mm']:.1f} mm a cycle, published {STROKE_MM:.0f} mm; "
        f"extender of {values['extender_length_mm']:.0f} mm: its length is inferred, the thesis prints none.",
    ]
    if drawn:
        _draw(scene, circuit, options, outcome)
    return outcome


def _draw(scene: "Scene", circuit: "Circuit", options: argparse.Namespace, outcome: Outcome) -> None:
    """Write the dashboard of a walking robot; its end-effector, if it has one, is solved here."""
    from catheter.lab.robot_run import walked
    from catheter.lab.views.robot import moment_of_interest, save_robot

    with progress("walking") as advance:
        robot = walked(scene, circuit, advance)
    save_view(outcome, options, lambda path: save_robot(robot, path), at_s=moment_of_interest(robot))
    for name, one in robot.ends.items():
        most = float(np.degrees(np.abs(one.angle_rad).max()))
        outcome.values[f"{name}_deg"] = most
        outcome.parts.append(f"{name.capitalize()} of the end-effector (simulated): {most:.1f} deg at most.")


def tune_(options: argparse.Namespace) -> Outcome:
    """Find the best K2 and K3: a map of the thesis's grid, then uphill from its best cell."""
    from dataclasses import replace

    from catheter.optimum import optimum
    from catheter.sweep import GRID_COUNT, Scatter, built, coefficient_map, grid_coefficients
    from catheter.tuning import evaluate
    from data.table import table as thesis_table

    scene, circuit = _scene(options.scene, options.fit)
    source, marks = scene.tables["source"], scene.tables["marks"]
    circuit = replace(
        circuit,
        segments=tuple(replace(s, valve=replace(s.valve, transition=options.transition)) for s in circuit.segments),
    )
    grid = grid_coefficients()
    coefficient_map(circuit, source, marks, grid[:2])  # compiled beforehand, or read from numba's cache
    started = time.perf_counter()
    score = coefficient_map(circuit, source, marks, grid)
    seconds = time.perf_counter() - started
    n2, n3 = (int(n) for n in np.unravel_index(score.objective.argmax(), (GRID_COUNT, GRID_COUNT)))
    first = circuit.segments[0].valve.coefficient
    best = optimum(circuit.with_coefficients(first, grid[n2], grid[n3]), source, marks)
    valves = thesis_table("3.4")
    published = [valves.value(f"Valve {i}", "optimal") for i in (1, 2, 3)]
    printed = float(evaluate(circuit.with_coefficients(*published), source, marks).objective[0])
    robots = built(best.circuit, source, marks, Scatter())
    low, middle, high = np.percentile(robots.objective, [5, 50, 95])
    values = {
        "K2": best.circuit.segments[1].valve.coefficient,
        "K3": best.circuit.segments[2].valve.coefficient,
        "J": best.objective,
        "K2_published": published[1],
        "K3_published": published[2],
        "J_published": printed,
        "J_published_share": printed / best.objective,
        "map": {
            "n2": n2 + 1,
            "n3": n3 + 1,
            "K2": float(grid[n2]),
            "K3": float(grid[n3]),
            "J": float(score.objective.max()),
        },
        "seconds": seconds,
        "cells": score.objective.size,
        "cycles": int(score.cycles.sum()),
        "built_J": {"p05": float(low), "p50": float(middle), "p95": float(high), "robots": len(robots.objective)},
    }
    rows = [
        ["optimum", f"{values['K2']:.4g}", f"{values['K3']:.4g}", f"{values['J']:.5f}"],
        [
            f"best cell of the map ({n2 + 1}, {n3 + 1})",
            f"{grid[n2]:.4g}",
            f"{grid[n3]:.4g}",
            f"{score.objective.max():.5f}",
        ],
        ["published", f"{published[1]:.4g}", f"{published[2]:.4g}", f"{printed:.5f}"],
    ]
    outcome = Outcome(values)
    outcome.parts = [
        table(["", "K2 [m^3 Pa^-1/2 s^-1]", "K3", "J"], rows, f"{scene.heading.title}: valves (simulated)"),
        f"{values['cells']} cells to their periodic state in {seconds:.2f} s ({values['cycles']} cycles run). "
        f"The published valves reach {100 * printed / best.objective:.1f} % of the optimum's J.",
        f"{len(robots.objective)} robots built with scatter about the optimum: J {low:.3f} to {high:.3f} (5 to 95 %), "
        f"median {middle:.3f}.",
    ]
    return outcome
