"""What the whole-marker fit thinks a picture is: a blob's grey at a place, with its derivatives.

A square blurred by a Gaussian has a closed form in its own plane: the product of two differences of
the normal distribution function. Nested squares are sums of such; light is a plane of grey.
"""

import math

import numpy as np
from numba import njit

from data.signal import Array

OUT, IN, SLOPE_U, SLOPE_V = range(4)  # a blob's own
_T = np.arange(-176, 178) / 32
CDF = np.array([0.5 * math.erfc(-t / math.sqrt(2)) for t in _T])
BELL = np.exp(-(_T**2) / 2) / math.sqrt(2 * math.pi)


@njit(cache=True, inline="always", error_model="numpy")
def _normal(t: float) -> tuple[float, float]:
    """Return the normal distribution's cdf and density to 1e-8: cubics between tabled values and slopes."""
    if t >= 5.5:
        return 1.0, 0.0
    if t <= -5.5:
        return 0.0, 0.0
    place = (t + 5.5) * 32
    k = int(place)
    f = place - k
    a, b, p, q = CDF[k], CDF[k + 1], BELL[k], BELL[k + 1]
    end = f * f * (3 - 2 * f)
    rise, fall = f * (1 - f) * (1 - f) / 32, f * f * (f - 1) / 32
    s = (k / 32) - 5.5
    return a + end * (b - a) + rise * p + fall * q, p + end * (q - p) - rise * s * p - fall * (s + 1 / 32) * q


@njit(cache=True, error_model="numpy")
def model_at(  # noqa: PLR0917, compiled functions take arrays, not objects
    u: float, v: float, shape: Array, steeper: Array, light: Array, rings: Array, row: Array
) -> float:
    """Return the grey at a place in a blob's own coordinates; `row` takes the derivatives.

    shape: half side and two blurs, plane units. steeper (2,) and light (4,): grey.
    row (11,): by u, v, log half, two log blurs, steeper, light.
    """
    half, blur_u, blur_v = shape
    ink = ink_u = ink_v = ink_h = ink_a = ink_b = 0.0
    sharp_u, sharp_v = 1 / blur_u, 1 / blur_v
    for r in range(rings.shape[0]):
        h, weight = half * rings[r, 0], rings[r, 1]
        tl, tr = (u + h) * sharp_u, (u - h) * sharp_u
        cl, dl = _normal(tl)
        cr, dr = _normal(tr)
        bl, br = (v + h) * sharp_v, (v - h) * sharp_v
        ct, dt = _normal(bl)
        cb, db = _normal(br)
        pu, pv = cl - cr, ct - cb
        ink += weight * pu * pv
        ink_u += weight * pv * (dl - dr) * sharp_u
        ink_v += weight * pu * (dt - db) * sharp_v
        ink_h += weight * h * (pv * (dl + dr) * sharp_u + pu * (dt + db) * sharp_v)
        ink_a += weight * pv * (tr * dr - tl * dl)
        ink_b += weight * pu * (br * db - bl * dt)
    contrast = light[IN] - light[OUT] + steeper[0] * u + steeper[1] * v
    row[0] = contrast * ink_u + light[SLOPE_U] + steeper[0] * ink
    row[1] = contrast * ink_v + light[SLOPE_V] + steeper[1] * ink
    row[2], row[3], row[4] = contrast * ink_h, contrast * ink_a, contrast * ink_b
    row[5], row[6] = ink * u, ink * v
    row[7], row[8], row[9], row[10] = 1 - ink, ink, u, v
    return float(light[OUT] + light[SLOPE_U] * u + light[SLOPE_V] * v + contrast * ink)
