"""Grey-weighted centroids: every pixel counts by how much ink it holds, so that edges are not rounded."""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from data.signal import Array

LEAST = 0.15  # of the contrast: below it a pixel is paper and its noise does not count


@njit(cache=True, error_model="numpy")
def centroid(  # noqa: PLR0917, compiled functions take arrays, not objects
    picture: NDArray[Any], x: float, y: float, radius: float, outside: float, inside: float
) -> tuple[float, float, float]:
    """Return a blob's centroid x, y [px] and its ink [px^2] within a circle; NaN when it holds none.

    A pixel weighs (outside - grey) / (outside - inside), cut to 0 to 1: grey levels of paper and
    blob, in either order. Accurate where the circle holds the whole blob and nothing else.
    """
    height, width = picture.shape
    total = sum_x = sum_y = 0.0
    scale = 1.0 / (outside - inside)
    for row in range(max(0, int(np.ceil(y - radius))), min(height - 1, int(np.floor(y + radius))) + 1):
        half = np.sqrt(max(0.0, radius * radius - (row - y) ** 2))
        for column in range(max(0, int(np.ceil(x - half))), min(width - 1, int(np.floor(x + half))) + 1):
            weight = min(1.0, (outside - picture[row, column]) * scale)
            if weight > LEAST:
                total += weight
                sum_x += weight * column
                sum_y += weight * row
    if total <= 0:
        return np.nan, np.nan, 0.0
    return sum_x / total, sum_y / total, total


def centroids(picture: NDArray[Any], places_px: Array, radius_px: float, levels: Array) -> Array:
    """Return the grey-weighted centroids near several places, (n, 2); levels (n, 2): outside, inside."""
    found = [
        centroid(picture, float(x), float(y), radius_px, float(paper), float(ink))[:2]
        for (x, y), (paper, ink) in zip(places_px, levels, strict=True)
    ]
    return np.array(found)
