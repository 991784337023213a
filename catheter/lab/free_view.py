"""How a search reads: its best design beside others, and what the scatter of workmanship does to it."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from catheter.helix import Design
from catheter.lab.outcome import table
from catheter.lab.scene import Scene
from catheter.refine import Bar, Polish, Tolerance
from catheter.search import Search

ARTEFACT = (
    "The grid's optimum is an artefact of its step: a finer step finds other angles, and the continuous"
    " optimum lies elsewhere. Trust the tolerance, not the third digit of an angle."
)


def degrees(angles: Any) -> Any:
    """Return angles in degrees as lists, without the rounding of the way there and back."""
    return (np.degrees(angles).round(9) + 0.0).tolist()


def shape_values(shape: Design) -> dict[str, Any]:
    """Return a design as --json shows it: degrees and millimetres."""
    return {
        "alpha_deg": degrees(shape.alpha_rad),
        "beta_deg": degrees(shape.beta_rad),
        "gamma_deg": degrees(shape.gamma_rad),
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


def search_values(found: Search, polished: Polish | str, suffers: Tolerance) -> dict[str, Any]:
    """Return a search with its polish, its twin under the other torsion and its tolerance for --json."""
    task = found.task
    other = replace(task, torsion="exact" if task.torsion == "thesis" else "thesis")
    return {
        **shape_values(found.best),
        "cost": found.cost,
        "ties_deg": degrees(found.ties),
        "runner_up_deg": degrees(found.runner_up),
        "runner_up_cost": found.runner_up_cost,
        "step_deg": degrees(task.step),
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


def _polish_values(polished: Polish | str) -> dict[str, Any]:
    if isinstance(polished, str):
        return {"failed": polished}
    ends = {"cost": polished.cost, "slope_per_rad": polished.slope, "boundary": polished.boundary}
    return shape_values(polished.design) | ends


def _tolerance_values(suffers: Tolerance) -> dict[str, Any]:
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


def search_parts(scene: Scene, found: Search, polished: Polish | str) -> Iterator[Any]:
    """Yield the same for people: counts, designs side by side, and what to think of them."""
    task, best = found.task, found.best
    yield (
        f"{scene.heading.title}: {degrees(task.step):g} deg grid of {found.cells:,} designs at"
        f" V = {task.volume_ratio:g}, {found.seconds:.2f} s"
    )
    yield (
        f"{found.feasible_pairs:,} of {found.pairs:,} pairs reach it; with a third fibre {found.valid:,}"
        f" designs are valid,\n{found.over_constrained:,} over-constrained, {found.slack:,} slack."
    )
    other = replace(task, torsion="exact" if task.torsion == "thesis" else "thesis")
    rows = [_row("grid", best, found.cost)]
    if np.isfinite(found.runner_up_cost):
        rows.append(_row("runner-up", task.design(*found.runner_up), found.runner_up_cost))
    physical = other.design(*found.ties[0])
    rows.append(_row(f"{other.torsion} torsion", physical, other.cost_of(physical)))
    if not isinstance(polished, str):
        rows.insert(-1, _row("polished", polished.design, polished.cost))
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


def tolerance_parts(suffers: Tolerance) -> Iterator[Any]:
    """Yield the tolerance bars, and all scatter at once."""
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


def _row(name: str, shape: Design, cost: float) -> list[str]:
    angles = [f"{x:.6g}" for x in np.degrees([shape.alpha_rad, shape.beta_rad, shape.gamma_rad]).round(3)]
    numbers = [f"{1e3 * shape.radius_m:.3f}", f"{shape.length_ratio:.4f}", f"{shape.twist_rad + 0.0:.3g}"]
    return [name, *angles, f"{cost:.3g}", *numbers, f"{1e3 * shape.pitch_m:.2f}", f"{shape.turns:.2f}"]


def _by(bar: Bar) -> str:
    size, unit = {"rad": (np.degrees(bar.by), " deg"), "m": (1e3 * bar.by, " mm")}.get(bar.unit, (bar.by, ""))
    return f"{bar.what} +-{size:.3g}{unit}"
