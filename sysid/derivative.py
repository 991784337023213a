"""Velocity from a noisy position."""

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput

Array = NDArray[np.float64]


@cache
def _weights(half: int) -> tuple[float, ...]:
    """Return c_1 .. c_half of the smooth noise-robust differentiator of length 2 half + 1.

    c_k = 2^-(2m+1) [C(2m, m-k+1) - C(2m, m-k-1)], m = half - 1 (Holoborodko 2008, thesis ref. 78).
    """
    m = half - 1

    def choose(k: int) -> int:
        return math.comb(2 * m, k) if 0 <= k <= 2 * m else 0

    return tuple((choose(m - k + 1) - choose(m - k - 1)) / 2 ** (2 * m + 1) for k in range(1, half + 1))


def noise_robust_derivative(time_s: Array, value: Array, half: int = 4) -> Array:
    """Return d(value)/dt at each of n samples, (n,), by the smooth noise-robust differentiator.

    Exact for quadratics on an even clock, and for straight lines on any; gain falls smoothly to
    zero at the Nyquist frequency. Each pair of samples is divided by its own time difference, so
    jitter costs no accuracy on a straight line. The `half` samples at each end use shorter
    stencils, the two outermost a one-sided difference. Raises BadInput for fewer than 2 samples.
    """
    if len(time_s) < 2:
        raise BadInput("derivative", f"{len(time_s)} samples", "at least 2 are needed")
    speed = np.empty_like(value)
    speed[0] = (value[1] - value[0]) / (time_s[1] - time_s[0])
    speed[-1] = (value[-1] - value[-2]) / (time_s[-1] - time_s[-2])
    reach = np.minimum(np.arange(len(value)), np.arange(len(value))[::-1]).clip(max=half)
    for length in range(1, half + 1):
        centre = np.flatnonzero(reach == length)
        speed[centre] = 0.0
        for k, weight in enumerate(_weights(length), start=1):
            rise, time = value[centre + k] - value[centre - k], time_s[centre + k] - time_s[centre - k]
            speed[centre] += 2 * k * weight * rise / time
    return speed
