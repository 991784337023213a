"""Chapter 6, what can be computed without an inverse design: sizes, misprints, the twisting tube forward."""

from dataclasses import replace
from fractions import Fraction

import numpy as np

from catheter.inflatable import Path, Shape, inflated
from catheter.lab.scene import Scene
from catheter.lab.thesis.entries import UNKNOWN, Entry, Section, compare, told
from data.table import table

TEXT = "6.text"
FLOYD_STEINBERG = (Fraction(7, 16), Fraction(3, 16), Fraction(5, 16), Fraction(1, 16))
ONLY_DRAWN = "published as a picture only; wrap angle and pressures are not printed, so that our tube's are assumed"


def inverse(*, quick: bool) -> Section:
    """Return the numbers of chapter 6 that a forward solution or arithmetic gives; at 10 kPa for `quick`."""
    shape = Shape()
    outer, inner = shape.outer_radius, shape.outer_radius - shape.wall
    wall = outer**2 - inner**2
    c1 = [table("5.1").value(name, "c1") for name in ("Agilus30", "FLX9740")]
    return Section(
        entries=[
            compare(TEXT, "length over radius of the actuator", shape.length / outer),
            compare(TEXT, "length over diameter of the actuator", shape.length / (2 * outer)),
            compare(TEXT, "radius below ten thicknesses", outer / shape.wall),
            compare(TEXT, "sum of the Floyd-Steinberg weights", float(sum(FLOYD_STEINBERG))),
            compare(TEXT, "axial stress of (6.29) over P", inner**2 / wall),
            compare(TEXT, "hoop stress at the bore of (6.29) over P", (outer**2 + inner**2) / wall),
            compare(TEXT, "radial stress at the bore of (6.29) over P", -1.0),
            compare(TEXT, "first inner edge of Algorithm 4", float(np.mean(c1))),
            *_forward((10e3,) if quick else (20e3, 50e3, 100e3), quick=quick),
        ]
    )


def _forward(pressures: tuple[float, ...], *, quick: bool) -> list[Entry]:
    tables = Scene.load("twist").tables
    shape = replace(tables["tube"], divisions=(32, 32, 1)) if quick else tables["tube"]
    run = inflated(shape, tables["map"], Path(pressures=pressures))
    return [
        told("Fig 6.22, page 150", f"twist at {p / 1e3:.0f} kPa (simulated)", "a picture", f"{twist:.2f} deg",
             verdict=UNKNOWN, reason=ONLY_DRAWN)
        for p, twist in zip(pressures, np.degrees(run.twist), strict=True)
    ]  # fmt: skip
