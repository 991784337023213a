"""Two cameras' clocks: intervals that hold the truth, moments inside an exposure told exactly."""

import numpy as np
import pytest

from catheter.lab.clock_study import CASES, EXPOSURE_S, PERIOD_S, REGION, light_frames, tried
from data.errors import BadInput, DidNotConverge
from data.signal import Signal
from vision.clock import Flash, Offset, brightness, flashes, of_known_length, offset, offset_of_motion, on_clock


def seen(lit: list[list[float]], phase: float, frames: int = 60, exposure: float = EXPOSURE_S) -> list[Flash]:
    times = phase + PERIOD_S * np.arange(frames)
    made = light_frames(times, times, np.array(lit), np.random.default_rng(0), exposure)
    return flashes(brightness(made, REGION), exposure)


def test_a_step_inside_an_exposure_is_timed_and_one_in_the_pause_is_bracketed() -> None:
    moment = 10 * PERIOD_S + 0.002  # 2 ms after the middle of an exposure of 10 ms
    rise, fall = seen([[moment, moment + 0.5]], 0.0)
    assert rise.rises
    assert not fall.rises
    assert rise.first_s == rise.last_s == pytest.approx(moment, abs=5 * rise.sigma_s)
    pause = 10 * PERIOD_S + 0.015  # in the pause of 23.3 ms
    rise, _ = seen([[pause, pause + 0.5]], 0.0)
    assert rise.first_s < pause < rise.last_s
    assert rise.last_s - rise.first_s == pytest.approx(PERIOD_S - EXPOSURE_S, abs=3e-4)
    rows = flashes(Signal(np.arange(9) / 30, np.repeat([10.0, 200.0], [4, 5]), "1"), 0.01, delay_s=0.004)
    assert rows[0].first_s == pytest.approx(3 / 30 + 0.009, abs=1e-4)  # a rolling shutter's delay moves it


def test_every_interval_holds_its_moment() -> None:
    draw = np.random.default_rng(2)
    for _ in range(200):
        on = draw.uniform(0.4, 0.8)
        for flash, truth in zip(seen([[on, on + 0.4]], draw.uniform(0, PERIOD_S), 45), (on, on + 0.4), strict=True):
            assert flash.first_s - 5 * flash.sigma_s <= truth <= flash.last_s + 5 * flash.sigma_s


def test_the_offsets_density_is_that_of_two_unknown_moments() -> None:
    one, other = Flash(0.0, 0.02, 1e-6, True), Flash(0.1, 0.12, 1e-6, True)
    found = offset([one], [other])
    assert found.offset_s == pytest.approx(-0.1, abs=1e-9)
    assert found.sigma_s == pytest.approx(0.02 / np.sqrt(6), rel=1e-3)  # a triangle's deviation
    assert found.high_s - found.low_s == pytest.approx(0.04 * (1 - np.sqrt(0.05)), rel=1e-2)
    assert found.steps == 1


def test_a_flash_of_seven_periods_and_a_half_is_always_known_to_a_third_of_a_frame() -> None:
    errors, inside, _ = tried(CASES["one flash of 250 ms"], 60)
    assert np.abs(errors).max() < PERIOD_S / 3  # each camera knows it to (period / 2 - exposure) / 2 either way
    assert inside >= 51


def test_the_two_ends_of_a_flash_of_known_length_are_one_moment() -> None:
    rise, fall = Flash(0.0, 0.02, 1e-6, True), Flash(0.262, 0.262, 1e-6, False)
    assert of_known_length([rise, fall], 0.25)[0].first_s == pytest.approx(0.012)
    wide = of_known_length([rise, Flash(0.255, 0.275, 1e-6, False)], 0.25)[0]
    assert (wide.first_s, wide.last_s) == pytest.approx((0.005, 0.02))
    assert of_known_length([fall, rise], 0.25) == [fall, rise]  # the film began in the light, and ended in it
    with pytest.raises(BadInput, match=r"on for 0.2420 to 0.2620 s; expected 0.3 s"):
        of_known_length([rise, fall], 0.3)


@pytest.mark.parametrize(("case", "most_s"), [("one flash of unknown length", 0.012), ("the twist itself, 60 s", 1e-4)])
def test_offsets_and_their_intervals(case: str, most_s: float) -> None:
    errors, inside, _ = tried(CASES[case], 60)
    assert np.sqrt(np.mean(errors**2)) < most_s
    assert inside >= 51  # of 60 at 95 %: fewer come once in 1,000 runs


def test_a_blinking_light_tells_the_clocks_to_a_millisecond() -> None:
    errors, inside, _ = tried(CASES["such flashes at random times for 60 s"], 3)
    assert np.abs(errors).max() < 1e-3
    assert inside >= 2


def test_a_signal_is_put_on_the_other_clock() -> None:
    moved = on_clock(Signal(np.array([1.0, 2.0]), np.array([3.0, 4.0]), "rad"), Offset(0.25, 0.0, 0.2, 0.3, 1))
    assert moved.time_s.tolist() == [1.25, 2.25]


def test_what_shows_no_step_is_refused() -> None:
    times = np.arange(30) / 30
    with pytest.raises(BadInput, match="expected a flash"):
        flashes(Signal(times, np.random.default_rng(0).normal(100, 2, 30), "1"), 0.01)
    with pytest.raises(BadInput, match="exposure"):
        flashes(Signal(times, times, "1"), 0.05)
    with pytest.raises(BadInput, match="at least 3"):
        flashes(Signal(times[:2], times[:2], "1"), 0.01)
    rise = Flash(0.0, 0.01, 1e-6, True)
    with pytest.raises(BadInput, match="no two within"):
        offset([rise], [Flash(5.0, 5.01, 1e-6, True)])
    with pytest.raises(DidNotConverge, match="ask for offsets"):
        offset([rise, Flash(1.0, 1.01, 1e-6, False)], [Flash(0.1, 0.11, 1e-6, True), Flash(0.9, 0.91, 1e-6, False)])
    flat = Signal(times, np.zeros(30), "rad")
    with pytest.raises(BadInput, match="motion"):
        offset_of_motion(flat, flat)
    with pytest.raises(BadInput, match="with a marker"):
        offset_of_motion(Signal(times, np.full(30, np.nan), "rad"), flat)
    with pytest.raises(BadInput, match="inside"):
        brightness(light_frames(times, times, np.array([[0.1, 0.2]]), np.random.default_rng(0)), (6, 0, 4, 4))
