"""Frames along a curve: Frenet-Serret, which is not always there, and two ways of minimising rotation.

A frame is T along the curve, N1 and N2 = T x N1 across it.
"""

from dataclasses import dataclass

import numpy as np

from catheter.curve import Curve
from data.errors import BadInput
from data.signal import Array

STRAIGHT = 1e-9  # curvature times length of the curve, below which no normal can be told from rounding
STEPS = 1024  # of a curve at least, whatever the stations: error about 1e-11 rad on a spiral of 3 turns


@dataclass(frozen=True, eq=False)
class Frames:
    """T, N1 and N2 at stations, (n, 3) each."""

    tangent: Array
    normal: Array

    @property
    def binormal(self) -> Array:
        """N2 (n, 3)."""
        return np.cross(self.tangent, self.normal)


def frenet(curve: Curve, w: Array) -> Frames:
    """Return Frenet-Serret frames (thesis eq. 4.8 to 4.10) at ascending w (n,) [m]: N1 = N, N2 = B.

    Raises BadInput naming w where the curve is straight or has an inflection: there is none.
    """
    _, d1, d2 = curve(w, 2)
    across = np.cross(d1, d2)
    speed, size = np.linalg.norm(d1, axis=-1), np.linalg.norm(across, axis=-1)
    curvature = size / speed**3
    span = max(float(np.ptp(w)), 1e-300)
    straight = curvature * span <= STRAIGHT
    if straight.any():
        at = float(w[np.argmax(straight)])
        raise BadInput("Frenet frame", f"is undefined at w = {1e3 * at:.6g} mm: the curve does not bend there", _REMEDY)
    tangent, binormal = d1 / speed[:, None], across / size[:, None]
    flips = (binormal[1:] * binormal[:-1]).sum(axis=-1) < 0
    if flips.any():
        k = int(np.argmax(flips))
        found = f"flips between w = {1e3 * w[k]:.6g} and {1e3 * w[k + 1]:.6g} mm: an inflection"
        raise BadInput("Frenet frame", found, _REMEDY)
    return Frames(tangent, np.cross(binormal, tangent))


_REMEDY = "use double reflection or parallel transport"


def parallel_transport(curve: Curve, w: Array, seed: Array) -> Frames:
    """Return frames at ascending w (n,), each turned by the angle between two tangents (thesis Algorithm 1).

    seed (3,) is N1 at the first. Second order in the step: the rotation about T between two
    stations is not seen.
    """
    tangent = _tangents(curve(w, 1)[1])
    here, there = tangent[:-1], tangent[1:]
    local = _across(tangent)
    axis = np.cross(here, there)
    cosine = (here * there).sum(axis=-1)[:, None]
    moved = local[:-1]
    # Rodrigues's rotation by the angle between the tangents about their cross product, without its arccos
    turned = cosine * moved + np.cross(axis, moved) + axis * (axis * moved).sum(axis=-1)[:, None] / (1 + cosine)
    return _followed(tangent, local, turned, seed)


def double_reflection(curve: Curve, w: Array, seed: Array) -> Frames:
    """Return frames at ascending w (n,) by two reflections a step (Wang et al. 2008), of fourth order.

    seed (3,) is N1 at the first.
    """
    points, slopes = curve(w, 1)
    tangent = _tangents(slopes)
    local = _across(tangent)
    chord = np.diff(points, axis=0)
    size = np.linalg.norm(chord, axis=-1)[:, None]
    # between stations a rounding apart the chord has no direction, and the tangents have the same
    chord = np.where(size > 1e-6 * size.max(initial=0.0), chord, tangent[1:] + tangent[:-1])
    moved, along = _reflected(local[:-1], chord), _reflected(tangent[:-1], chord)
    return _followed(tangent, local, _reflected(moved, tangent[1:] - along), seed)


def rotation_minimising(curve: Curve, w: Array, seed: Array | None = None) -> Frames:
    """Return double-reflection frames at ascending w >= 0 (n,) [m], from w = 0 in steps fine enough for both.

    seed (3,): N1 at w = 0 before it is made square to T; by default the axis least along T, x
    rather than y rather than z.
    """
    fine = np.union1d(np.linspace(0.0, max(float(w[-1]), 1e-300), STEPS + 1), w)
    start = _tangents(curve(fine[:1], 1)[1])[0]
    first = perpendicular(start) if seed is None else seed - (seed @ start) * start
    found = double_reflection(curve, fine, first / np.linalg.norm(first))
    at = np.searchsorted(fine, w)
    return Frames(found.tangent[at], found.normal[at])


def perpendicular(tangent: Array) -> Array:
    """Return a unit vector (3,) square to a unit vector: the axis least along it, projected."""
    axis = np.eye(3)[np.argmin(np.abs(tangent))]
    across = axis - (axis @ tangent) * tangent
    return np.asarray(across / np.linalg.norm(across))


def total_twist(frames: Frames) -> float:
    """Return the angle [rad] from the first N1, carried to the last tangent at once, to the last N1.

    Of a closed curve it is the angle by which the frames fail to close.
    """
    here, there = frames.tangent[0], frames.tangent[-1]
    axis, cosine, n1 = np.cross(here, there), here @ there, frames.normal[0]
    carried = cosine * n1 + np.cross(axis, n1) + axis * (axis @ n1) / (1 + cosine)
    last = frames.normal[-1]
    return float(np.arctan2(np.cross(carried, last) @ there, carried @ last))


def _tangents(slopes: Array) -> Array:
    return np.asarray(slopes / np.linalg.norm(slopes, axis=-1)[:, None])


def _across(tangent: Array) -> Array:
    """Return any unit vector square to each tangent."""
    axis = np.eye(3)[np.argmin(np.abs(tangent), axis=-1)]
    across = np.cross(tangent, axis)
    return np.asarray(across / np.linalg.norm(across, axis=-1)[:, None])


def _reflected(vectors: Array, across: Array) -> Array:
    """Return vectors mirrored in the planes square to `across`; where it vanishes they stay."""
    square = (across**2).sum(axis=-1)
    share = 2 * (across * vectors).sum(axis=-1) / np.where(square > 0, square, 1.0)
    return np.asarray(vectors - share[:, None] * across)


def _followed(tangent: Array, local: Array, turned: Array, seed: Array) -> Frames:
    """Return the frames that a step's rotation makes of a seed.

    turned (n - 1, 3) are the first n - 1 `local` normals after their step. A rotation that takes
    one tangent to the next keeps every angle about it, so the angles of the steps add up: no loop.
    """
    other = np.cross(tangent, local)
    steps = np.arctan2((turned * other[1:]).sum(axis=-1), (turned * local[1:]).sum(axis=-1))
    start = np.arctan2(seed @ other[0], seed @ local[0])
    angle = (start + np.append(0.0, np.cumsum(steps)))[:, None]
    return Frames(tangent, np.cos(angle) * local + np.sin(angle) * other)
