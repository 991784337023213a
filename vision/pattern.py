"""What a marker is: three square blobs at the corners of a right isosceles triangle, in its own plane.

The plane's unit is the pitch, the distance from the corner blob to either other one. The corner
blob stands at (0, 0), the second at (1, 0), the third at (0, 1); at angle 0 the second is to the
right of the corner in a picture and the third below it, as the finder patterns of a QR code.
"""

from dataclasses import dataclass

import numpy as np

from data.errors import BadInput
from data.options import option
from data.signal import Array

BLOBS: Array = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])  # corner, second, third
MIDDLE: Array = np.array([0.5, 0.5])  # the card's middle, where a marker is glued to the axis

# Squares that make a blob: half its side over the blob's, and how much ink it adds.
RINGS: dict[str, Array] = {
    "squares": np.array([[1.0, 1.0]]),
    "qr": np.array([[1.0, 1.0], [5 / 7, -1.0], [3 / 7, 1.0]]),
}


@dataclass(frozen=True, kw_only=True)
class Marker:
    """A marker's design.

    pattern: "squares" (full squares) or "qr" (the finder patterns of a QR code, nested squares).
    least_size, most_size: the blob's side over the pitch; what lies outside is another object.
    A QR code of n modules has 7 / (n - 7): 0.5 for the smallest, 0.1 for one of 77.
    light: light blobs on a dark card.
    """

    pattern: str = option("squares", choices=("squares", "qr"))
    least_size: float = option(0.36, least=0.03, most=0.9)
    most_size: float = option(0.44, least=0.03, most=0.9)
    light: bool = False

    def __post_init__(self) -> None:
        """Refuse a design that nothing could match."""
        if self.pattern not in RINGS:
            raise BadInput("marker, pattern", f"is {self.pattern!r}", f"known: {', '.join(RINGS)}")
        if not 0 < self.least_size <= self.most_size < 1:
            raise BadInput("marker, size", f"{self.least_size} to {self.most_size}", "expected 0 < least <= most < 1")

    @property
    def size(self) -> float:
        """The middle of the sizes that are accepted."""
        return (self.least_size + self.most_size) / 2

    @property
    def rings(self) -> Array:
        """The squares of a blob, (k, 2): half side over the blob's half side, and ink."""
        return RINGS[self.pattern]


SQUARES = Marker()
QR = Marker(pattern="qr", least_size=0.06, most_size=0.53)


def square(middle: Array, side: float) -> Array:
    """Return the corners of a square, (4, 2), in the order of growing angle from x to y."""
    return np.asarray(middle + side / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]))


def shapes(marker: Marker, size: float) -> list[tuple[Array, float]]:
    """Return a marker's polygons in its plane and the ink each adds: (n, 2) corners, weight."""
    return [(square(blob, size * share), ink) for blob in BLOBS for share, ink in marker.rings]


def cut(polygon: Array, direction: Array, share: float) -> Array:
    """Return a convex polygon without the share of its area that lies farthest along a direction.

    polygon: (n, 2); direction: (2,). The cut is straight, its place found to 1e-12 by bisection.
    """
    along = polygon @ direction
    low, high, whole = float(along.min()), float(along.max()), area(polygon)
    for _ in range(60):
        border = (low + high) / 2
        if area(_below(polygon, along - border)) < (1 - share) * whole:
            low = border
        else:
            high = border
    return _below(polygon, along - high)


def area(polygon: Array) -> float:
    """Return a polygon's area, positive for corners in the order of growing angle from x to y."""
    x, y = polygon.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


def _below(polygon: Array, height: Array) -> Array:
    kept: list[Array] = []
    for i in range(len(polygon)):
        j = (i + 1) % len(polygon)
        if height[i] <= 0:
            kept.append(polygon[i])
        if (height[i] < 0) != (height[j] < 0) and height[i] != height[j]:
            kept.append(polygon[i] + (polygon[j] - polygon[i]) * height[i] / (height[i] - height[j]))
    return np.array(kept).reshape(-1, 2)
