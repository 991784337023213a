"""The posture of the robot in a straight cannula: centre lines and radii of its parts at one instant, x forward."""

from dataclasses import dataclass

import numpy as np

from catheter.free import Array, inflate
from catheter.helix import HelixState
from catheter.robot import Segment, outer_radius
from catheter.task import Task

VALVE_M = 10e-3  # drawn length of a valve; the thesis prints none


@dataclass(frozen=True, eq=False)
class Spiral:
    """A spiral from x = 0: line (n, 3), and the third fibre on the inside of its bend (n, 3); its reach on x [m].

    outer_m: of its wall. free_m: the helix radius that the fibres ask for; drawn_m: what the cannula leaves of it.
    """

    line: Array
    limiter: Array
    reach_m: float
    outer_m: float
    free_m: float
    drawn_m: float


def spiral(task: Task, segment: Segment, volume_ratio: float, points: int = 241) -> Spiral:
    """Return a spiral in the task's cannula at a volume ratio.

    Length along x, turns and the radius of the free helix are the fibres' (thesis eq. 3.11 to 3.17). There is
    no model of contact: where the free helix is wider than the cannula leaves room for, its radius is cut to
    that room, x and turns kept; at both ends it is led to the axis within one diameter of the cannula. Both
    are conventions of drawing. At rest, and where nothing bends it, the tube is straight.
    """
    assert segment.gamma is not None
    pair = inflate(segment.alpha, segment.beta, volume_ratio)
    helix = task.helix(pair, np.asarray(segment.gamma))
    outer = float(outer_radius(task, pair))
    share = np.linspace(0.0, 1.0, points)
    bends = helix.state == HelixState.VALID
    reach = float((helix.length_ratio if bends else pair.axial) * segment.length)
    free = float(helix.radius_m) if bends else 0.0
    drawn = min(free, max(task.diameter / 2 - outer, 0.0))
    at_rest = np.tan(segment.gamma) * segment.length / task.radius  # how far the third fibre winds round the tube
    turn = share * (2 * np.pi * float(helix.turns) * np.sign(float(helix.torsion)) if bends else at_rest)
    ends = np.clip(np.minimum(share, 1 - share) * reach / task.diameter, 0, 1)
    radius = drawn * ends**2 * (3 - 2 * ends)
    out = np.stack([0 * turn, np.cos(turn), np.sin(turn)], axis=-1)
    line = np.stack([reach * share, 0 * share, 0 * share], axis=-1) + radius[:, None] * out
    return Spiral(line, line - outer * out, reach, outer, free, drawn)


def arc(length: float, angle: float, points: int = 33) -> Array:
    """Return the centre line (n, 3) of a tube bent by `angle` [rad] in one arc towards +y, from x = 0."""
    share = np.linspace(0.0, 1.0, points)
    if abs(angle) < 1e-9:
        return np.stack([length * share, 0 * share, 0 * share], axis=-1)
    radius = length / angle
    return np.stack([radius * np.sin(angle * share), radius * (1 - np.cos(angle * share)), 0 * share], axis=-1)


def swept(line: Array, radius: float, sides: int = 14, turn: Array | float = 0.0) -> Array:
    """Return the surface (sides + 1, n, 3) of a tube about a centre line (n, 3), the first side again last.

    turn (n,) [rad]: how far each ring is turned about the line. Each ring's zero is its neighbour's,
    projected: no twist beyond second order in the step; the first is the y axis.
    """
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    normal = np.empty_like(line)
    normal[0] = np.array([0.0, 1.0, 0.0]) - tangent[0, 1] * tangent[0]
    normal[0] /= np.linalg.norm(normal[0])
    for k in range(1, len(line)):
        moved = normal[k - 1] - (normal[k - 1] @ tangent[k]) * tangent[k]
        normal[k] = moved / np.linalg.norm(moved)
    angle = np.linspace(0, 2 * np.pi, sides + 1)[:, None] + turn
    binormal = np.cross(tangent, normal)
    return np.asarray(line + radius * (np.cos(angle)[..., None] * normal + np.sin(angle)[..., None] * binormal))
