"""Excitations are what the thesis prints, and the actuator follows them within its limits."""

from pathlib import Path

import numpy as np
import pytest

from catheter.actuator import AREA_M2, ML, STROKE_M, Servo, move
from data.errors import BadInput, CannotWrite
from sysid.excitation import Chirp, Ramp, Sine, Staircase, Steps, sample_times, write_pwm_csv


def test_the_chirp_is_equation_3_25() -> None:
    chirp = Chirp()
    time_s = sample_times(chirp, 83.0)
    assert len(time_s) == 149_400
    length = 1800 / np.log(5 / 0.01)
    exact = 4.71 * np.sin(2 * np.pi * 0.01 * length * (np.exp(time_s / length) - 1))
    assert chirp.volts(time_s) == pytest.approx(exact, abs=1e-9)
    slope = np.gradient(chirp.phase(time_s), time_s)[1:-1] / (2 * np.pi)
    assert slope == pytest.approx(chirp.frequency_hz(time_s)[1:-1], rel=1e-4)  # of differences over 12 ms
    assert chirp.frequency_hz(np.array([0.0, 1800.0])) == pytest.approx([0.01, 5.0])
    same = Chirp(start=1.0, end=1.0, duration_s=10.0)
    assert same.volts(np.array([0.25])) == pytest.approx([4.71])


def test_ramp_and_staircase_rise_by_47_millivolts() -> None:
    ramp, stairs = Ramp(), Staircase()
    assert ramp.volts(np.array([0.0, 7.99, 8.0, 16.0])) == pytest.approx([0.047, 0.047, 0.094, 0.141])
    assert ramp.levels == stairs.levels == 101  # 4.71 V is no whole number of steps: the last is shorter
    assert ramp.volts(np.array([100.5 * 8])) == pytest.approx([4.71])
    assert stairs.volts(np.array([0.0, 11.9, 12.0, 14.9, 15.0])) == pytest.approx([0.047, 0.047, -4.71, -4.71, 0.094])
    assert stairs.duration_s == 101 * 15


def test_sine_starts_and_ends_at_rest_and_steps_return() -> None:
    sine, steps = Sine(cycles=3), Steps(most=2.0, levels=4)
    assert sine.volts(np.array([0.0, 5.0, 10.0])) == pytest.approx([0.0, 4.71, 0.0], abs=1e-12)
    time_s = sample_times(steps, 1000.0)
    assert np.sum(steps.volts(time_s)) / 1000 == pytest.approx(0, abs=1e-6)  # out as far as back
    assert set(np.round(np.unique(steps.volts(time_s)), 9)) == {-2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0}
    for one in (sine, steps, Chirp(), Ramp()):
        assert one.volts(np.array([-1.0, one.duration_s])).tolist() == [0.0, 0.0]


def test_the_table_for_the_arduino_plays_the_same_signal(tmp_path: Path) -> None:
    stairs = Staircase(most=0.47)
    rows = write_pwm_csv(tmp_path / "pwm.csv", stairs, rate_hz=100.0)
    table = np.loadtxt(tmp_path / "pwm.csv", delimiter=",", skiprows=1)
    assert (tmp_path / "pwm.csv").read_text().startswith("time_s,pwm\n")
    assert len(table) == rows
    time_s = sample_times(stairs, 100.0)
    played = table[np.searchsorted(table[:, 0], time_s + 1e-9, side="right") - 1, 1] * 5 / 255
    assert np.abs(played - stairs.volts(time_s)).max() <= 5 / 255 / 2 + 1e-12  # half a count
    with pytest.raises(CannotWrite):
        write_pwm_csv(tmp_path / "pwm.csv", stairs, rate_hz=100.0)
    with pytest.raises(BadInput, match="the supply gives 3 V"):
        write_pwm_csv(tmp_path / "other.csv", Chirp(), rate_hz=83.0, supply_v=3.0)


def test_what_cannot_be_sampled_is_refused() -> None:
    with pytest.raises(BadInput, match="at most half of 8 Hz"):
        sample_times(Chirp(), 8.0)
    with pytest.raises(BadInput, match="expected 2 to"):
        sample_times(Chirp(duration_s=1e9), 83.0)


def test_the_piston_moves_its_stroke_slowly_and_about_a_millilitre_fast_within_its_limits() -> None:
    servo = Servo()
    slow = move(servo, Chirp(start=0.01, end=0.01, duration_s=200.0), 83.0)
    fast = move(servo, Chirp(start=5.0, end=5.0, duration_s=20.0), 83.0)
    assert np.ptp(slow.place_m) == pytest.approx(STROKE_M, rel=0.01)
    assert 0.8 < np.ptp(fast.volume_m3[-800:]) / ML < 1.6
    for run in (slow, fast):
        assert np.abs(run.speed_m_s).max() <= servo.speed * 1.15  # the force lags, so a turn overshoots
        assert np.abs(run.acceleration_m_s2).max() <= servo.acceleration * 1.01
        moved = np.cumsum((run.speed_m_s[1:] + run.speed_m_s[:-1]) / 2) / 83.0  # speed is the place's derivative
        assert run.place_m[1:] - run.place_m[0] == pytest.approx(moved, abs=0.01 * STROKE_M)
    assert pytest.approx(5.720e-4, rel=1e-3) == AREA_M2
    assert pytest.approx(29.06 * ML, rel=1e-3) == STROKE_M * AREA_M2


def test_halving_the_step_halves_the_error() -> None:
    chirp = Chirp(start=0.5, end=5.0, duration_s=20.0)
    runs = [move(Servo(step=step), chirp, 83.0).place_m for step in (4e-4, 2e-4, 2.5e-5)]
    coarse, fine = (np.abs(run - runs[2]).max() for run in runs[:2])
    assert coarse / fine == pytest.approx((4 - 0.25) / (2 - 0.25), rel=0.25)  # first order
    assert fine < 2e-4 * STROKE_M  # at twice the default step, after 15 s


def test_small_commands_are_followed_with_the_stated_bandwidth() -> None:
    small = Chirp(amplitude=0.05, start=5.0, end=5.0, duration_s=10.0)
    moved = move(Servo(lag=1e-3, rise=1e-3), small, 400.0).place_m[-2000:]
    asked = STROKE_M / 2 * 0.05 / 4.71
    assert np.ptp(moved) / 2 / asked == pytest.approx(0.5**0.5, rel=0.08)  # 3 dB down, but for the speed's own lag
