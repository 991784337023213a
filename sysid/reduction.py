"""Any number of rows, once: small triangles that answer every least-squares question about them."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput

Array = NDArray[np.float64]

BLOCK_ROWS = 1 << 13  # and this many are copied at a time
UNIT_ROWS = 512  # rows that are reduced at a time: they fit the processor's cache
MOST_UNITS = 2048  # beyond it neighbours are merged, so that memory stays bounded


@dataclass(frozen=True, eq=False)
class Reduction:
    """Triangles of [1, X, y] over consecutive units of rows, in order of time.

    triangles (u, k+2, k+2): ||w0 + X w - y|| over unit i is ||triangles[i] @ [w0, w, -1]||.
    rows (u,): how many rows each stands for. terms: the k names of X's columns.
    """

    terms: tuple[str, ...]
    triangles: Array
    rows: NDArray[np.int64]

    def __len__(self) -> int:
        return int(self.rows.sum())

    @cached_property
    def total(self) -> Array:
        """The triangle of all rows, (k+2, k+2)."""
        return _triangle(self.triangles)

    @property
    def response_deviation(self) -> float:
        """The root mean square of y - mean(y)."""
        return float(np.linalg.norm(self.total[1:, -1]) / np.sqrt(len(self)))

    @property
    def condition(self) -> float:
        """Largest over smallest singular value of [1, X] with columns of length 1; inf if collinear."""
        columns = self.total[:, :-1]
        singular = np.linalg.svd(columns / _lengths(columns), compute_uv=False)
        return float(singular[0] / singular[-1]) if singular[-1] > 0 else float("inf")

    def part(self, units: NDArray[np.bool_]) -> "Reduction":
        """Return the reduction of some of the units, chosen by a mask (u,)."""
        return Reduction(self.terms, self.triangles[units], self.rows[units])

    def rmse(self, constant: float, weights: Array) -> float:
        """Return the root mean square of w0 + X w - y over all rows."""
        return float(np.linalg.norm(self.total @ np.concatenate([[constant], weights, [-1.0]])) / np.sqrt(len(self)))


def reduce_rows(terms: tuple[str, ...], columns: Array, response: Array, unit_rows: int | None = None) -> Reduction:
    """Reduce X (n, k) and y (n,); the constant column is added. unit_rows None: at most 512, a 256th of n.

    Raises BadInput for shapes that do not fit, NaN, or not more rows than columns.
    """
    rows = unit_rows or int(np.clip(len(columns) // 256, len(terms) + 3, UNIT_ROWS))
    return reduce_blocks(terms, [(columns, response)], rows)


def reduce_blocks(
    terms: tuple[str, ...], blocks: Iterable[tuple[Array, Array]], unit_rows: int = UNIT_ROWS
) -> Reduction:
    """Reduce rows as they come, block by block (X, y): memory is bounded whatever their number.

    Householder QR of each unit; columns of any scale lose no digit by it. Raises as `reduce_rows`.
    """
    found: list[Array] = []
    counts: list[NDArray[np.int64]] = []
    for block in _units(terms, blocks, unit_rows):
        found.append(_padded(_qr(block)))
        counts.append(np.full(len(block), block.shape[1]))
        while sum(map(len, found)) > 2 * MOST_UNITS:
            triangles, rows = _merged(np.concatenate(found), np.concatenate(counts))
            found, counts = [triangles], [rows]
    if sum(int(c.sum()) for c in counts) <= len(terms) + 1:
        rows_found = sum(int(c.sum()) for c in counts)
        raise BadInput("regression", f"{rows_found} samples for {len(terms) + 1} weights", "record more samples")
    return Reduction(terms, np.concatenate(found), np.concatenate(counts))


def _units(terms: tuple[str, ...], blocks: Iterable[tuple[Array, Array]], unit_rows: int) -> Iterator[Array]:
    """Yield (units, rows, k+2) arrays of [1, X, y]; the last may hold one shorter unit."""
    left = np.empty((0, len(terms) + 2))
    for columns, response in blocks:
        if columns.ndim != 2 or columns.shape != (len(response), len(terms)):
            raise BadInput("regression", f"X {columns.shape}, y {response.shape}", f"expected (n, {len(terms)}), (n,)")
        for first in range(0, max(1, len(columns)), BLOCK_ROWS):
            part = slice(first, first + BLOCK_ROWS)
            rows = np.empty((len(left) + len(response[part]), len(terms) + 2))
            rows[: len(left)] = left
            rows[len(left) :, 0], rows[len(left) :, 1:-1], rows[len(left) :, -1] = 1, columns[part], response[part]
            if not np.isfinite(rows.sum()) and not np.isfinite(rows).all():
                raise BadInput("regression", "X or y is not finite", "drop or repair those samples first")
            whole = len(rows) // unit_rows
            if whole:
                yield rows[: whole * unit_rows].reshape(whole, unit_rows, -1)
            left = rows[whole * unit_rows :]
    if len(left):
        yield left[None]


def _merged(triangles: Array, rows: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    """Return every two neighbours as one."""
    pairs, size = len(triangles) // 2, triangles.shape[-1]
    joined = _padded(_qr(triangles[: 2 * pairs].reshape(pairs, 2 * size, size)))
    odd = slice(2 * pairs, None)
    sums = rows[: 2 * pairs].reshape(pairs, 2).sum(axis=1)
    return np.concatenate([joined, triangles[odd]]), np.concatenate([sums, rows[odd]])


def _qr(rows: Array) -> Array:
    return np.asarray(np.linalg.qr(rows, mode="r"))


def _padded(triangles: Array) -> Array:
    """Return triangles with rows of zeros where there were fewer rows than columns."""
    missing = triangles.shape[-1] - triangles.shape[-2]
    return np.asarray(np.pad(triangles, ((0, 0), (0, missing), (0, 0)))) if missing else triangles


def _triangle(stack: Array) -> Array:
    """Return the triangle of stacked triangles."""
    size = stack.shape[-1]
    rows = stack.reshape(-1, size)
    whole = len(rows) // UNIT_ROWS
    if whole > 1:
        first = _qr(rows[: whole * UNIT_ROWS].reshape(whole, UNIT_ROWS, size)).reshape(-1, size)
        rows = np.concatenate([first, rows[whole * UNIT_ROWS :]])
    return np.asarray(_padded(_qr(rows)[None])[0])


def _lengths(columns: Array) -> Array:
    length = np.asarray(np.linalg.norm(columns, axis=0))
    length[length == 0] = 1.0
    return length
