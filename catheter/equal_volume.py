"""Volume of a bent wall from the centreline outwards, and the distance that holds a volume: a cubic."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.signal import Array

Number = NDArray[Any]  # real, or complex where a derivative is carried along


def moment(h: Number, s: Number, b: Number) -> Number:
    """Return the integral of h (s - h b) dh from 0 [m^2 per unit speed]."""
    return h * h * (s / 2 - b * h / 3)


def distance(volume: Number, s: Number, b: Number) -> Number:
    """Return the h with moment(h, s, b) = volume, from 0 up to the fold at h = s / b: a cubic in closed form.

    With x = b h / s it reads 3 x^2 - 2 x^3 = t^2, t = b sqrt(6 volume / s^3), solved by sines of a
    third of an angle, and where that would cancel, |t| < 0.1, by Newton for x / t. NaN past the
    fold, t > 1, and for a negative volume. Real or complex (for derivatives).
    """
    reach = np.sqrt(6 * np.where(np.real(volume) >= 0, volume, np.nan) / s)
    t = b / s * reach
    size = np.real(t)
    away = np.where(np.abs(size) < 0.1, 0.5, np.where(size > 1, np.nan, t))  # where the angle's formula is used
    angle = 2 * np.arcsin(np.where(size < -1, 0.5, away))
    x = np.sin(angle / 6) ** 2 + np.sqrt(0.75) * np.sin(angle / 3)
    x = np.where(size < -1, 0.5 - np.cosh(2 * np.arccosh(np.where(size < -1, -t, 1.5)) / 3), x)
    small = np.where(np.abs(size) < 0.1, t, 0)
    ratio = np.sqrt(1 / 3) + small / 9
    for _ in range(3):  # from 6e-4 off to 1e-7, 1e-14, 1e-28
        ratio = ratio - (3 * ratio**2 - 2 * small * ratio**3 - 1) / (6 * ratio - 6 * small * ratio**2)
    with np.errstate(invalid="ignore"):  # where there is no answer, NaN says so
        return np.asarray(reach * np.where(np.abs(size) < 0.1, ratio, x / away))


def smallest_bend(bore: Array, area: Array) -> Array:
    """Return the bend radius at which the outer wall just folds: the h = R that solves the cubic at its fold.

    R^3 / 6 = bore^2 (R / 2 - bore / 3) + area R, its largest root; area: of the wall per unit angle [m^2].
    """
    size = np.sqrt(np.maximum(bore**2 + 2 * area, 1e-300))
    return np.asarray(2 * size * np.cos(np.arccos(np.clip(-((bore / size) ** 3), -1, 1)) / 3))
