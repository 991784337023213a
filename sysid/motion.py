"""Position, velocity and acceleration from one noisy position: three methods, one interface.

All three are told the same thing, a half-width in samples, and choose it by the same rule.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput
from data.signal import check_increasing
from sysid.derivative import _weights, noise_robust_derivative

Array = NDArray[np.float64]

ORDER = 6  # of the Savitzky-Golay polynomial
HALVES = tuple(sorted({round(2 * 1.09**k) for k in range(48)}))
LEAST = {"Savitzky-Golay": 4, "noise-robust": 2, "Kalman RTS": 2}  # the narrowest that makes a second derivative
SLACK = 1.5  # see `choose_half`
GAP = 5.0  # sampling intervals
JITTER = 0.01
SEGMENT = 1024


@dataclass(frozen=True, eq=False)
class Motion:
    """x, dx/dt and d2x/dt2 at every sample, each (n,), NaN where they cannot be known.

    noise: standard deviation of the position's white noise, as estimated. half: the half-width
    in samples. notes: what was repaired or left out.
    """

    position: Array
    velocity: Array
    acceleration: Array
    method: str
    half: int
    noise: float
    notes: tuple[str, ...] = ()

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which samples have all three, (n,)."""
        return np.isfinite(self.position) & np.isfinite(self.velocity) & np.isfinite(self.acceleration)


def _savitzky_golay(value: Array, step_s: float, half: int) -> tuple[Array, Array, Array]:
    from scipy.signal import savgol_filter

    found = [np.asarray(savgol_filter(value, 2 * half + 1, ORDER, deriv=d, delta=step_s), np.float64) for d in range(3)]
    for one in found:  # at the ends the polynomial is extrapolated, and amplifies the noise a hundredfold
        one[:half] = one[-half:] = np.nan
    return found[0], found[1], found[2]


def _noise_robust(value: Array, step_s: float, half: int) -> tuple[Array, Array, Array]:
    time_s = np.asarray(step_s * np.arange(len(value)), dtype=np.float64)
    velocity = noise_robust_derivative(time_s, value, half)
    acceleration = noise_robust_derivative(time_s, velocity, half)
    velocity[:half] = velocity[-half:] = np.nan
    acceleration[: 2 * half] = acceleration[-2 * half :] = np.nan
    return value.copy(), velocity, acceleration


def _kalman(value: Array, step_s: float, half: int) -> tuple[Array, Array, Array]:
    from filterpy.kalman import KalmanFilter

    # Time counts in samples and variance in the noise's own: only their ratio, the corner, matters.
    model = KalmanFilter(dim_x=3, dim_z=1)
    model.F = np.array([[1, 1, 0.5], [0, 1, 1], [0, 0, 1]])
    model.H = np.array([[1.0, 0.0, 0.0]])
    model.R = np.array([[1.0]])
    model.Q = (np.pi / half) ** 6 * np.array([[1 / 20, 1 / 8, 1 / 6], [1 / 8, 1 / 3, 1 / 2], [1 / 6, 1 / 2, 1]])
    model.x = np.array([[value[0]], [0.0], [0.0]])
    model.P = np.diag([1.0, 1e4, 1e4])
    means, covariances, _, _ = model.batch_filter(value)
    smooth = model.rts_smoother(means, covariances)[0][:, :, 0] / [1, step_s, step_s**2]
    return smooth[:, 0].copy(), smooth[:, 1].copy(), smooth[:, 2].copy()


def _savitzky_golay_gain(half: int, phase: Array) -> Array:
    from scipy.signal import savgol_coeffs

    weights = savgol_coeffs(2 * half + 1, ORDER, deriv=2, use="dot")
    return np.asarray(weights[half] + 2 * np.cos(np.outer(phase, np.arange(1, half + 1))) @ weights[half + 1 :])


def _noise_robust_gain(half: int, phase: Array) -> Array:
    once = 2 * np.sin(np.outer(phase, np.arange(1, half + 1))) @ np.array(_weights(half))
    return np.asarray(-(once**2))


def _kalman_gain(half: int, phase: Array) -> Array:
    return np.asarray(-(phase**2) / (1 + (phase * half / np.pi) ** 6))


_Solve = Callable[[Array, float, int], tuple[Array, Array, Array]]
METHODS: dict[str, tuple[_Solve, Callable[[int, Array], Array]]] = {
    "Savitzky-Golay": (_savitzky_golay, _savitzky_golay_gain),
    "noise-robust": (_noise_robust, _noise_robust_gain),
    "Kalman RTS": (_kalman, _kalman_gain),
}
DEFAULT = "Savitzky-Golay"


@cache
def _gains(method: str, half: int, count: int) -> Array:
    """Return the second derivative's gain (per sample squared) at `count` phases from 0 to pi."""
    return METHODS[method][1](half, np.linspace(0, np.pi, count))


def choose_half(value: Array, method: str = DEFAULT) -> tuple[int, float]:
    """Return (half-width, noise's standard deviation) for an evenly sampled position (n,).

    The rule: the spectrum's top quarter is noise, N. For each width the second derivative's
    expected square error is the sum over frequencies of (g - g0)^2 S + g^2 N, where g is the
    method's gain, g0 = -w^2 the exact one, and S what stands out of the noise's scatter. Of
    the widths whose error is at most half as large again as the least the narrowest is taken: noise in an
    acceleration is known and averages out, a gain that is too small is neither.
    """
    from scipy.signal import detrend, welch

    size = min(SEGMENT, len(value))
    power = np.asarray(welch(value, nperseg=size, detrend=detrend)[1])
    noise = float(np.median(power[3 * len(power) // 4 :]))
    stands_out = 1 + 5 / np.sqrt(2 * len(value) / size)  # five deviations of the averaged spectrum
    signal = np.where(power > stands_out * noise, power - noise, 0.0)
    exact = -(np.linspace(0, np.pi, len(power)) ** 2)
    halves = [half for half in HALVES if LEAST[method] <= half <= len(value) // 4] or [LEAST[method]]
    risk = np.array([_risk(_gains(method, half, len(power)), exact, signal, noise) for half in halves])
    return halves[int(np.argmax(risk <= SLACK * risk.min()))], float(np.sqrt(noise / 2))


def _risk(gain: Array, exact: Array, signal: Array, noise: float) -> float:
    return float(np.sum((gain - exact) ** 2 * signal + gain**2 * noise))


def motion(time_s: Array, value: Array, method: str = DEFAULT, half: int | None = None) -> Motion:
    """Return position, velocity and acceleration of samples (n,), with what was repaired.

    Stretches between gaps (5 sampling intervals) and NaN are taken each by itself; one that is
    too short, and what lies nearer to an end than the method reaches, is NaN. Where stamps jitter
    by over 1 % a cubic spline brings the samples to an even clock and back. half None: `choose_half`
    on the longest stretch. Raises BadInput for stamps that do not increase, an unknown method,
    a signal without any stretch of 2 half + 1 samples, or infinite values.
    """
    if method not in METHODS:
        raise BadInput("derivative", f"method {method!r}", f"known: {', '.join(METHODS)}")
    check_increasing(time_s, "derivative")
    if np.isinf(value).any() or value.shape != time_s.shape:
        raise BadInput("derivative", "values are infinite, or not one for each stamp", "expected (n,) and (n,)")
    stretches, notes = _stretches(time_s, value)
    longest = max(stretches, key=len, default=range(0))
    least = 4 * LEAST[method] + 1
    if len(longest) < least:
        raise BadInput("derivative", f"the longest stretch has {len(longest)} samples", f"at least {least} are needed")
    even, _, _ = _even(time_s[longest], value[longest])
    chosen, noise = choose_half(even, method)
    width = half or chosen
    out = np.full((3, len(value)), np.nan)
    short = 0
    for stretch in stretches:
        if len(stretch) > 4 * width:
            out[:, stretch] = _stretch(time_s[stretch], value[stretch], method, width)
        else:
            short += len(stretch)
    notes += [f"{short} samples in stretches too short for a half-width of {width}"] if short else []
    if short == sum(map(len, stretches)):
        raise BadInput("derivative", notes[-1], "give a smaller half-width, or a longer recording")
    return Motion(out[0], out[1], out[2], method, width, noise, tuple(notes))


def _stretches(time_s: Array, value: Array) -> tuple[list[NDArray[np.int64]], list[str]]:
    """Return the sample numbers of each unbroken stretch, and words on what lies between."""
    sound = np.flatnonzero(np.isfinite(value))
    notes = [f"{len(value) - len(sound)} samples are NaN and left out"] if len(sound) < len(value) else []
    if len(sound) < 2:
        return [sound] if len(sound) else [], notes
    steps = np.diff(time_s[sound])
    breaks = np.flatnonzero(steps > GAP * np.median(steps)) + 1
    if len(breaks):
        notes.append(f"{len(breaks)} gaps wider than 5 sampling intervals: each side is differentiated by itself")
    even = np.median(steps)
    if (np.abs(steps[steps <= GAP * even] / even - 1) > JITTER).any():
        notes.append("stamps jitter by more than 1 %: a cubic spline carries the samples to an even clock")
    return np.split(sound, breaks), notes


def _even(time_s: Array, value: Array) -> tuple[Array, float, Array | None]:
    """Return (values on an even clock, its step, its times if they differ from the given ones)."""
    step = (time_s[-1] - time_s[0]) / (len(time_s) - 1)
    if (np.abs(np.diff(time_s) / step - 1) <= JITTER).all():
        return np.ascontiguousarray(value), float(step), None
    from scipy.interpolate import CubicSpline

    even_s = np.linspace(time_s[0], time_s[-1], len(time_s))
    return np.asarray(CubicSpline(time_s, value)(even_s)), float(step), even_s


def _stretch(time_s: Array, value: Array, method: str, half: int) -> Array:
    even, step_s, even_s = _even(time_s, value)
    found = METHODS[method][0](even, step_s, half)
    if even_s is None:
        return np.array(found)
    return np.array([np.interp(time_s, even_s, one) for one in found])
