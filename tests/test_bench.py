"""The simulated bench does what its scene says, and says that it is simulated."""

from pathlib import Path

import numpy as np
import pytest

from catheter.bench import ML, Bench, Noise, Plant, Schedule, command_v, simulate
from catheter.lab.record import record
from catheter.lab.scene import Scene
from data.errors import BadInput
from data.recording import Recording
from sysid.hysteresis import loops, stop

QUIET = Noise(volume=0.0, pressure=0.0, force=0.0, volume_step=1e-15, pressure_step=1e-6, force_step=1e-9)
SHIPPED = Path(__file__).parents[1] / "data" / "recordings" / "bender.mcap"


def test_the_shipped_recording_is_made_by_its_scene_byte_for_byte(tmp_path: Path) -> None:
    record(Scene.load("bender"), tmp_path / "bender.mcap")
    assert (tmp_path / "bender.mcap").read_bytes() == SHIPPED.read_bytes()
    assert SHIPPED.stat().st_size <= 1_000_000


def test_the_shipped_recording_says_it_is_simulated_and_holds_its_truth() -> None:
    with Recording(SHIPPED) as recording:
        assert recording.kind == "simulated"
        assert all("simulated" in channel.topic.note for channel in recording.channels.values())
        assert recording.metadata["truth"]["plant.cubic"] == "0.000788"
        assert Scene.parse(recording.scene, "scene") == Scene.load("bender")


def test_the_chirp_sweeps_the_published_frequencies() -> None:
    schedule = Schedule(chirp=1800.0, chirp_from=0.01, chirp_to=5.0)
    step = 1e-4
    for at, frequency in ((step, 0.01), (900.0, 0.01 * 500**0.5), (1799.9, 5.0)):
        phase = [np.arcsin(command_v(schedule, at + d)[0] / 4.71) for d in (-step, step)]
        slope = abs(phase[1] - phase[0]) / (2 * step) / (2 * np.pi)
        assert slope == pytest.approx(frequency, rel=2e-3)


def test_the_piston_moves_its_stroke_slowly_and_about_a_millilitre_fast() -> None:
    slow = simulate(Schedule(levels=0, chirp=200, chirp_from=0.01, chirp_to=0.01), Bench(), Plant(), QUIET)
    fast = simulate(Schedule(levels=0, chirp=60, chirp_from=5.0, chirp_to=5.0), Bench(), Plant(), QUIET)
    assert np.ptp(slow.volume_m3) == pytest.approx(29.06 * ML, rel=0.01)
    assert 0.3 * ML < np.ptp(fast.volume_m3[-800:]) < 2 * ML


def test_force_is_the_published_polynomial_plus_the_slipping_springs() -> None:
    plant = Plant()
    run = simulate(Schedule(levels=3, chirp=0.0), Bench(), plant, QUIET)
    x = run.volume_m3 / ML
    static = 7.88e-4 * x**3 + 3.47e-3 * x**2 + 1.22e-2 + stop(x, plant.slip_ml) @ np.array(plant.stiffness)
    inertia = run.force_n - static
    assert (inertia > -1e-8).all()  # a square cannot be negative
    assert np.median(inertia) < 1e-4  # and the piston mostly moves evenly


def test_energy_lost_in_a_cycle_is_what_the_springs_lose() -> None:
    plant = Plant()
    run = simulate(Schedule(levels=4, chirp=0.0), Bench(), plant, QUIET)
    last = loops(run.volume_m3 / ML, run.force_n)[-1]
    swing = last.x_high - last.x_low
    lost = sum(2 * r * k * (swing - 2 * r) for r, k in zip(plant.slip_ml, plant.stiffness, strict=True))
    assert last.area == pytest.approx(lost, rel=0.02)  # the rest: inertia while the piston turns


def test_noise_has_its_stated_size() -> None:
    schedule, noise = Schedule(levels=2, chirp=0.0), Noise()
    noisy = simulate(schedule, Bench(), Plant(), noise)
    clean = simulate(schedule, Bench(), Plant(), QUIET)
    for one, other, sigma, step in (
        (noisy.force_n, clean.force_n, noise.force, noise.force_step),
        (noisy.volume_m3, clean.volume_m3, noise.volume, noise.volume_step),
        (noisy.pressure_pa, clean.pressure_pa, noise.pressure, noise.pressure_step),
    ):
        assert np.std(one - other) == pytest.approx(np.hypot(sigma, step / 12**0.5), rel=0.05)


def test_halving_the_step_changes_the_motion_to_first_order_only() -> None:
    schedule = Schedule(levels=1, chirp=10.0)
    runs = [simulate(schedule, Bench(), Plant(), QUIET, substeps=n).volume_m3 for n in (12, 24, 96)]
    coarse, fine = (np.abs(run - runs[2]).max() for run in runs[:2])
    assert coarse < 0.02 * ML
    assert coarse / fine == pytest.approx((1 / 12 - 1 / 96) / (1 / 24 - 1 / 96), rel=0.3)


@pytest.mark.parametrize(
    ("schedule", "plant", "found"),
    [
        (Schedule(levels=0, chirp=0.0), Plant(), "0 s at 83 Hz"),
        (Schedule(chirp=1e9), Plant(), "expected at least 2 samples"),
        (Schedule(chirp_to=60.0), Plant(), "at most half of 83 Hz"),
        (Schedule(), Plant(slip_ml=(1.0,)), "give as many"),
        (Schedule(), Plant(slip_ml=(0.0, 1.0, 2.0)), "> 0"),
    ],
)
def test_impossible_runs_are_refused(schedule: Schedule, plant: Plant, found: str) -> None:
    with pytest.raises(BadInput, match=found):
        simulate(schedule, Bench(), plant, QUIET)
