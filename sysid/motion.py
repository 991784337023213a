"""Position, velocity and acceleration from one noisy position: three methods, one interface.

All three are told the same thing, a half-width in samples, and choose it by the same rule: the
two filters window by window, for a chirp is slow here and fast there; the Kalman smoother once.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput
from data.signal import check_increasing
from sysid.derivative import _weights, noise_robust_derivative

Array = NDArray[np.float64]

ORDER = 6  # of the Savitzky-Golay polynomial
HALVES = tuple(sorted({round(2 * 1.09**k) for k in range(48)}))
SLACK = 1.3  # see `choose_half`
FALSE_ALARM = 1e-3  # the chance that noise alone stands out somewhere in a spectrum
WINDOW = 4096  # samples that share a half-width; it is chosen on twice as many
GAP = 5.0  # sampling intervals
JITTER = 0.01
SEGMENT = 1024


@dataclass(frozen=True, eq=False)
class Motion:
    """x, dx/dt and d2x/dt2 at every sample, each (n,), NaN where they cannot be known.

    noise: standard deviation of the position's white noise, as estimated. half: the narrowest and
    the widest half-width, in samples. notes: what was repaired or left out.
    """

    position: Array
    velocity: Array
    acceleration: Array
    method: str
    half: tuple[int, int]
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


class Method(NamedTuple):
    """A way to differentiate: solve(value, step, half), its second derivative's gain(half, phase).

    least: the narrowest half-width that makes a second derivative. local: whether a half-width
    may differ from window to window.
    """

    solve: Callable[[Array, float, int], tuple[Array, Array, Array]]
    gain: Callable[[int, Array], Array]
    least: int
    local: bool


METHODS = {
    "Savitzky-Golay": Method(_savitzky_golay, _savitzky_golay_gain, least=4, local=True),
    "noise-robust": Method(_noise_robust, _noise_robust_gain, least=2, local=True),
    "Kalman RTS": Method(_kalman, _kalman_gain, least=2, local=False),
}
DEFAULT = "Savitzky-Golay"


@cache
def _gains(method: str, half: int, count: int) -> Array:
    """Return the second derivative's gain (per sample squared) at `count` phases from 0 to pi."""
    return METHODS[method].gain(half, np.linspace(0, np.pi, count))


def choose_half(value: Array, method: str = DEFAULT, noise: float | None = None) -> tuple[int, float]:
    """Return (half-width, noise's standard deviation) for an evenly sampled position (n,).

    The rule: the spectrum's top quarter is noise, N, unless it is given. For each width the second
    derivative's expected square error is the sum over frequencies of (g - g0)^2 S + g^2 N, where g
    is the method's gain, g0 = -w^2 the exact one, and S what stands out of the noise's scatter. Of
    the widths whose error is at most 1.3 times the least the narrowest is taken: noise in an
    acceleration is known and averages out, a gain that is too small is neither.
    """
    from scipy.signal import detrend, welch
    from scipy.stats import chi2

    size = min(SEGMENT, len(value))
    power = np.asarray(welch(value, nperseg=size, detrend=detrend)[1])
    floor = float(np.median(power[3 * len(power) // 4 :])) if noise is None else 2 * noise**2
    freedom = 1.9 * max(1.0, 2 * len(value) / size - 1)  # of segments that overlap by half (Welch 1967)
    stands_out = float(chi2.isf(FALSE_ALARM / len(power), freedom)) / freedom
    signal = np.where(power > stands_out * floor, power - floor, 0.0)
    exact = -(np.linspace(0, np.pi, len(power)) ** 2)
    least = METHODS[method].least
    halves = [half for half in HALVES if least <= half <= len(value) // 4] or [least]
    risk = np.array([_risk(_gains(method, half, len(power)), exact, signal, floor) for half in halves])
    return halves[int(np.argmax(risk <= SLACK * risk.min()))], float(np.sqrt(floor / 2))


def _halves(value: Array, method: str, noise: float) -> NDArray[np.int64]:
    """Return the half-width at every sample (n,), chosen window by window."""
    edges = np.linspace(0, len(value), max(1, round(len(value) / WINDOW)) + 1).astype(int)
    found = np.empty(len(value), np.int64)
    for first, last in pairwise(edges):
        seen = value[max(0, first - WINDOW // 2) : last + WINDOW // 2]
        found[first:last] = choose_half(seen, method, noise)[0]
    return found


def _risk(gain: Array, exact: Array, signal: Array, noise: float) -> float:
    return float(np.sum((gain - exact) ** 2 * signal + gain**2 * noise))


def motion(time_s: Array, value: Array, method: str = DEFAULT, half: int | None = None) -> Motion:
    """Return position, velocity and acceleration of samples (n,), with what was repaired.

    Stretches between gaps (5 sampling intervals) and NaN are taken each by itself; one that is
    too short, and what lies nearer to an end than the method reaches, is NaN. Where stamps jitter
    by over 1 % a cubic spline brings the samples to an even clock and back. half None: `choose_half`
    in each window of 4096 samples (in shorter stretches: as on all of the longest). Raises BadInput
    for stamps that do not increase, an unknown method, a signal without any stretch of 2 half + 1
    samples, or infinite values.
    """
    if method not in METHODS:
        raise BadInput("derivative", f"method {method!r}", f"known: {', '.join(METHODS)}")
    check_increasing(time_s, "derivative")
    if np.isinf(value).any() or value.shape != time_s.shape:
        raise BadInput("derivative", "values are infinite, or not one for each stamp", "expected (n,) and (n,)")
    stretches, notes = _stretches(time_s, value)
    longest = max(stretches, key=len, default=range(0))
    least = 4 * METHODS[method].least + 1
    if len(longest) < least:
        raise BadInput("derivative", f"the longest stretch has {len(longest)} samples", f"at least {least} are needed")
    even, _, _ = _even(time_s[longest], value[longest])
    chosen, noise = choose_half(even, method)
    width = half or chosen
    out, widths, short = np.full((3, len(value)), np.nan), np.zeros(len(value), np.int64), 0
    for stretch in stretches:
        if len(stretch) <= 4 * width:
            short += len(stretch)
            continue
        even, step_s, even_s = _even(time_s[stretch], value[stretch])
        local = not half and METHODS[method].local and len(stretch) >= WINDOW
        widths[stretch] = _halves(even, method, noise) if local else width
        found = _differentiate(even, step_s, method, widths[stretch])
        back = found if even_s is None else np.array([np.interp(time_s[stretch], even_s, one) for one in found])
        out[:, stretch] = back
    notes += [f"{short} samples in stretches too short for a half-width of {width}"] if short else []
    if short == sum(map(len, stretches)):
        raise BadInput("derivative", notes[-1], "give a smaller half-width, or a longer recording")
    span = (int(widths[widths > 0].min()), int(widths.max()))
    return Motion(out[0], out[1], out[2], method, span, noise, tuple(notes))


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


def _differentiate(even: Array, step_s: float, method: str, halves: NDArray[np.int64]) -> Array:
    """Return x, dx/dt, d2x/dt2 (3, n): each run of one half-width is solved with what it reaches on either side."""
    out = np.empty((3, len(even)))
    for first, last in _runs(halves):
        reach = 2 * int(halves[first])
        begin = max(0, first - reach)
        found = METHODS[method].solve(even[begin : last + reach], step_s, int(halves[first]))
        out[:, first:last] = np.array(found)[:, first - begin : last - begin]
    return out


def _runs(value: NDArray[np.int64]) -> Iterator[tuple[int, int]]:
    """Yield (first, past the last) of each run of equal values."""
    edges = [0, *(np.flatnonzero(np.diff(value)) + 1).tolist(), len(value)]
    yield from pairwise(edges)
