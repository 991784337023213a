"""Relaxation at constant input: how fast, and by how much, a response fades."""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Dwell:
    """y = end + amount exp(-(t - first) / time_constant) while x stays; units of y and s."""

    first_s: float
    last_s: float
    level: float
    end: float
    amount: float
    time_constant_s: float
    rmse: float
    contrast: float  # length of the fitted exponential over the residual's deviation: noise alone reaches 4


def fit_dwell(time_s: Array, level: float, response: Array) -> Dwell:
    """Fit one exponential to a response (n,) at constant input, over time constants from 3 samples to 10 spans.

    For each time constant of a fine grid the two weights are linear; the best is taken. Raises
    BadInput for fewer than 10 samples.
    """
    if len(time_s) < 10:
        raise BadInput("relaxation", f"{len(time_s)} samples", "at least 10 are needed")
    t = time_s - time_s[0]
    grid = np.geomspace(3 * t[-1] / len(t), 10 * t[-1], 120)
    shapes = np.exp(-t / grid[:, None])
    shapes -= shapes.mean(axis=1, keepdims=True)
    centred = response - response.mean()
    power = np.sum(shapes**2, axis=1)
    share = shapes @ centred
    at = int(np.argmax(share**2 / power))
    amount = float(share[at] / power[at])
    end = float(response.mean() - amount * np.exp(-t / grid[at]).mean())
    rmse = float(np.sqrt(np.mean((centred - amount * shapes[at]) ** 2)))
    contrast = float(abs(share[at]) / np.sqrt(power[at]) / max(rmse, 1e-300))
    return Dwell(float(time_s[0]), float(time_s[-1]), level, end, amount, float(grid[at]), rmse, contrast)


def dwells(time_s: Array, x: Array, y: Array, *, still: float = 0.004, least_s: float = 2.0) -> list[Dwell]:
    """Return the relaxation of every stretch where x stays within `still` of its span for `least_s` or longer.

    Only stretches whose fade stands out of their own noise are returned. x, y: (n,).
    """
    span = float(np.ptp(x)) if len(x) else 0.0
    if not span:
        return []
    bounds = np.concatenate([[0], _departs(x, still * span), [len(x)]])
    found = []
    for first, last in itertools.pairwise(bounds):
        settle = first + max(3, (last - first) // 20)
        if last - settle < 10 or time_s[last - 1] - time_s[settle] < least_s:
            continue
        one = fit_dwell(time_s[settle:last], float(np.mean(x[settle:last])), y[settle:last])
        inside = one.time_constant_s < 5 * (one.last_s - one.first_s)
        if inside and one.contrast > 8:
            found.append(one)
    return found


def _departs(x: Array, reach: float) -> NDArray[np.int64]:
    """Return the samples where x has left the level at which it last settled."""
    found, level = [], float(x[0])
    for index, value in enumerate(x.tolist()):
        if abs(value - level) > reach:
            found.append(index)
            level = value
    return np.array(found, dtype=np.int64)
