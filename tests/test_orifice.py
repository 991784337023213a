"""Valve coefficients and cracking pressures are found within their stated intervals."""

import numpy as np
import pytest

from catheter.actuator import AREA_M2, Servo
from catheter.bench_runs import ConeValve, PressureRamp, Sensors, ValveBench, cracking, valve
from catheter.lab.recovery import valve_signals
from data.errors import BadInput
from sysid.excitation import Steps
from sysid.orifice import fit_cracking, fit_orifice, low_pass

STEPS = Steps(most=2.355)


def test_the_filter_is_3_db_down_at_its_cutoff_and_shifts_nothing() -> None:
    time_s = np.arange(8000) / 500
    for hertz, gain in ((1.0, 1.0), (10.0, 0.5**0.5), (40.0, 0.0)):
        wave = np.sin(2 * np.pi * hertz * time_s)
        passed = low_pass(wave, 500.0, 10.0)[2000:6000]
        assert passed == pytest.approx(gain * wave[2000:6000], abs=2e-3)
    with pytest.raises(BadInput, match="sample faster"):
        low_pass(time_s, 20.0, 10.0)


@pytest.mark.parametrize("coefficient", [3.05e-7, 4.30e-8])
def test_k_is_exact_without_noise(coefficient: float) -> None:
    quiet = Sensors(volume_db=300.0, pressure_db=300.0)
    run = valve(STEPS, Servo(), ValveBench(coefficient=coefficient), quiet)
    found = fit_orifice(*valve_signals(run), area_m2=AREA_M2)
    assert found.coefficient == pytest.approx(coefficient, rel=1e-4)  # what the filter smears of the start
    assert found.strokes == 12


def test_k_is_within_one_percent_and_its_interval_honest() -> None:
    inside = 0
    for seed in range(60):
        sensors = Sensors(volume_db=34.0, pressure_db=34.0, seed=seed)
        found = fit_orifice(*valve_signals(valve(STEPS, Servo(), ValveBench(), sensors)), area_m2=AREA_M2)
        assert found.coefficient == pytest.approx(3.05e-7, rel=0.01)
        low, high = found.interval()
        inside += low <= 3.05e-7 <= high
    assert inside >= 52  # the 99 % binomial band of 0.95 in 60


@pytest.mark.parametrize(("off", "advice"), [(0.03, "tighten"), (-0.03, "loosen"), (0.01, "done"), (-0.01, "done")])
def test_the_advice_turns_the_screw_the_right_way(off: float, advice: str) -> None:
    for seed in range(10):
        sensors = Sensors(volume_db=34.0, pressure_db=34.0, seed=seed)
        run = valve(STEPS, Servo(), ValveBench(coefficient=3.05e-7 * (1 + off)), sensors)
        assert fit_orifice(*valve_signals(run), area_m2=AREA_M2).advice(3.05e-7) == advice


def test_published_fits_are_done() -> None:
    quiet = Sensors(volume_db=300.0, pressure_db=300.0)
    for target, fit, printed in ((3.05e-7, 3.02e-7, -0.0104), (4.30e-8, 4.26e-8, -0.0084)):
        found = fit_orifice(*valve_signals(valve(STEPS, Servo(), ValveBench(coefficient=fit), quiet)), area_m2=AREA_M2)
        assert found.deviation(target) == pytest.approx(printed, abs=0.0012)  # K is printed to three digits
        assert found.advice(target) == "done"


def test_a_bench_without_strokes_is_refused() -> None:
    time_s = np.arange(2000) / 83
    with pytest.raises(BadInput, match="0 usable strokes"):
        fit_orifice(time_s, np.sin(time_s), time_s, np.zeros(2000), area_m2=AREA_M2)


@pytest.mark.parametrize("name", ["30 deg, 0.075 in", "50 deg, 0.100 in"])
def test_cracking_pressures_both_ways_within_two_percent_and_their_intervals(name: str) -> None:
    inside = 0
    for seed in range(12):
        run = cracking(PressureRamp(), ConeValve(valve=name), Sensors(rate=500.0, seed=seed))
        found = fit_cracking(run.signals["/pressure", "pressure"], run.signals["/flow", "flow"])
        assert [one.direction for one in found] == ["forward", "reverse"]
        for one in found:
            limit = float(run.truth[f"valve.{one.direction}"].split()[0])
            assert one.pressure_pa == pytest.approx(limit, rel=0.02)
            inside += one.low_pa <= limit <= one.high_pa
    assert inside >= 19  # the 99 % binomial band of 0.95 in 24


@pytest.mark.parametrize("opening", ["jump", "line"])
def test_other_ways_to_open_are_found_too(opening: str) -> None:
    draw = np.random.default_rng(4)
    pressure = np.linspace(0, 4e4, 30_000)
    past = pressure - 2.2e4
    flow = np.where(past > 0, 1e-6 if opening == "jump" else 1e-10 * past, 0.0) + 5e-8
    noisy = flow + 5e-8 * draw.normal(size=30_000)
    (found,) = fit_cracking(pressure + 100 * draw.normal(size=30_000), noisy)
    assert found.pressure_pa == pytest.approx(2.2e4, rel=0.02)
    assert found.low_pa <= 2.2e4 <= found.high_pa


def test_ramps_without_a_first_flow_are_refused() -> None:
    draw = np.random.default_rng(5)
    pressure = np.linspace(0, 4e4, 30_000)
    with pytest.raises(BadInput, match="never leaves its zero"):
        fit_cracking(pressure, draw.normal(size=30_000))
    with pytest.raises(BadInput, match="ramp it slowly"):
        fit_cracking(np.ones(100), np.ones(100))
    with pytest.raises(BadInput, match="flows from the start"):
        fit_cracking(pressure, 1e-10 * pressure)
