"""The whole-marker fit's compiled loops: normal equations over the pixels, elimination, steps.

Shared parameters, 13: the homography's compositional step in marker coordinates (x, y shift; x by x,
x by y, y by x, y by y; two of perspective), logarithms of the size and of the blurs along x and y,
how much steeper the light's slopes along x and y are inside the blobs (ink answers less to light).
A blob's own, 4: grey outside, grey inside, slopes of the light along x and y.
"""

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vision.fit_model import IN, OUT, SLOPE_U, SLOPE_V, model_at
from vision.pattern import BLOBS

Array = NDArray[Any]  # compiled code is not generic in what mypy knows of linear algebra
SHARED, OWN = 13, 4
BLOB_X, BLOB_Y = np.ascontiguousarray(BLOBS[:, 0]), np.ascontiguousarray(BLOBS[:, 1])
CENTRE = 1 / 3  # of the three blobs: the origin of the steps, x and y
STEEPER = 11  # where the light's steepness begins among the shared
BATCH = 8  # rows that are added at once
ROW = 24  # a row of the Jacobian, 17 long, in whole vector registers
FLAT = 4.5  # blurs from an edge where its slope is 4e-5 of the greatest
BINS = 512
BAD = 0.4  # of the contrast: a pixel that differs so much from the model is none of this marker
SETTLED = 8  # steps after which the trimming stays, and a longer step ends it: the model does not quite hold
TRIM = 4.0  # noises beyond which a pixel is left out
# What is counted for each blob.
EDGE, RESIDUAL, INSIDE, BAD_INSIDE, OUTSIDE, BAD_OUTSIDE, COUNTS = range(7)


@njit(cache=True, error_model="numpy")
def accumulate(  # noqa: PLR0915, PLR0917, one loop over pixels reads better than its parts
    picture: NDArray[Any],
    plane: Array,
    shape: Array,
    steeper: Array,
    light: Array,
    rings: Array,
    margin: float,
    limit: float,
    normal: Array,
    right: Array,
    counts: Array,
    histogram: NDArray[np.int64],
    bin_grey: float,
) -> None:
    """Sum the normal equations of every blob over its pixels.

    plane: plane from picture, (3, 3), origin at the corner blob. shape: half side and two blurs in
    plane units. margin: how far outside a blob pixels count, in plane units. limit: largest
    residual that counts. normal (3, 24, 24) and right (3, 24) take J'J and J'r, shared parameters
    before a blob's own; counts (3, COUNTS); histogram: of absolute residuals near edges.
    """
    half, blur_u, blur_v = shape
    reach = half + margin
    picture_from = np.linalg.inv(plane)
    part, rows, residuals, filled = np.zeros(11), np.zeros((BATCH, ROW)), np.zeros(BATCH), 0
    flat = np.zeros((2, 9))
    normal[:], right[:], counts[:], histogram[:] = 0.0, 0.0, 0.0, 0
    for b in range(3):
        x0, y0, x1, y1 = _box(picture_from, BLOB_X[b], BLOB_Y[b], reach, picture.shape)
        n, g, c, own = normal[b], right[b], counts[b], light[b]
        for y in range(y0, y1 + 1):
            first, last = _span(plane, BLOB_X[b], BLOB_Y[b], reach, x0, x1, y)
            for x in range(first, last + 1):
                depth = 1.0 / (plane[2, 0] * x + plane[2, 1] * y + plane[2, 2])
                px = (plane[0, 0] * x + plane[0, 1] * y + plane[0, 2]) * depth
                py = (plane[1, 0] * x + plane[1, 1] * y + plane[1, 2]) * depth
                u, v = px - BLOB_X[b], py - BLOB_Y[b]
                au, av = abs(u), abs(v)
                over = max((au - half) / blur_u, (av - half) / blur_v)
                solid = rings.shape[0] == 1 and over < -FLAT
                if over > FLAT or solid:
                    value = own[IN if solid else OUT] + own[SLOPE_U] * u + own[SLOPE_V] * v
                    value += steeper[0] * u + steeper[1] * v if solid else 0.0
                    residual = picture[y, x] - value
                    bad = abs(residual) > BAD * abs(own[IN] - own[OUT])
                    c[INSIDE if solid else OUTSIDE] += 1
                    c[BAD_INSIDE if solid else BAD_OUTSIDE] += bad
                    if abs(residual) < limit:
                        m = flat[1 if solid else 0]
                        m[0] += 1.0
                        m[1] += u
                        m[2] += v
                        m[3] += u * u
                        m[4] += u * v
                        m[5] += v * v
                        m[6] += residual
                        m[7] += residual * u
                        m[8] += residual * v
                    continue
                value = model_at(u, v, shape, steeper, own, rings, part)
                residual = picture[y, x] - value
                bad = abs(residual) > BAD * abs(own[IN] - own[OUT])
                c[INSIDE if over < 0 else OUTSIDE] += 1
                c[BAD_INSIDE if over < 0 else BAD_OUTSIDE] += bad
                histogram[min(BINS - 1, int(abs(residual) / bin_grey))] += 1
                if abs(residual) > limit:
                    continue
                c[EDGE] += 1
                c[RESIDUAL] += residual * residual
                px -= CENTRE
                py -= CENTRE
                gu, gv = part[0], part[1]
                both = gu * px + gv * py
                row = rows[filled]
                row[0], row[1] = -gu, -gv
                row[2], row[3], row[4], row[5] = -gu * px, -gu * py, -gv * px, -gv * py
                row[6], row[7] = both * px, both * py
                for k in range(9):
                    row[8 + k] = part[2 + k]
                residuals[filled] = residual
                filled += 1
                if filled == BATCH:
                    _add(rows, residuals, n, g)
                    filled = 0
        rows[filled:] = 0.0
        _add(rows, residuals, n, g)
        filled = 0
        _add_flat(n, g, flat[0], False)
        _add_flat(n, g, flat[1], True)
        flat[:] = 0.0
        for i in range(SHARED + OWN):  # only the upper triangle was summed
            for j in range(i):
                n[i, j] = n[j, i]


@njit(cache=True, error_model="numpy")
def _add_flat(normal: Array, right: Array, sums: Array, solid: bool) -> None:
    """Add the pixels far from all edges, which know of the light alone, by their sums.

    sums (9,): of 1, u, v, u^2, u v, v^2, residual, residual u, residual v.
    """
    i, j, k = SHARED + (IN if solid else OUT), SHARED + SLOPE_U, SHARED + SLOPE_V
    for at, moment, along_u, along_v, answer in ((j, 1, 3, 4, 7), (k, 2, 4, 5, 8)):
        right[at] += sums[answer]
        normal[i, at] += sums[moment]
        normal[at, at] += sums[along_u if at == j else along_v]
        if solid:
            steep = STEEPER + at - j
            right[steep] += sums[answer]
            normal[steep, i] += sums[moment]
            normal[steep, j] += sums[along_u]
            normal[steep, k] += sums[along_v]
            normal[steep, steep] += sums[along_u if at == j else along_v]
    right[i] += sums[6]
    normal[i, i] += sums[0]
    normal[j, k] += sums[4]
    if solid:
        normal[STEEPER, STEEPER + 1] += sums[4]


@njit(cache=True, error_model="numpy")
def _span(  # noqa: PLR0917
    plane: Array, u: float, v: float, reach: float, x0: int, x1: int, y: int
) -> tuple[int, int]:
    """Return the first and last column of a row within reach of a place: |u - u0| <= reach is linear in x."""
    low, high = float(x0), float(x1)
    for axis, place in ((0, u), (1, v)):
        for sign in (-1.0, 1.0):  # sign (numerator - place depth) <= reach depth
            slope = sign * (plane[axis, 0] - place * plane[2, 0]) - reach * plane[2, 0]
            rest = sign * (plane[axis, 1] - place * plane[2, 1]) - reach * plane[2, 1]
            rest = rest * y + sign * (plane[axis, 2] - place * plane[2, 2]) - reach * plane[2, 2]
            if slope > 0:
                high = min(high, -rest / slope)
            elif slope < 0:
                low = max(low, -rest / slope)
            elif rest > 0:
                return 0, -1
    return math.ceil(low), math.floor(high)


@njit(cache=True, error_model="numpy")
def _add(rows: Array, residuals: Array, normal: Array, right: Array) -> None:
    """Add a batch of rows to J'J (upper triangle) and J'r: one store for all of the batch."""
    for i in range(SHARED + OWN):
        a, b, c, d = rows[0, i], rows[1, i], rows[2, i], rows[3, i]
        e, f, g, h = rows[4, i], rows[5, i], rows[6, i], rows[7, i]
        for k in range(BATCH):
            right[i] += rows[k, i] * residuals[k]
        for j in range(i // 8 * 8, ROW):
            normal[i, j] += (
                a * rows[0, j] + b * rows[1, j] + c * rows[2, j] + d * rows[3, j]
                + e * rows[4, j] + f * rows[5, j] + g * rows[6, j] + h * rows[7, j]
            )  # fmt: skip


@njit(cache=True, error_model="numpy")
def _box(picture_from: Array, u: float, v: float, reach: float, size: tuple[int, int]) -> tuple[int, int, int, int]:
    """Return the first and last column and row of the pixels that may lie within reach of a place."""
    x0 = y0 = np.inf
    x1 = y1 = -np.inf
    for i in range(4):
        pu, pv = u + (reach if i % 2 else -reach), v + (reach if i // 2 else -reach)
        depth = picture_from[2, 0] * pu + picture_from[2, 1] * pv + picture_from[2, 2]
        x = (picture_from[0, 0] * pu + picture_from[0, 1] * pv + picture_from[0, 2]) / depth
        y = (picture_from[1, 0] * pu + picture_from[1, 1] * pv + picture_from[1, 2]) / depth
        x0, x1, y0, y1 = min(x0, x), max(x1, x), min(y0, y), max(y1, y)
    return (
        int(max(0.0, math.ceil(x0))),
        int(max(0.0, math.ceil(y0))),
        int(min(size[1] - 1.0, math.floor(x1))),
        int(min(size[0] - 1.0, math.floor(y1))),
    )


@njit(cache=True, error_model="numpy")
def solve(normal: Array, right: Array) -> tuple[Array, Array, Array]:
    """Return the shared step (13,), the lights' (3, 4) and the information on the shared (13, 13).

    The light of a blob meets no other blob's, so it is eliminated blob by blob (Schur).
    """
    information, target = np.zeros((SHARED, SHARED)), np.zeros(SHARED)
    to_shared, own = np.zeros((3, OWN, SHARED)), np.zeros((3, OWN))
    end = SHARED + OWN
    for b in range(3):
        inner = np.ascontiguousarray(normal[b, SHARED:end, SHARED:end])
        cross = np.ascontiguousarray(normal[b, SHARED:end, :SHARED])
        to_shared[b] = np.linalg.solve(inner, cross)
        own[b] = np.linalg.solve(inner, np.ascontiguousarray(right[b, SHARED:end]))
        information += normal[b, :SHARED, :SHARED] - cross.T @ to_shared[b]
        target += right[b, :SHARED] - cross.T @ own[b]
    step = np.linalg.solve(information, target)
    for b in range(3):
        own[b] -= to_shared[b] @ step
    return step, own, information


@njit(cache=True, error_model="numpy")
def gauss_newton(  # noqa: PLR0917
    picture: NDArray[Any],
    homography: Array,
    shape: Array,
    steeper: Array,
    light: Array,
    rings: Array,
    most_steps: int,
    small: float,
    bin_grey: float,
) -> tuple[int, Array, Array, float]:
    """Fit all parameters in place; return steps, information (13, 13), counts and noise.

    Stops when a step is shorter than `small` standard deviations of the answer, ten times that
    after SETTLED steps. Residuals beyond
    TRIM times the noise, taken from the median residual near edges, are left out: glare, dirt.
    steps is most_steps + 1 when it did not settle, 0 when the numbers left all bounds.
    """
    normal, right = np.zeros((3, ROW, ROW)), np.zeros((3, ROW))
    counts, histogram = np.zeros((3, COUNTS)), np.zeros(BINS, np.int64)
    information = np.zeros((SHARED, SHARED))
    noise, limit, change = np.inf, np.inf, np.zeros((3, 3))
    to_centre, to_corner = np.eye(3), np.eye(3)
    to_centre[:2, 2], to_corner[:2, 2] = CENTRE, -CENTRE
    for done in range(most_steps):
        pixel = 1 / math.sqrt(abs(homography[0, 0] * homography[1, 1] - homography[0, 1] * homography[1, 0]))
        margin = min(max(FLAT * max(shape[1], shape[2]), 12 * pixel), shape[0] * (0.7 if rings.shape[0] == 1 else 0.2))
        plane = np.linalg.inv(homography)
        accumulate(
            picture, plane, shape, steeper, light, rings, margin, limit, normal, right, counts, histogram, bin_grey
        )
        edge = counts[:, EDGE].sum()
        if edge < 60 or counts[:, EDGE].min() < 12:
            return 0, information, counts, noise
        noise = math.sqrt(float(counts[:, RESIDUAL].sum()) / (float(edge) - SHARED))
        if done < SETTLED:
            limit = TRIM * max(1.4826 * _median(histogram, bin_grey), bin_grey)
        step, own, information = solve(normal, right)
        if not np.isfinite(step).all():
            return 0, information, counts, noise
        gain = max(0.0, float(step @ information @ step))  # what the step takes off the sum of squares
        length = math.sqrt(gain / max(noise**2 - gain / float(edge), 0.01 * noise**2))
        worst = max(np.abs(step[:8]).max() / 0.2, np.abs(step[8]) / 0.2, np.abs(step[9:11]).max() / 0.5)
        step /= max(1.0, worst)
        change[0, 0], change[0, 1], change[0, 2] = step[2], step[3], step[0]
        change[1, 0], change[1, 1], change[1, 2] = step[4], step[5], step[1]
        change[2, 0], change[2, 1] = step[6], step[7]
        homography[:] = homography @ to_centre @ (np.eye(3) + change) @ to_corner
        homography /= homography[2, 2]
        shape *= np.exp(step[8:11])
        steeper += step[11:]
        light += own
        if not (0.01 < shape[0] < 0.49 and min(shape[1], shape[2]) > 1e-4 and max(shape[1], shape[2]) < shape[0] * 2):
            return 0, information, counts, noise
        if length < (small if done < SETTLED else 10 * small) and worst <= 1:
            return done + 1, information, counts, noise
    return most_steps + 1, information, counts, noise


@njit(cache=True, error_model="numpy")
def _median(histogram: NDArray[np.int64], bin_grey: float) -> float:
    half, below = histogram.sum() / 2, 0.0
    for k in range(histogram.shape[0]):
        if below + histogram[k] >= half:
            return float(bin_grey * (k + (half - below) / max(1, histogram[k])))
        below += histogram[k]
    return float(bin_grey * histogram.shape[0])
