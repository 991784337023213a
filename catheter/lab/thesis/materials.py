"""Chapter 5: what the numbers of Table 5.1 and of the printed actuator say of each other."""

import math

import numpy as np

from catheter.inflatable import Shape
from catheter.lab.thesis.entries import UNKNOWN, Entry, Section, compare, told, unknown
from data.errors import BadInput
from data.table import table
from fem.material import NeoHooke, printable

TEXT = "5.text"
NO_DATA = "the tensile data are not published"
BREAK = (
    "ours is the stress of the law with the printed c1 at the printed elongation: the fits were made at smaller strain"
)


def materials(*, quick: bool) -> Section:
    """Hold c1, elongation and strength of each printed material against each other, and the text's sizes."""
    laws = _laws()
    entries = [told("Table 5.1", "c1 of seven materials", "0.20 to 19.8 MPa", "-", verdict=UNKNOWN, reason=NO_DATA)]
    for name, law in laws.items():
        stress = float(law.uniaxial(1 + law.elongation))
        reason = f"{BREAK}; this c1 holds at small strain only" if name == "FLX9795" else BREAK
        entries.append(compare("5.1", name, stress, "strength", reason=reason))
    shape = Shape()
    around = math.pi * (2 * shape.outer_radius - shape.wall) / shape.voxels[0]
    entries += [
        unknown(TEXT, "elongation to which FLX9740's fit holds", "published", NO_DATA),
        unknown(TEXT, "four specimens of FLX9785 scatter", "published", NO_DATA),
        compare(TEXT, "stretchable materials of the printer", len(laws)),
        compare(TEXT, "voxel along the length", shape.length / shape.voxels[1]),
        compare(TEXT, "voxel around, in the middle of the wall", around),
        compare(TEXT, "voxels of the actuator", math.prod(shape.voxels)),
        _young(laws["Agilus30"]),
    ]
    return Section(entries=entries)


def _laws() -> dict[str, NeoHooke]:
    """Return the materials of Table 5.1 that have a c1."""
    found = {}
    for name in table("5.1").rows:
        try:
            found[name] = printable(name)
        except BadInput:
            continue  # a row without c1 is no design material
    return found


def _young(law: NeoHooke) -> Entry:
    step = 1e-5
    slope = float(np.diff(law.uniaxial(np.array([1 - step, 1 + step]))).item()) / (2 * step)
    return compare(TEXT, "Young's modulus over c1", slope / law.c1)
