"""How the conical valves read: the measured ones, one between them, one chosen, and what the thesis says of them."""

import argparse
from typing import Any

import numpy as np

from catheter.lab.outcome import Outcome, table
from catheter.lab.scene import Scene
from catheter.valve import INCH, Choice, Wanted, choose, cone, measured
from catheter.valve_claims import claims
from data.errors import BadInput
from data.units import quantity


def valve_outcome(options: argparse.Namespace) -> Outcome:
    """Return what the command line asks of the valves. Raises BadInput for halves of a question."""
    if (options.angle is None) != (options.thickness is None):
        raise BadInput("valve", "one of --angle and --thickness", "give both, or neither")
    wanted = _wanted(options)
    if options.angle is not None:
        angle = quantity(options.angle, "rad", "--angle")
        thickness = quantity(options.thickness, "m", "--thickness")
        found = cone(angle, thickness)
        values = _cone_values(angle, thickness, float(found.forward_pa), float(found.reverse_pa))
        return Outcome({"cone": values}, [_cone_text("Interpolated", values)])
    if wanted != Wanted():
        chosen = choose(wanted)
        values = _choice_values(chosen)
        return Outcome({"cone": values}, [_cone_text("Measured" if chosen.measured else "Interpolated", values)])
    return Outcome({"measured": _measured_values(), "claims": [vars(c) for c in claims()]}, _parts())


def _wanted(options: argparse.Namespace) -> Wanted:
    wanted = Wanted()
    if options.scene is not None:
        scene = Scene.load(options.scene)
        if scene.heading.kind != "cone":
            raise BadInput(f"scene {options.scene}", f"is a {scene.heading.kind} scene", "a cone scene has a [wanted]")
        wanted = scene.tables["wanted"]
    given = {
        name: quantity(text, "Pa", f"--{name}") for name in ("forward", "reverse") if (text := getattr(options, name))
    }
    ratio = wanted.ratio if options.ratio is None else options.ratio
    return Wanted(
        ratio=ratio, forward=given.get("forward", wanted.forward), reverse=given.get("reverse", wanted.reverse)
    )


def _cone_values(angle: float, thickness: float, forward: float, reverse: float) -> dict[str, Any]:
    return {
        "angle_deg": round(float(np.degrees(angle)), 9),
        "thickness_in": round(thickness / INCH, 9),
        "forward_kpa": forward / 1e3,
        "reverse_kpa": reverse / 1e3,
        "ratio": reverse / forward - 1,
    }


def _choice_values(found: Choice) -> dict[str, Any]:
    values = _cone_values(found.angle_rad, found.thickness_m, found.forward_pa, found.reverse_pa)
    return values | {"miss": found.miss, "measured": found.measured}


def _cone_text(how: str, values: dict[str, Any]) -> str:
    return (
        f"{how} cone of {values['angle_deg']:.4g} deg, {values['thickness_in']:.4g} in: cracks at"
        f" {values['forward_kpa']:.4g} kPa forward, {values['reverse_kpa']:.4g} kPa in reverse,"
        f" ratio {values['ratio']:.3f}"
    )


def _measured_values() -> list[dict[str, Any]]:
    known = measured()
    return [
        _cone_values(float(angle), float(thickness), float(known.forward_pa[i, j]), float(known.reverse_pa[i, j]))
        for i, angle in enumerate(known.angle_rad)
        for j, thickness in enumerate(known.thickness_m)
    ]


def _parts() -> list[Any]:
    known = measured()
    header = ["deg", *(f"{thickness / INCH:.3f} in" for thickness in known.thickness_m)]
    rows = [
        [
            f"{np.degrees(angle):.0f}",
            *(f"{f / 1e3:.1f} / {r / 1e3:.1f} ({x:.2f})" for f, r, x in zip(*row, strict=True)),
        ]
        for angle, *row in zip(known.angle_rad, known.forward_pa, known.reverse_pa, known.ratio, strict=True)
    ]
    parts: list[Any] = [table(header, rows, "Cracking pressure in kPa, forward / reverse (ratio), thesis Table 3.5")]
    for claim in claims():
        parts.append(f"{'holds' if claim.holds else 'FAILS'}: {claim.text}. Table: {claim.table}")
        parts += [f"    {cell}" for cell in claim.against]
    return [*parts, "Ratio: Prev/Pfwd - 1. Valid from 0 to 50 deg and 0.050 to 0.110 in; nothing beyond was measured."]
