"""Simulated cameras that see one light or one motion, each by its own clock."""

import time
from collections.abc import Callable, Iterator

import numpy as np

from data.signal import Array, Signal
from vision.clock import Offset, brightness, flashes, offset, offset_of_motion
from vision.frames import Frame

PERIOD_S, EXPOSURE_S = 1 / 30, 0.010
REGION = (2, 2, 4, 4)


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


def _lights(lit_s: Array, duration_s: float, draw: np.random.Generator) -> tuple[Offset, float]:
    truth, seen = draw.uniform(-0.1, 0.1), []
    for shift in (0.0, truth):
        times = draw.uniform(0, PERIOD_S) + PERIOD_S * np.arange(round(duration_s / PERIOD_S))
        seen.append(flashes(brightness(light_frames(times, times - shift, lit_s, draw), REGION), EXPOSURE_S))
    return offset(*seen), truth


def _flash(draw: np.random.Generator) -> tuple[Offset, float]:
    on = draw.uniform(1, 2)
    return _lights(np.array([[on, on + draw.uniform(0.25, 0.3)]]), 3.0, draw)


def _train(draw: np.random.Generator) -> tuple[Offset, float]:
    steps = 0.5 + np.cumsum(draw.uniform(0.3, 0.7, 116))
    return _lights(steps[steps < 59.5][: int((steps < 59.5).sum()) // 2 * 2].reshape(-1, 2), 60.0, draw)


def _motion(draw: np.random.Generator) -> tuple[Offset, float]:
    truth, seen = draw.uniform(-0.1, 0.1), []
    for shift, gain in ((0.0, 1.0), (truth, 1.07)):
        times = draw.uniform(0, PERIOD_S) + PERIOD_S * np.arange(1800)
        angle = 0.5 * np.sin(2 * np.pi * 0.2 * times) + 0.1 * np.sin(2 * np.pi * 0.73 * times + 1)
        seen.append(Signal(times - shift, gain * angle + draw.normal(0, 2e-4, len(times)), "rad", name="twist"))
    return offset_of_motion(*seen), truth


CASES: dict[str, Callable[[np.random.Generator], tuple[Offset, float]]] = {
    "one flash of a light": _flash,
    "a light blinking at random for 60 s": _train,
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
