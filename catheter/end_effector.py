"""The end-effector of Fig 3.1: a bending and a twisting printed tube, each on a pressure line of its own.

The thesis names both and prints neither how they are fed nor how they sit on the robot: the lines are inputs.
What the tubes do at a pressure is solved by finite elements, when it is asked for.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from catheter.inflatable import Path, Pattern, Shape, build
from catheter.response import Fineness, Response, respond
from data.errors import BadInput
from data.options import option
from data.signal import Array

FINENESS = Fineness(first=6, tolerance=2e-3)  # a tenth of a degree: finer than a picture shows


@dataclass(frozen=True, kw_only=True)
class Line:
    """A pressure line: 0 until `start`, then up to `most` and back every `period`, as 1 - cos. The thesis has none."""

    most: float = option(80e3, unit="Pa", least=0.0, most=1e7)
    start: float = option(0.0, unit="s", least=0.0)
    period: float = option(2.0, unit="s", least=1e-3)

    def at(self, time_s: Array) -> Array:
        """Return the pressure [Pa] at times (n,)."""
        turn = 2 * np.pi * np.maximum(time_s - self.start, 0.0) / self.period
        return np.asarray(self.most * (1 - np.cos(turn)) / 2)


@dataclass(frozen=True, kw_only=True)
class End:
    """One tube of the end-effector: its shape and voxel map, its line, and which angle of it counts."""

    shape: Shape
    pattern: Pattern
    line: Line
    what: str = option(choices=("bending", "twist"))


@dataclass(frozen=True, eq=False)
class Answer:
    """What one tube does over n frames: pressure_pa, angle_rad (n,), its length_m (n,), and its solved curve."""

    end: End
    pressure_pa: Array
    angle_rad: Array
    length_m: Array
    curve: Response


def answer(end: End, time_s: Array, progress: Callable[[float], None] | None = None) -> Answer:
    """Return a tube's angle at its line's pressures at times (n,) [s], quasi-static.

    Equilibria up to the largest pressure, a spline between them. Raises as `respond`, and BadInput for a line
    without pressure.
    """
    pressure = end.line.at(time_s)
    most = float(pressure.max())
    if not most > 0:
        raise BadInput("end-effector", f"its line gives {most:g} Pa within the walk", "begin earlier, or walk longer")
    curve = respond(build(end.shape, end.pattern, Path()), 0.0, most, FINENESS, progress)
    length = end.shape.length + curve.at(pressure, "extension")
    return Answer(end, pressure, curve.at(pressure, end.what), np.asarray(length), curve)
