"""`invert` for a recording: two materials' constants from pressure and twist, or a map from surface markers."""

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from catheter.lab.dashboard import where
from catheter.lab.outcome import Outcome, table
from data.errors import BadInput
from data.files import check_inputs
from data.signal import Array

if TYPE_CHECKING:
    from catheter.lab.invert_live import Sought
    from catheter.lab.scene import Scene
    from catheter.marked import Marked
    from fem.discrepancy import Discrepancy


def recorded(options: argparse.Namespace) -> Outcome:
    """Return what a recording's topics tell: a map where it holds markers, else constants."""
    from catheter.marked import is_marked

    source = Path(options.source)
    for path in filter(None, (options.out, options.view)):
        check_inputs(Path(path), source)
    for name in ("seed", "seen", "noise", "number", "sweep"):
        if getattr(options, name) not in (None, []):
            raise BadInput(f"--{name}", "is given for a recording", "it is for a scene; a recording says what was seen")
    return _mapped(options, source) if is_marked(source) else _calibrated(options, source)


def _mapped(options: argparse.Namespace, source: Path) -> Outcome:
    """Reconstruct the map of the scene's tube from its markers."""
    from catheter.lab.invert_live import live, outputs, resumed
    from catheter.lab.invert_outcome import outcome_of, sure_of
    from catheter.lab.scene import recorded_scene
    from catheter.marked import marked
    from catheter.reconstruction import tube_voxels
    from fem.discrepancy import discrepant
    from fem.inverse import Inversion, Problem
    from fem.regular import neighbours

    scene = recorded_scene(source, options.scene, ("tube",))
    shape, inversion = scene.tables["tube"], scene.tables.get("inversion", Inversion())
    seen, voxels = marked(source), tube_voxels(shape)
    grid = (shape.voxels[0], shape.voxels[1])
    observations = seen.observations(voxels, shape)
    truth = seen.truth if len(seen.truth) == voxels.count else np.empty(0)
    out, view = outputs(options)
    seed = resumed(out, grid, options.force)
    first = np.full(voxels.count, math.sqrt(inversion.least * inversion.most)) if seed is None else seed
    pairs = neighbours(grid, (True, False))
    with live(_sought(scene, seen, grid, truth), out, view) as (tell, shown):
        found = discrepant(voxels, observations, first, pairs, inversion, tell)
        problem = Problem(voxels, list(observations))
        known = sure_of(problem, found.found, pairs, found.inversion, shown)
    title = f"{source.name}: {voxels.count} moduli from {len(seen.names)} markers"
    outcome = outcome_of(title, seen.kind, problem, found.found, truth, known, grid)
    _say(outcome, seen, found)
    outcome.values |= {"view": options.view}
    outcome.parts += [f"Map: {out}"] if out else []
    outcome.parts += [where(view)] if view else []
    return outcome


def _sought(scene: "Scene", seen: "Marked", grid: tuple[int, ...], truth: Array) -> "Sought":
    from catheter.lab.invert_live import Sought

    return Sought(scene.heading.title, seen.kind, grid, seen.stands[-1].place, truth)


def _say(outcome: Outcome, seen: "Marked", found: "Discrepancy") -> None:
    """Add what the markers told, and how the weight was found."""
    outcome.values |= {
        "markers": len(seen.names),
        "noise_m": seen.noise,
        "pressures_pa": [stand.pressure for stand in seen.stands],
        "tried": [{"weight": weight, "misfit": misfit} for weight, misfit in found.tried],
        "level": found.level,
        "left_out": list(seen.left_out),
    }
    where = ", ".join(
        f"{one.pressure / 1e3:.2f} ({one.start_s:.1f} to {one.end_s:.1f} s)" for one in (seen.rest, *seen.stands)
    )
    tried = ", ".join(f"{misfit:.3g} at {weight:.3g}" for weight, misfit in found.tried)
    outcome.parts[1:1] = [
        f"Markers at {where} kPa; noise of a coordinate, from its scatter at rest: {1e3 * seen.noise:.4f} mm.",
        f"Weight by the discrepancy principle: misfit {tried}; aimed at {found.level:.3g} noises.",
        *(f"Left out: {text}" for text in seen.left_out),
    ]
    if found.level > 1:
        outcome.parts.append("The noise does not explain what is left: the model, the tube or the frame is another.")


def _calibrated(options: argparse.Namespace, source: Path) -> Outcome:
    """Calibrate a scene's two materials from a recording's pressure and twist."""
    from catheter.filmed import seen
    from catheter.lab.scene import recorded_scene
    from catheter.redesign import calibrated

    for name in ("out", "view"):
        if getattr(options, name) is not None:
            raise BadInput(f"--{name}", "is given for a pressure and a twist", "two constants are no map")
    scene = recorded_scene(source, options.scene, ("tube", "map"))
    found = seen(source, scene.tables.get("cameras"))
    pressure, angle = found.pairs()
    sigma = math.radians(options.camera_noise) if math.isnan(found.sigma) else found.sigma
    shape, pattern = scene.tables["tube"], scene.tables["map"]
    fitted = calibrated(shape, pattern, pressure, angle, angle_sd=sigma, pressure_share=options.pressure_noise)
    seed = np.unique(pattern.moduli(*shape.voxels))
    names = [pattern.soft, pattern.stiff]
    rows = [
        [name, f"{m / 1e6:.4f}", f"{low / 1e6:.4f}", f"{high / 1e6:.4f}", f"{s / 1e6:.4f}"]
        for name, m, (low, high), s in zip(names, fitted.moduli, fitted.interval, seed, strict=True)
    ]
    head = ["material", "c1 MPa", "95 % from", "to", "as in the table"]
    values = {
        "origin": found.kind, "samples": len(pressure), "misfit": fitted.misfit, "steps": fitted.steps,
        "materials": {
            name: {"c1_pa": float(m), "interval_pa": [float(a), float(b)]}
            for name, m, (a, b) in zip(names, fitted.moduli, fitted.interval, strict=True)
        },
    }  # fmt: skip
    title = f"{source.name} ({found.kind}): two moduli from {len(pressure)} samples of pressure and twist"
    return Outcome(
        values, [table(head, rows, title), f"Misfit {fitted.misfit:.2f} of the noise given, {fitted.steps} steps."]
    )
