"""Any number of rows, once: small triangles that answer every least-squares question about them."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import NDArray

from data.errors import BadInput

Array = NDArray[np.float64]

UNIT_ROWS = 512  # rows that are reduced at a time: they fit the processor's cache
MOST_UNITS = 2048  # beyond it neighbours are merged, so that memory stays bounded
_REORDERED = {"reassoc", "contract"}  # sums may be taken in any order, by vector instructions


@njit(cache=True, fastmath=_REORDERED)
def _dot(a: Array, b: Array) -> float:
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@njit(cache=True, fastmath=_REORDERED)
def _subtract(share: float, a: Array, b: Array) -> None:
    for i in range(len(a)):
        b[i] -= share * a[i]


@njit(cache=True)
def _mirror(column: Array) -> tuple[float, float]:
    """Make a column its own mirror, which reflects it on its first axis; return (what lies there, 2 / square)."""
    square = _dot(column, column)
    if square == 0:
        return 0.0, 0.0
    pivot = -np.sqrt(square) if column[0] > 0 else np.sqrt(square)
    half = square - column[0] * pivot
    column[0] -= pivot
    return pivot, 1 / half


@njit(cache=True, fastmath=_REORDERED)
def _reflect_twice(one: Array, other: Array, angles: tuple[float, float, float], column: Array) -> None:
    """Reflect a column by two mirrors while it is read and written once."""
    along, beyond = 0.0, 0.0
    for i in range(len(one)):
        along += one[i] * column[i]
        beyond += other[i] * column[i]
    along *= angles[0]
    beyond = angles[1] * (beyond - along * angles[2])
    for i in range(len(one)):
        column[i] -= along * one[i] + beyond * other[i]


@njit(cache=True)
def _power(column: Array) -> float:
    """Scale a column whose squares would over- or underflow by a power of two, and return that."""
    if 1e-200 < _dot(column, column) < 1e200:
        return 1.0
    largest = np.abs(column).max()
    if largest == 0 or not np.isfinite(largest):
        return 1.0
    power = 2.0 ** np.floor(np.log2(largest))
    column /= power
    return float(power)


@njit(cache=True)
def _householder(tile: Array, triangle: Array) -> None:
    """Reduce a unit, held column by column (k+2, rows) and spent by it, to its triangle (k+2, k+2)."""
    count, powers = len(tile), np.empty(len(tile))
    for j in range(count):
        powers[j] = _power(tile[j])
    for j in range(0, count, 2):
        one = tile[j, j:]
        triangle[j, j], share = _mirror(one)
        if j + 1 < count:
            other = tile[j + 1, j:]
            _subtract(share * _dot(one, other), one, other)
            triangle[j, j + 1], other[0] = other[0], 0.0
            triangle[j + 1, j + 1], next_share = _mirror(other[1:])
            angles = (share, next_share, _dot(one, other))
            for c in range(j + 2, count):
                _reflect_twice(one, other, angles, tile[c, j:])
                triangle[j, c], triangle[j + 1, c] = tile[c, j], tile[c, j + 1]
    triangle *= powers


@njit(cache=True)
def _fill(columns: Array, response: Array, tile: Array, filled: int, triangles: Array) -> int:
    """Add rows to the unit begun in `tile`; each full one becomes the next triangle. Returns how many rows are left."""
    row, done, unit_rows = 0, 0, tile.shape[1]
    while row < len(response):
        part = min(unit_rows - filled, len(response) - row)
        tile[0, filled : filled + part] = 1.0
        for c in range(columns.shape[1]):
            tile[c + 1, filled : filled + part] = columns[row : row + part, c]
        tile[-1, filled : filled + part] = response[row : row + part]
        row, filled = row + part, filled + part
        if filled == unit_rows:
            _householder(tile, triangles[done])
            done, filled = done + 1, 0
    return filled


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

    Householder QR of each unit, of k + 2 rows at least; columns of any scale lose no digit by it.
    Raises as `reduce_rows`.
    """
    width = len(terms) + 2
    unit_rows = max(unit_rows, width)
    tile, filled = np.empty((width, unit_rows)), 0
    found: list[Array] = [np.empty((0, width, width))]
    rows = np.empty(0, np.int64)
    for columns, response in blocks:
        if columns.ndim != 2 or columns.shape != (len(response), len(terms)):
            raise BadInput("regression", f"X {columns.shape}, y {response.shape}", f"expected (n, {len(terms)}), (n,)")
        triangles = np.zeros(((filled + len(response)) // unit_rows, width, width))
        filled = _fill(_plain(columns), _plain(response), tile, filled, triangles)
        found.append(triangles)
        rows = np.concatenate([rows, np.full(len(triangles), unit_rows)])
        while len(rows) > 2 * MOST_UNITS:
            merged, rows = _merged(np.concatenate(found), rows)
            found = [merged]
    if filled:
        tile[:, filled:] = 0.0
        found.append(np.zeros((1, width, width)))
        _householder(tile, found[-1][0])
        rows = np.append(rows, filled)
    if rows.sum() < width:
        raise BadInput("regression", f"{rows.sum()} samples for {width - 1} weights", "record more samples")
    whole = np.concatenate(found)
    if not np.isfinite(whole).all():
        raise BadInput("regression", "X or y is not finite", "drop or repair those samples first")
    return Reduction(terms, whole, rows)


def _plain(array: Array) -> Array:
    """Return it as doubles, in one of the two orders the kernel is compiled for."""
    array = np.asarray(array, np.float64)
    return array if array.flags.c_contiguous or array.flags.f_contiguous else np.ascontiguousarray(array)


def _merged(triangles: Array, rows: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    """Return every two neighbours as one."""
    pairs, size = len(triangles) // 2, triangles.shape[-1]
    joined = np.linalg.qr(triangles[: 2 * pairs].reshape(pairs, 2 * size, size), mode="r")
    odd = slice(2 * pairs, None)
    sums = rows[: 2 * pairs].reshape(pairs, 2).sum(axis=1)
    return np.concatenate([joined, triangles[odd]]), np.concatenate([sums, rows[odd]])


def _triangle(stack: Array) -> Array:
    """Return the triangle of stacked triangles."""
    size = stack.shape[-1]
    rows = stack.reshape(-1, size)
    tile, triangle = np.zeros((size, max(size, len(rows)))), np.zeros((size, size))
    tile[:, : len(rows)] = rows.T
    _householder(tile, triangle)
    return triangle


def _lengths(columns: Array) -> Array:
    length = np.asarray(np.linalg.norm(columns, axis=0))
    length[length == 0] = 1.0
    return length
