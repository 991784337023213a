"""How a shape reads: how well its volume is kept, how far it is strained, what it fills of its vessel."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from catheter.centreline import Vessel, load
from catheter.frames import frenet, rotation_minimising, total_twist
from catheter.lab.outcome import Outcome, table
from catheter.lab.scene import Scene
from catheter.motions import Actuator, Motions, build, refuse_overlap
from catheter.occlusion import Occlusion, occlusion
from catheter.shape import Shape
from catheter.target import query, stretches
from data.errors import BadInput
from data.signal import Array

QS = (0.25, 0.5, 0.75, 1.0)
GRID = (100, 100, 10)  # around, along, through: where the volume is looked at
MM = 1e3
COMPONENTS = ((0, 0, "rr"), (1, 1, "vv"), (2, 2, "ww"), (0, 1, "rv"), (0, 2, "rw"), (1, 2, "vw"))


@dataclass(frozen=True, kw_only=True, eq=False)
class Shaped:
    """A scene's shape in its vessel, and the q that were asked for."""

    title: str
    vessel: Vessel
    actuator: Actuator
    shape: Shape
    qs: tuple[float, ...]


def shaped(name: str, qs: list[float] | None = None, file: str | None = None, unit: str | None = None) -> Shaped:
    """Return the shape of a scene, with another vessel file if one is named. Raises BadInput."""
    scene = Scene.load(name)
    if "vessel" not in scene.tables:
        raise BadInput(f"scene {name}", f"is a {scene.heading.kind} scene", "a shape scene has a [vessel]")
    tables = scene.tables
    source = tables["vessel"]
    if file:
        source = replace(source, file=file, unit=unit or "")
    elif unit:
        raise BadInput("--unit", "is given without --vessel", "set unit in the scene's [vessel]")
    if not all(0 <= q <= 1 for q in qs or ()):
        raise BadInput("--q", f"is {qs}", "expected 0 to 1")
    actuator = tables["actuator"]
    vessel, motions = placed(replace(scene, tables={**tables, "vessel": source}))
    shape = build(vessel, actuator, motions)
    return Shaped(
        title=scene.heading.title,
        vessel=vessel,
        actuator=actuator,
        shape=shape,
        qs=tuple(sorted(set(qs or QS))),
    )


def placed(scene: Scene) -> tuple[Vessel, Motions]:
    """Return a scene's vessel and what its shape is made of. Raises BadInput for what makes no vessel."""
    motions = Motions(**{motion: scene.tables[motion] for motion in ("spiral", "bend", "twist", "balloon")})
    return load(scene.tables["vessel"]), motions


def volume_error(shape: Shape, q: float, grid: tuple[int, int, int] = GRID) -> Array:
    """Return det F - 1 at a grid of places (around, along, through)."""
    around, along, through = grid
    wall = shape.wall(
        q,
        np.linspace(shape.inner, shape.outer, through),
        2 * np.pi * np.arange(around) / around,
        np.linspace(0, shape.length, along),
    )
    return wall.volume_ratio - 1


def shape_outcome(found: Shaped, voxel: tuple[int, int] | None, map_name: str | None) -> Outcome:
    """Return what `shape` says."""
    rows = [_row(found, q) for q in found.qs]
    head = ["q", "|det F-1|", "wall um", "outer mm", "bend mm", "stretch", "fills %", "touch deg", "beyond mm"]
    shown = [
        [
            f"{r['q']:g}",
            f"{r['volume_error']:.1e}",
            "-".join(f"{1e3 * x:.3g}" for x in r["wall_mm"]),
            "-".join(f"{x:.3g}" for x in r["outer_mm"]),
            f"{r['bend_mm']:.3g}",
            f"{r['stretch']:.3g}",
            f"{r['occlusion_percent']:.1f}",
            f"{r['contact_deg']:.0f}",
            f"{r['beyond_mm']:.3f}",
        ]
        for r in rows
    ]
    origin = "simulated" if found.vessel.simulated else "computed, in a vessel from a file"
    places = int(np.prod(GRID))
    parts: list[Any] = [
        *_vessel_lines(found.vessel),
        _frames_line(found),
        table(head, shown, f"{found.title} ({origin}); det F at {places:,} places of the wall", words=0),
        "wall, outer: thickness, and distance from the centreline; bend: the centreline's smallest radius;\n"
        "stretch: largest principal; fills: the outer wall's mean share of the vessel's cross-section;\n"
        "touch: arc of the vessel within 3 % of its radius, most in a plane; beyond: past its wall, - inside.",
    ]
    values: dict[str, Any] = {
        "title": found.title,
        "simulated": True,
        "vessel": {
            "simulated": found.vessel.simulated,
            "kind": found.vessel.kind,
            "length_mm": MM * found.vessel.length,
            "residuals": found.vessel.residual,
            "notes": list(found.vessel.notes),
        },
        "places": places,
        "shapes": rows,
    }
    if voxel is not None:
        _add_query(values, parts, found, voxel)
    if map_name:
        _add_flags(values, parts, found, map_name)
    return Outcome(values, parts)


def _vessel_lines(vessel: Vessel) -> list[str]:
    lines = list(vessel.notes)
    if vessel.residual:
        off = ", ".join(f"{name} {100 * value:.2g} %" for name, value in vessel.residual.items())
        lines.append(f"Centreline: {vessel.kind}. Points off, of the local radius: {off} (points held out).")
    return lines


def _frames_line(found: Shaped) -> str:
    w = np.linspace(0, found.shape.length, 400)
    final = found.shape.final
    twist = np.degrees(total_twist(rotation_minimising(final, w, found.shape.seed)))
    try:
        frenet(final, w)
    except BadInput as error:
        return f"{error.place}: {error.found}.\nFrames: double reflection, total twist {twist:.1f} deg."
    return f"Frames: double reflection, total twist {twist:.1f} deg (Frenet-Serret exists here too)."


def _row(found: Shaped, q: float) -> dict[str, Any]:
    shape = found.shape
    refuse_overlap(shape, q)
    ends = shape.wall(
        q,
        np.array([shape.inner, shape.outer]),
        2 * np.pi * np.arange(64) / 64,
        np.linspace(0, shape.length, 200),
    )
    curvature = ends.centre.along.bends[:, 0] / ends.centre.along.speed[0]
    wall, outer = ends.h[..., 1] - ends.h[..., 0], ends.h[..., 1]
    filled: Occlusion = occlusion(shape, found.vessel, q)
    share = filled.share if len(filled.share) else np.array([np.nan])
    return {
        "q": q,
        "volume_error": float(np.abs(volume_error(shape, q)).max()),
        "wall_mm": [MM * float(wall.min()), MM * float(wall.max())],
        "outer_mm": [MM * float(outer.min()), MM * float(outer.max())],
        "bend_mm": MM * float(1 / max(np.linalg.norm(curvature, axis=0).max(), 1e-9)),
        "stretch": float(np.linalg.norm(ends.gradient, ord=2, axis=(-2, -1)).max()),
        "occlusion_percent": 100 * float(share.mean()),
        "occlusion_most_percent": 100 * float(share.max()),
        "contact_deg": float(np.degrees(filled.contact.max(initial=0.0))),
        "beyond_mm": MM * float(filled.beyond.max(initial=-np.inf)),
    }


def _add_query(values: dict[str, Any], parts: list[Any], found: Shaped, voxel: tuple[int, int]) -> None:
    asked = query(found.shape, found.actuator, voxel, found.qs[-1])
    strain = {name: float(asked.strain[i, j]) for i, j, name in COMPONENTS}
    values["voxel"] = {
        "voxel": list(voxel),
        "q": asked.q,
        "gradient": asked.gradient.tolist(),
        "strain": strain,
        "volume_ratio": asked.volume_ratio,
        "stretch": asked.stretch,
        "corners_rest_mm": (MM * asked.rest).tolist(),
        "corners_mm": (MM * asked.moved).tolist(),
    }
    rows = [[name, *(f"{x:.5f}" for x in row)] for name, row in zip("rvw", asked.gradient, strict=True)]
    text = ", ".join(f"E_{name} {value:.5f}" for name, value in strain.items())
    parts += [
        table(["F", "r", "v", "w"], rows, f"Voxel {voxel[0]}, {voxel[1]} at q = {asked.q:g}: its middle"),
        f"{text}\ndet F - 1 = {asked.volume_ratio - 1:.1e}, largest stretch {asked.stretch:.4f}"
        " (r outwards, v around, w along)",
    ]


def _add_flags(values: dict[str, Any], parts: list[Any], found: Shaped, map_name: str) -> None:
    from data.table import table as thesis_table
    from fem.voxel_map import load_map

    made = load_map(map_name)
    if made.voxels.shape != tuple(found.actuator.voxels):
        raise BadInput(f"map {map_name}", f"has {made.voxels.shape} voxels", f"the scene {found.actuator.voxels}")
    library, stretch = thesis_table("5.1"), stretches(found.shape, found.actuator, found.qs[-1])
    over = {}
    for k, name in enumerate(made.materials):
        limit = library.value(name, "elongation_at_least") if name in library.rows else 0.0
        over[name] = int(((stretch > 1 + limit) & (made.voxels == k)).sum())
    values["overstretched"] = over
    said = ", ".join(f"{name} {count}" for name, count in over.items() if count) or "none"
    parts.append(f"Voxels stretched past their material's elongation at q = {found.qs[-1]:g}: {said}.")
