"""The study of two clocks: simulated cameras that see one light or one motion, each by its own."""

import math
import time
from collections.abc import Callable, Iterator

import numpy as np

from catheter.lab.report import Progress, Report, Row
from data.signal import Array, Signal
from vision.clock import Offset, brightness, flashes, of_known_length, offset, offset_of_motion
from vision.frames import Frame

PERIOD_S, EXPOSURE_S = 1 / 30, 0.010
REGION = (2, 2, 4, 4)
FLASH_S = 0.25  # seven periods and a half


def light_frames(
    times_s: Array, stamps_s: Array, lit_s: Array, draw: np.random.Generator, exposure_s: float = EXPOSURE_S
) -> Iterator[Frame]:
    """Yield small pictures of a light that is on between the pairs lit_s (n, 2), exposed around times_s.

    stamps_s: what the camera's own clock says of these times. Noise of 2 grey levels.
    """

    def lit_until(moment: Array) -> Array:
        return np.asarray(np.clip(moment[:, None] - lit_s[:, 0], 0, lit_s[:, 1] - lit_s[:, 0]).sum(axis=1))

    share = (lit_until(times_s + exposure_s / 2) - lit_until(times_s - exposure_s / 2)) / exposure_s
    for number, (stamp, value) in enumerate(zip(stamps_s, share, strict=True)):
        grey = np.full((8, 8), 30.0)
        grey[2:6, 2:6] += 190 * value
        noisy = np.clip(np.rint(grey + draw.normal(0, 2, grey.shape)), 0, 255).astype(np.uint8)
        yield Frame(number, float(stamp), noisy)


def _times(count: int, draw: np.random.Generator) -> Array:
    return np.asarray(draw.uniform(0, PERIOD_S) + PERIOD_S * np.arange(count), np.float64)


def _lights(
    lit_s: Array, duration_s: float, draw: np.random.Generator, known_s: float | None = None
) -> tuple[Offset, float]:
    truth, seen = draw.uniform(-0.1, 0.1), []
    for shift in (0.0, truth):
        times = _times(round(duration_s / PERIOD_S), draw)
        steps = flashes(brightness(light_frames(times, times - shift, lit_s, draw), REGION), EXPOSURE_S)
        seen.append(steps if known_s is None else of_known_length(steps, known_s))
    return offset(*seen), truth


def _known_flash(draw: np.random.Generator) -> tuple[Offset, float]:
    on = draw.uniform(1, 2)
    return _lights(np.array([[on, on + FLASH_S]]), 3.0, draw, FLASH_S)


def _flash(draw: np.random.Generator) -> tuple[Offset, float]:
    on = draw.uniform(1, 2)
    return _lights(np.array([[on, on + draw.uniform(0.25, 0.3)]]), 3.0, draw)


def _train(draw: np.random.Generator) -> tuple[Offset, float]:
    on = 0.5 + np.cumsum(draw.uniform(0.6, 1.4, 58))
    on = on[on < 59]
    return _lights(np.stack([on, on + FLASH_S], axis=1), 60.0, draw, FLASH_S)


def _motion(draw: np.random.Generator) -> tuple[Offset, float]:
    truth, seen = draw.uniform(-0.1, 0.1), []
    for shift, gain in ((0.0, 1.0), (truth, 1.07)):
        times = _times(1800, draw)
        angle = 0.5 * np.sin(2 * np.pi * 0.2 * times) + 0.1 * np.sin(2 * np.pi * 0.73 * times + 1)
        seen.append(Signal(times - shift, gain * angle + draw.normal(0, 2e-4, len(times)), "rad", name="twist"))
    return offset_of_motion(*seen), truth


CASES: dict[str, Callable[[np.random.Generator], tuple[Offset, float]]] = {
    "one flash of 250 ms": _known_flash,
    "one flash of unknown length": _flash,
    "such flashes at random times for 60 s": _train,
    "the twist itself, 60 s": _motion,
}


def tried(case: Callable[[np.random.Generator], tuple[Offset, float]], seeds: int) -> tuple[Array, int, float]:
    """Return a case's errors [s], how often the interval held the truth, and the seconds it all took."""
    errors, inside, started = [], 0, time.perf_counter()
    for seed in range(seeds):
        found, truth = case(np.random.default_rng(seed))
        errors.append(found.offset_s - truth)
        inside += found.low_s <= truth <= found.high_s
    return np.array(errors), inside, time.perf_counter() - started


def camera_clock(quick: bool, progress: Progress) -> Report:
    """The offset of two cameras' clocks from a flash, a blinking light and the twist itself."""
    seeds = 40 if quick else 200
    rows, notes = [], []
    for at, (name, case) in enumerate(CASES.items()):
        errors, inside, seconds = tried(case, seeds)
        rms = math.sqrt(float(np.mean(np.square(errors))))
        rows.append(Row(method=name, level=f"{seeds}", error=rms, seconds=seconds / seeds))
        third = float(np.mean(np.abs(errors) < 1 / 90))
        notes.append(
            f"{name}: rms {1e3 * rms:.3f} ms, worst {1e3 * np.abs(errors).max():.3f} ms, {100 * third:.1f} % within a "
            f"third of a frame; the 95 % interval holds the truth in {inside} of {seeds}{_band(seeds)}."
        )
        progress((at + 1) / len(CASES))
    notes.append(
        "Exposure: a step inside it is timed by the brightness of one frame; one in the pause (period - exposure) is "
        "not seen, and is known to that pause. Rolling shutter: the region's rows are exposed row / rows x readout "
        "later; without that delay the offset is wrong by the difference of the two cameras' delays."
    )
    return Report(
        name="camera-clock",
        title="Offset of two cameras' clocks, 30 frames/s, exposure 10 ms, global shutter (simulated)",
        level="seeds",
        error="rms error, s",
        rows=rows,
        notes=notes,
    )


def _band(seeds: int) -> str:
    from scipy.stats import binom

    low, high = binom.interval(0.99, seeds, 0.95)
    return f" (99 % band {low:.0f} to {high:.0f})"
