"""The synthetic camera's compiled loops: a polygon's share of every pixel, edge by edge (Green's theorem)."""

import math

import numpy as np
from numba import njit

from data.signal import Array

REACH = 5.5  # blurs beyond which an edge does nothing: the normal tail there is 2e-8
PIECE = 1.5  # blurs that one quadrature piece spans
NODES, WEIGHTS = (np.asarray(part) for part in np.polynomial.legendre.leggauss(5))


@njit(cache=True)
def _rise(x: float, blur: float) -> float:
    """Return the integral up to x of a unit box convolved with a Gaussian: z F(z) + f(z), twice."""
    a, b = (x + 0.5) / blur, (x - 0.5) / blur
    cdf_a, cdf_b = 0.5 * math.erfc(-a * 0.7071067811865476), 0.5 * math.erfc(-b * 0.7071067811865476)
    bell = 0.3989422804014327 * (math.exp(-0.5 * a * a) - math.exp(-0.5 * b * b))
    return blur * (a * cdf_a - b * cdf_b + bell)


@njit(cache=True)
def cover(edges: Array, blur: float, weight: float, out: Array) -> None:
    """Add a polygon's edges to `out`, whose rows are then summed from the right.

    A pixel left of an edge gets the edge's whole share of the row, one right of it nothing, one
    near it the integral over the edge of K(x) k(y) dy. The share is stored at the last pixel that
    gets it all; what is near is stored as differences.
    """
    height, width = out.shape
    reach = 0.5 + REACH * blur
    for e in range(edges.shape[0]):
        x0, y0, x1, y1 = edges[e]
        sign = weight
        if y1 < y0:
            x0, y0, x1, y1, sign = x1, y1, x0, y0, -weight
        if y1 - y0 < 1e-12:
            continue
        tilt = (x1 - x0) / (y1 - y0)
        for row in range(max(0, math.ceil(y0 - reach)), min(height - 1, math.floor(y1 + reach)) + 1):
            low, high = max(y0, row - reach), min(y1, row + reach)
            if high <= low:
                continue
            pieces = 1 + int((high - low) * math.sqrt(1 + tilt * tilt) / (PIECE * blur))
            count = pieces * NODES.shape[0]
            xs, amounts = np.empty(count), np.empty(count)
            total, step = 0.0, (high - low) / pieces
            for k in range(count):
                j = k if tilt >= 0 else count - 1 - k  # nodes in the order of growing x
                piece, node = j // NODES.shape[0], j % NODES.shape[0]
                y = low + step * (piece + 0.5 + 0.5 * NODES[node])
                a, b = (y - row + 0.5) / blur, (y - row - 0.5) / blur
                k_y = 0.5 * (math.erfc(-a * 0.7071067811865476) - math.erfc(-b * 0.7071067811865476))
                xs[k] = x0 + tilt * (y - y0)
                amounts[k] = sign * 0.5 * step * WEIGHTS[node] * k_y
                total += amounts[k]
            first = max(0, math.ceil(xs[0] - reach))
            last = min(width - 1, math.floor(xs[count - 1] + reach))
            if first > 0:
                out[row, min(first, width) - 1] += total
            for column in range(first, last + 1):
                value = _near(xs, amounts, column, blur, reach)
                out[row, column] += value
                if column > 0:
                    out[row, column - 1] -= value


@njit(cache=True)
def _near(xs: Array, amounts: Array, column: int, blur: float, reach: float) -> float:
    """Return the sum over an edge's nodes of amount times K(x - column)."""
    value = 0.0
    for k in range(xs.shape[0] - 1, -1, -1):
        x = xs[k] - column
        if x < -reach:
            break
        value += amounts[k] * (1.0 if x > reach else _rise(x, blur))
    return value


@njit(cache=True)
def sum_from_the_right(out: Array) -> None:
    """Turn what `cover` stored into the picture, in place."""
    for row in range(out.shape[0]):
        for column in range(out.shape[1] - 2, -1, -1):
            out[row, column] += out[row, column + 1]
