"""Linear least squares with some weights free and the others not negative."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput

Array = NDArray[np.float64]

BLOCK_ROWS = 1 << 15
RANK_TOLERANCE = 1e-11


@dataclass(frozen=True)
class Solution:
    """Weights (k,) in the order of the columns, ||X w - y||, and the scaled columns' condition number."""

    weights: Array
    residual_norm: float
    condition: float


def triangle(columns: Array, target: Array, block_rows: int = BLOCK_ROWS, scale: Array | None = None) -> Array:
    """Return the (k+1, k+1) triangle R of [X / scale, y]: ||X w - y|| = ||R [scale w, -1]|| for every w.

    Tall-skinny QR, `block_rows` rows at a time, so memory beyond the input stays bounded. Every
    least-squares question about the n rows has the same answer on these k+1.
    """
    size = columns.shape[1] + 1
    kept = np.zeros((0, size))
    for first in range(0, len(columns), block_rows):
        part = slice(first, first + block_rows)
        block = np.column_stack([columns[part] if scale is None else columns[part] / scale, target[part]])
        kept = np.asarray(np.linalg.qr(np.vstack([kept, block]), mode="r"))
    return np.vstack([kept, np.zeros((size - len(kept), size))])


def solve(columns: Array, target: Array, free: int) -> Solution:
    """Minimise ||X w - y|| with the first `free` weights of any sign and the others w >= 0.

    columns: X (n, k); target: y (n,). Columns are scaled to length 1, reduced by QR (never by the
    Gram matrix, which squares the condition number), the free ones projected out, the rest given
    to scipy's Lawson-Hanson active-set method. Collinear free columns get the shortest of the
    weights that fit equally well. Thesis eq. 3.30. Raises BadInput for NaN or missing rows.
    """
    if columns.ndim != 2 or target.shape != columns.shape[:1] or not 0 <= free <= columns.shape[1]:
        raise BadInput("least squares", f"X {columns.shape}, y {target.shape}, {free} free", "expected (n, k), (n,)")
    if not len(target):
        raise BadInput("least squares", "has no samples", "at least one is needed")
    largest = np.maximum(columns.max(axis=0, initial=0.0), -columns.min(axis=0, initial=0.0))
    if not (np.isfinite(largest).all() and np.isfinite(target).all()):
        raise BadInput("least squares", "X or y is not finite", "drop or repair those samples first")
    largest[largest == 0] = 1.0
    reduced = triangle(columns, target, scale=largest)
    return _solve_reduced(reduced, largest, free)


def _solve_reduced(reduced: Array, largest: Array, free: int) -> Solution:
    length = np.linalg.norm(reduced[:, :-1], axis=0)
    length[length == 0] = 1.0
    matrix, target = reduced[:, :-1] / length, reduced[:, -1]
    left, singular, right = np.linalg.svd(matrix[:, :free], full_matrices=False)
    sound = singular > RANK_TOLERANCE * singular.max(initial=0.0)
    left, singular, right = left[:, sound], singular[sound], right[sound]
    positive = np.zeros(matrix.shape[1] - free)
    if len(positive):
        from scipy.optimize import nnls

        rest = matrix[:, free:] - left @ (left.T @ matrix[:, free:])
        # A column that the free ones do already is nothing but rounding here, and gets no weight.
        rest[:, np.linalg.norm(rest, axis=0) < RANK_TOLERANCE] = 0.0
        positive = nnls(rest, target - left @ (left.T @ target), maxiter=100 * len(positive))[0]
    signed = right.T @ (left.T @ (target - matrix[:, free:] @ positive) / singular)
    weights = np.concatenate([signed, positive])
    residual = float(np.linalg.norm(matrix @ weights - target))
    scaled = np.linalg.svd(matrix, compute_uv=False)
    condition = float(scaled[0] / scaled[-1]) if len(scaled) and scaled[-1] > 0 else float("inf")
    return Solution(weights / length / largest, residual, condition)
