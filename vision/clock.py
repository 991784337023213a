"""The clocks of two cameras, put on one: by a light that both see, or by a motion that both measure.

A frame's stamp is the middle of its exposure. With a global shutter and an exposure E, a frame that
a light comes on in is bright by the share of its exposure that followed: that tells the moment to
noise x E. A light that comes on while no shutter is open is known only to lie in the pause, of
length period - E, between two frames. With a rolling shutter a row is exposed (row / rows) x
readout later; `flashes` takes that delay of its region. A light that is on for a known time, a
whole number of periods and a half, is seen far better: where its beginning hides in a pause, its
end does not, or only in a small part of it (`of_known_length`).
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import ndtr

from data.errors import BadInput, DidNotConverge
from data.signal import Array, Signal
from vision.frames import Frame

SHARE = 0.95
STEPS = 4001  # of the offset's density
DOUBT = 5.5  # noises within which a frame is not told from fully dark or fully bright: chance does it once in 5e7


@dataclass(frozen=True)
class Flash:
    """A light's step as one camera saw it: between first_s and last_s, blurred by sigma_s; rises: it came on."""

    first_s: float
    last_s: float
    sigma_s: float
    rises: bool


@dataclass(frozen=True)
class Offset:
    """What is added to the other clock to read the first one's: seconds, deviation, 95 % interval.

    steps: how many steps of light, or samples of a motion, it rests on.
    """

    offset_s: float
    sigma_s: float
    low_s: float
    high_s: float
    steps: int


def brightness(frames: Iterable[Frame], region_px: tuple[int, int, int, int]) -> Signal:
    """Return the mean grey of a region (x, y, width, height) against time; frames that failed are left out.

    Raises BadInput when the region is not inside the picture.
    """
    times, values = [], []
    x, y, width, height = region_px
    for frame in frames:
        if frame.picture is None:
            continue
        rows, columns = frame.picture.shape
        if width < 1 or height < 1 or x < 0 or y < 0 or x + width > columns or y + height > rows:
            raise BadInput("region", f"{region_px} in a picture of {columns} x {rows}", "expected it inside")
        times.append(frame.time_s)
        values.append(float(frame.picture[y : y + height, x : x + width].mean()))
    return Signal(np.array(times), np.array(values), "1", note="grey levels", name="brightness")


def flashes(light: Signal, exposure_s: float, *, delay_s: float = 0.0) -> list[Flash]:
    """Return the steps of a light, between the levels dark and bright, in the order of time.

    light: brightness at the exposures' middles. delay_s: how much later than its stamp the region
    is exposed (rolling shutter). Raises BadInput for an exposure that is longer than the period or
    a light that never changes by more than 8 times its noise.
    """
    time_s, value = light.time_s + delay_s, light.value
    if len(time_s) < 3:
        raise BadInput("light", f"{len(time_s)} frames", "expected at least 3")
    period = float(np.median(np.diff(time_s)))
    if not 0 < exposure_s <= period * 1.001:
        raise BadInput(
            "exposure", f"{exposure_s} s at {period:.4g} s a frame", "expected more than 0, at most a period"
        )
    middle = (value.min() + value.max()) / 2
    dark, bright = np.median(value[value < middle]), np.median(value[value >= middle])
    noise = 1.4826 * float(np.median(np.abs(value - np.where(value < middle, dark, bright))))
    noise = max(noise, 0.02)  # the mean of a region of whole grey levels
    if not bright - dark > 8 * noise:
        raise BadInput("light", f"changes by {bright - dark:.2f} grey at noise {noise:.2f}", "expected a flash")
    share, doubt = (value - dark) / (bright - dark), DOUBT * noise / (bright - dark)
    state = np.where(share < doubt, 0, np.where(share > 1 - doubt, 1, -1))  # -1: while it changes
    found, before = [], -1
    for at in np.flatnonzero(state >= 0):
        if before >= 0 and state[at] != state[before] and at - before <= 2:
            found.append(_flash(Signal(time_s, share, "1"), (before, int(at)), exposure_s, noise / (bright - dark)))
        before = int(at)
    return found


def _flash(light: Signal, between: tuple[int, int], exposure_s: float, noise: float) -> Flash:
    """Return the step between the last frame at one level and the first at the other; light from 0 to 1."""
    time_s, share, (before, after) = light.time_s, light.value, between
    rises = bool(share[after] > share[before])
    sigma = max(noise * exposure_s, 1e-6)
    unseen = exposure_s / 2 - DOUBT * noise * exposure_s  # a step so near an exposure's end is lost in its noise
    earliest, latest = float(time_s[before] + unseen), float(time_s[after] - unseen)
    if after - before == 1:
        return Flash(earliest, latest, sigma, rises)
    partial = share[before + 1] if rises else 1 - share[before + 1]
    moment = time_s[before + 1] + exposure_s / 2 - partial * exposure_s
    return Flash(float(moment), float(moment), sigma, rises)


def of_known_length(steps: list[Flash], lit_s: float, *, tolerance_s: float = 1e-5) -> list[Flash]:
    """Return the moments a light came on, knowing that it went off lit_s later, to tolerance_s.

    Each is where the pause it came on in, and that it went off in less lit_s, overlap. Steps without
    a partner are left as they are. Raises BadInput where a light was on for another time.
    """
    found, waiting = [], list(steps)
    while waiting:
        on = waiting.pop(0)
        if not on.rises or not waiting or waiting[0].rises:
            found.append(on)
            continue
        off = waiting.pop(0)
        low, high = off.first_s - lit_s, off.last_s - lit_s
        shifted = Flash(low, high, float(np.hypot(off.sigma_s, tolerance_s)), rises=True)
        if max(low - on.last_s, on.first_s - high) > DOUBT * (on.sigma_s + shifted.sigma_s):
            least, most = off.first_s - on.last_s, off.last_s - on.first_s
            raise BadInput(
                f"light at {on.first_s:.3f} s", f"was on for {least:.4f} to {most:.4f} s", f"expected {lit_s:g} s"
            )
        found.append(_overlap(on, shifted))
    return found


def _overlap(one: Flash, other: Flash) -> Flash:
    """Return one moment as two observations tell it: each timed, or somewhere in a pause."""
    timed = [flash for flash in (one, other) if flash.first_s == flash.last_s]
    if not timed:
        sigma = max(one.sigma_s, other.sigma_s)
        return Flash(max(one.first_s, other.first_s), min(one.last_s, other.last_s), sigma, rises=True)
    trust = np.array([flash.sigma_s**-2 for flash in timed])
    moment = float(trust @ [flash.first_s for flash in timed] / trust.sum())
    return Flash(moment, moment, float(trust.sum() ** -0.5), rises=True)


def offset(first: list[Flash], other: list[Flash], *, search_s: float = 0.25) -> Offset:
    """Return the offset between two clocks from the steps of light that both saw.

    Each pair of steps says that the offset is the difference of two moments, each equally likely
    anywhere in its own pause: its density is a trapezoid, blurred by the noise. The product of all
    pairs' densities is the offset's, exactly so when the light's moments are unrelated to the
    frames. search_s: the clocks agree to this already, and steps of one kind are farther apart.
    Raises BadInput when no steps pair, DidNotConverge when no offset explains all of them.
    """
    pairs = [
        (one, two)
        for one in first
        for two in other
        if one.rises == two.rises and abs(_middle(one) - _middle(two)) < search_s
    ]
    if not pairs:
        raise BadInput("flashes", f"{len(first)} and {len(other)} steps of light, no two within {search_s} s")
    ends = [(a.first_s - b.last_s, a.last_s - b.first_s, 6 * np.hypot(a.sigma_s, b.sigma_s)) for a, b in pairs]
    low, high = max(e[0] - e[2] for e in ends), min(e[1] + e[2] for e in ends)
    if not low < high:
        raise DidNotConverge(f"{len(pairs)} steps of light ask for offsets above {low:.6f} s and below {high:.6f} s")
    grid = np.linspace(low, high, STEPS)
    with np.errstate(divide="ignore"):
        density = sum(np.log(_density(grid, a, b)) for a, b in pairs)
    weight = np.exp(density - np.max(density))
    weight /= weight.sum()
    mean = float(weight @ grid)
    total = np.cumsum(weight)
    least, most = np.interp([(1 - SHARE) / 2, (1 + SHARE) / 2], total, grid)
    return Offset(mean, float(np.sqrt(weight @ (grid - mean) ** 2)), float(least), float(most), len(pairs))


def _middle(flash: Flash) -> float:
    return (flash.first_s + flash.last_s) / 2


def _density(grid: Array, one: Flash, other: Flash) -> Array:
    """Return the density of one moment minus the other: two boxes and a Gaussian, convolved.

    The second antiderivative of the Gaussian, s (z F(z) + f(z)), at the four corners.
    """
    blur = float(np.hypot(one.sigma_s, other.sigma_s))
    a = max(one.last_s - one.first_s, blur / 100) / 2
    b = max(other.last_s - other.first_s, blur / 100) / 2
    centred = grid - (_middle(one) - _middle(other))

    def ramp(x: Array) -> Array:
        z = x / blur
        return np.asarray(blur * (z * ndtr(z) + np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi)))

    corners = ramp(centred + a + b) - ramp(centred + a - b) - ramp(centred - a + b) + ramp(centred - a - b)
    return np.maximum(corners, 1e-300) / (4 * a * b)


def offset_of_motion(first: Signal, other: Signal, *, search_s: float = 0.25) -> Offset:
    """Return the offset between the clocks of two cameras that measured one motion, as a twist.

    The best cross-correlation of `first` with a cubic spline through `other` within +-search_s,
    refined by Gauss-Newton on offset, gain and shift; its deviation is from the residuals and the
    motion's speed. Samples that are NaN are left out. Raises BadInput for too few samples or no
    motion.
    """
    a, b = (_seen(signal) for signal in (first, other))
    spline = CubicSpline(b.time_s, b.value)
    inside = (a.time_s > b.time_s[0] + search_s) & (a.time_s < b.time_s[-1] - search_s)
    time_s, value = a.time_s[inside], a.value[inside]
    if len(time_s) < 10 or not np.ptp(value) > 0:
        raise BadInput("motion", f"{len(time_s)} common samples", "expected at least 10, and a motion")
    step = float(np.median(np.diff(b.time_s))) / 2
    lags = np.arange(-np.ceil(search_s / step), np.ceil(search_s / step) + 1) * step
    lag = float(lags[np.argmax([np.corrcoef(value, spline(time_s - lag))[0, 1] for lag in lags])])
    for _ in range(20):
        moved = spline(time_s - lag)
        columns = np.stack([-spline(time_s - lag, 1), moved, np.ones_like(moved)], axis=1)
        weights, *_ = np.linalg.lstsq(columns[:, 1:], value, rcond=None)
        columns[:, 0] *= weights[0]
        residual = value - columns[:, 1:] @ weights
        change = np.linalg.lstsq(columns, residual, rcond=None)[0]
        lag += float(change[0])
        if abs(change[0]) < 1e-9:
            break
    spread = np.linalg.inv(columns.T @ columns)[0, 0] * (residual @ residual) / (len(value) - 3)
    sigma = float(np.sqrt(spread))
    return Offset(lag, sigma, lag - 1.96 * sigma, lag + 1.96 * sigma, len(value))


def _seen(signal: Signal) -> Signal:
    kept = np.isfinite(signal.value)
    if kept.sum() < 10:
        raise BadInput(signal.name, f"{int(kept.sum())} samples with a marker", "expected at least 10")
    return Signal(signal.time_s[kept], signal.value[kept], signal.unit, name=signal.name)


def on_clock(signal: Signal, found: Offset) -> Signal:
    """Return the other camera's signal with its times on the first one's clock."""
    return Signal(signal.time_s + found.offset_s, signal.value, signal.unit, note=signal.note, name=signal.name)
