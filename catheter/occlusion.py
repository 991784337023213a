"""What an actuator fills of its vessel, and where it touches the wall, plane by plane along the vessel."""

from dataclasses import dataclass

import numpy as np

from catheter.centreline import Vessel
from catheter.curve import Along
from catheter.frames import rotation_minimising
from catheter.shape import Shape
from data.signal import Array

TOUCH = 0.03  # of the vessel's radius: as near as this the wall counts as touched
SECTORS = 360


@dataclass(frozen=True, eq=False)
class Occlusion:
    """Planes square to the vessel at w (n,) that cross the actuator.

    share (n,): of the vessel's cross-section, inside the actuator's outer wall. contact (n,): the
    arc of the vessel's circumference [rad] that the outer wall reaches. beyond (n,): how far the
    actuator's wall passes the vessel's [m], negative where it stays inside.
    """

    w: Array
    share: Array
    contact: Array
    beyond: Array


def occlusion(shape: Shape, vessel: Vessel, q: float, *, planes: int = 60, around: int = 240) -> Occlusion:
    """Return what the actuator fills and touches at q. Planes that miss its ends are left out."""
    stations = np.linspace(0, shape.length, 401)
    angle = 2 * np.pi * np.arange(around) / around
    outer = shape.wall(q, np.array([shape.outer]), angle, stations).positions[:, :, 0]
    at = np.linspace(0, vessel.length, planes + 2)[1:-1]
    along = Along(vessel.centre(at, 2), rotation_minimising(vessel.centre, at).normal)
    found = []
    for k, w in enumerate(at):
        origin, axes = along.curve[0, k], (along.normal[0, k], along.binormal[0, k], along.tangent[0, k])
        section = _section((outer - origin) @ np.stack(axes, axis=1))
        if section is not None:
            found.append((w, *_measured(section, float(vessel.radius(at[k : k + 1], 0)[0, 0]))))
    return Occlusion(*(np.array(column) for column in zip(*found, strict=True))) if found else _nothing()


def _nothing() -> Occlusion:
    empty = np.empty(0)
    return Occlusion(empty, empty, empty, empty)


def _section(local: Array) -> Array | None:
    """Return the outline (around, 2) in the plane z = 0 of lines (around, stations, 3), None where one misses it."""
    height = local[..., 2]
    crosses = (height[:, :-1] < 0) & (height[:, 1:] >= 0)
    # a line may cross the plane of a curved vessel far away too: the crossing nearest to the axis counts
    far = np.where(crosses, np.hypot(local[:, :-1, 0], local[:, :-1, 1]), np.inf)
    first = np.argmin(far, axis=1)
    rows = np.arange(len(local))
    if not crosses[rows, first].all():
        return None
    before, after = local[rows, first], local[rows, first + 1]
    share = (before[:, 2] / (before[:, 2] - after[:, 2]))[:, None]
    return np.asarray((before + share * (after - before))[:, :2])


def _measured(section: Array, radius: float) -> tuple[float, float, float]:
    x, y = section.T
    area = abs(float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())) / 2
    steps = np.linspace(0, 1, 8, endpoint=False)[:, None, None]
    dense = (section + steps * (np.roll(section, -1, axis=0) - section)).reshape(-1, 2)
    reach = np.hypot(*dense.T)
    near = dense[reach >= (1 - TOUCH) * radius]
    sectors = np.unique(np.floor(np.arctan2(near[:, 1], near[:, 0]) / (2 * np.pi) * SECTORS) % SECTORS)
    return area / (np.pi * radius**2), len(sectors) * 2 * np.pi / SECTORS, float(reach.max()) - radius
