"""Planes and pictures: the homography between a marker's plane and the picture, and what it says.

Picture coordinates are pixels: x to the right, y down, the middle of the first pixel at (0, 0).
Angles count counter-clockwise as one sees the picture, which is positive about an axis that
points at the camera.
"""

from collections.abc import Sequence

import numpy as np

from data.signal import Array


def rotation(angle_rad: float) -> Array:
    """Return the (2, 2) matrix that turns picture coordinates counter-clockwise as seen (y is down)."""
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cosine, sine], [-sine, cosine]])


def picture_from_plane(
    *,
    angle_rad: float,
    tilt_rad: float,
    tilt_axis_rad: float,
    origin: Array,
    origin_px: Array,
    pitch_px: float,
    focal_px: float,
    principal_px: Array,
) -> Array:
    """Return the homography (3, 3) of a pinhole camera looking at a plane.

    The plane is turned by angle_rad about its normal, then tilted by tilt_rad about the axis that
    lies in the picture's plane at tilt_axis_rad. Its point `origin` (2,) is seen at origin_px,
    where one plane unit facing the camera would be pitch_px long. x ~ K [R | t].
    """
    across = rotation(tilt_axis_rad) @ np.array([0.0, 1.0])  # in the picture, square to the axis
    turned = rotation(angle_rad)
    flat = (np.eye(2) - (1 - np.cos(tilt_rad)) * np.outer(across, across)) @ turned
    depth = np.sin(tilt_rad) * across @ turned * pitch_px / focal_px
    offset = origin_px - principal_px
    centred = np.zeros((3, 3))
    centred[:2, :2] = pitch_px * flat
    centred[2, :2] = depth
    centred[:2, 2], centred[2, 2] = offset, 1.0
    centred[:, 2] -= centred[:, :2] @ origin
    shift = np.eye(3)
    shift[:2, 2] = principal_px
    found = shift @ centred
    return np.asarray(found / found[2, 2])


def to_picture(homography: Array, points: Array) -> Array:
    """Return where points of a plane, (n, 2), are seen: (n, 2) pixels."""
    seen = points @ homography[:, :2].T + homography[:, 2]
    return np.asarray(seen[:, :2] / seen[:, 2:])


def plane_angle_rad(homography: Array, principal_px: Sequence[float] | Array) -> float:
    """Return the angle of a plane's x axis in the plane itself, with its tilt undone.

    With the principal point as the origin the upper left block is (focal length / depth) S R: S
    symmetric from the tilt, R the turn. R is that block's polar factor, whatever the focal length.
    """
    block = homography[:2, :2] - np.outer(principal_px, homography[2, :2])
    return float(np.arctan2(block[0, 1] - block[1, 0], block[0, 0] + block[1, 1]))


def angle_slope(homography: Array, principal_px: Sequence[float] | Array) -> Array:
    """Return the derivative of `plane_angle_rad` by the homography's entries, (3, 3), in radians."""
    block = homography[:2, :2] - np.outer(principal_px, homography[2, :2])
    rise, run = block[0, 1] - block[1, 0], block[0, 0] + block[1, 1]
    by_block = np.array([[-rise, run], [-run, -rise]]) / (rise**2 + run**2)
    slope = np.zeros((3, 3))
    slope[:2, :2] = by_block
    slope[2, :2] = -np.asarray(principal_px) @ by_block
    return slope


def affine(points: Array, points_px: Array) -> Array:
    """Return the affine map, as a homography (3, 3), that takes three points to three pixels."""
    known = np.column_stack([points, np.ones(3)])
    found = np.eye(3)
    found[:2] = np.linalg.solve(known, points_px).T
    return found
