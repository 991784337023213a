"""Which voxels of a tube a closed surface holds, found from its triangles alone."""

import numpy as np
from numpy.typing import NDArray

from data.signal import Array
from fem.voxel_map import VoxelMap

PLACE = (0.63, 0.56)  # of a voxel, around and along: off its middle, where the faces' diagonals cross


def voxels_inside(corners: Array, made: VoxelMap) -> NDArray[np.bool_]:
    """Return which voxels (around, along) have a place near their middle inside closed triangles (n, 3, 3) [m].

    A ray from each place outwards, square to the axis: inside when it leaves the surface once more
    than it enters. Triangles are tried on the rays that their box, unrolled, may meet.
    """
    sizes, (around, along) = made.sizes, made.voxels.shape
    turn = np.arctan2(corners[..., 1], corners[..., 0]) / (2 * np.pi) * around
    turn = turn[:, :1] + (turn - turn[:, :1] + around / 2) % around - around / 2  # across the seam
    rise = corners[..., 2] / sizes.length * along
    i_low, i_count = _places(turn, PLACE[0])
    j_low, j_count = _places(rise, PLACE[1])
    which = np.repeat(np.arange(len(corners)), i_count * j_count)
    rank = np.arange(len(which)) - np.repeat(np.cumsum(i_count * j_count) - i_count * j_count, i_count * j_count)
    i, j = i_low[which] + rank // j_count[which], j_low[which] + rank % j_count[which]
    there = (j >= 0) & (j < along)
    which, i, j = which[there], i[there] % around, j[there]
    angle, height = 2 * np.pi * (i + PLACE[0]) / around, sizes.length * (j + PLACE[1]) / along
    way = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    middle = (sizes.outer_radius - sizes.wall / 2) * np.cos(np.pi / around)  # of the flat wall
    origin = middle * way
    origin[:, 2] = height
    crossings = np.zeros((around, along))
    np.add.at(crossings, (i, j), _crossed(corners[which], origin, way))
    return np.asarray(crossings > 0.5)


def _places(spans: Array, place: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first k and the number of k with k + place within each triangle's span (n, 3)."""
    low = np.ceil(spans.min(axis=1) - place - 1e-9).astype(np.int64)
    high = np.floor(spans.max(axis=1) - place + 1e-9).astype(np.int64)
    return low, np.maximum(high - low + 1, 0)


def _crossed(corners: Array, origin: Array, way: Array) -> Array:
    """Return +1 where a ray leaves through a triangle (from its inner side), -1 where it enters, else 0."""
    a, b, c = np.moveaxis(corners - origin[:, None], 1, 0)
    # signed volumes of the ray with each edge: all of one sign where it passes inside
    parts = np.stack([(way * np.cross(x, y)).sum(axis=1) for x, y in ((a, b), (b, c), (c, a))])
    normal = np.cross(b - a, c - a)
    facing = (normal * way).sum(axis=1)
    ahead = (normal * a).sum(axis=1) * facing > 0
    inside = (parts > 0).all(axis=0) | (parts < 0).all(axis=0)
    return np.where(ahead & inside, np.sign(facing), 0.0)
