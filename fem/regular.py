"""What is believed of a map before any observation: neighbours mostly alike, edges allowed.

Total variation of the logarithms of the moduli, rounded where differences are small; its quadratic
majorant (lagged diffusivity: Vogel and Oman, SIAM J. Sci. Comput. 17, 1996) goes into a least-squares step.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from data.signal import Array


@dataclass(frozen=True, eq=False)
class Variation:
    """Sum of sqrt(d^2 + edge^2) - edge over neighbours' differences d = pairs . log moduli; pairs (p, v) sparse."""

    pairs: Any
    edge: float

    def value(self, log: Array) -> float:
        """Return the variation of log moduli (v,)."""
        return float((np.hypot(self.pairs @ log, self.edge) - self.edge).sum())

    def curvature(self, log: Array) -> Array:
        """Return the matrix (v, v) of the quadratic that touches it at log moduli (v,) from above."""
        weight = 1 / np.hypot(self.pairs @ log, self.edge)
        return np.asarray((self.pairs.T @ self.pairs.multiply(weight[:, None]).tocsr()).toarray())


def neighbours(shape: tuple[int, ...], wraps: tuple[bool, ...]) -> Any:
    """Return the differences of neighbours on a grid of voxels (p, v), sparse; wraps: which axes close on themselves.

    A tube's voxels wrap around its first axis.
    """
    number = np.arange(int(np.prod(shape))).reshape(shape)
    found = []
    for axis, wrap in enumerate(wraps):
        if shape[axis] < 2:
            continue
        after = np.roll(number, -1, axis=axis)
        inside = slice(None) if wrap and shape[axis] > 2 else slice(0, -1)
        cut = tuple(inside if a == axis else slice(None) for a in range(len(shape)))
        found.append(np.stack([number[cut].ravel(), after[cut].ravel()], axis=1))
    return differences(np.vstack(found), number.size)


def differences(pairs: Array, count: int) -> Any:
    """Return second less first of pairs of voxels (p, 2), as a sparse (p, count)."""
    from scipy.sparse import csr_array

    rows = np.repeat(np.arange(len(pairs)), 2)
    return csr_array((np.tile([-1.0, 1.0], len(pairs)), (rows, pairs.ravel())), shape=(len(pairs), count))


def boxed(curvature: Array, slope: Array, low: Array, high: Array) -> Array:
    """Return x (v,) in a box with the least slope . x + x . curvature x / 2, curvature positive definite.

    Sides change together (block pivoting, as fem.gap); the end is clipped to the box.
    """
    side = np.zeros(len(slope), dtype=int)
    x, tiny = np.zeros(len(slope)), 1e-12 * float(np.abs(slope).max())
    for _ in range(30):
        free = side == 0
        x = np.where(side < 0, low, np.where(side > 0, high, 0.0))
        if free.all():
            x = cho_solve(cho_factor(curvature), -slope)
        elif free.any():
            x[free] = cho_solve(cho_factor(curvature[np.ix_(free, free)]), -(slope + curvature @ x)[free])
        rise = curvature @ x + slope
        wrong = np.where(free, (x > high) * 1 - (x < low), 0)
        back = ((side < 0) & (rise < -tiny)) | ((side > 0) & (rise > tiny))
        broken = (wrong != 0) | back
        if not broken.any():
            break
        side[broken] = wrong[broken]
    return np.asarray(np.clip(x, low, high))
