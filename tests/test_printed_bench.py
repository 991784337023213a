"""The simulated twist experiment: what cameras, light and gauge recorded leads back to the truth."""

from pathlib import Path

import numpy as np
import pytest

from catheter.lab.record import record
from catheter.lab.scene import Scene
from catheter.printed_bench import LED, Cameras, PrintedRun
from data.errors import BadInput
from data.recording import Recording
from vision.clock import Flash, brightness, flashes, of_known_length, offset
from vision.frames import Frame, open_source
from vision.side import side
from vision.twist import Tracker, assemble, rows

SCENE = """
[scene]
kind = "printed"
title = "a small tube"
[tube]
divisions = [8, 8, 1]
voxels = [8, 8]
[map]
pattern = "helix"
period = 4
width = 1
[ramp]
most = "40 kPa"
time = "3 s"
wait = "1 s"
[cameras]
flashes = ["0.237 s", "4.311 s"]
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, PrintedRun]:
    path = tmp_path_factory.mktemp("bench") / "twist.mcap"
    run = record(Scene.parse(SCENE, "test"), path)
    assert isinstance(run, PrintedRun)
    return path, run


def film(path: Path, camera: str) -> list[Frame]:
    return list(open_source(path, topic=f"/camera/{camera}").frames())


def test_the_recording_says_that_it_is_simulated_and_holds_its_truth(recorded: tuple[Path, PrintedRun]) -> None:
    path, run = recorded
    with Recording(path) as recording:
        assert recording.kind == "simulated"
        assert {"/pressure", "/led", "/camera/top", "/camera/side"} == set(recording.channels)
        assert recording.metadata["truth"]["print.soft"] == "1.05"
        pressure = recording.signal("/pressure")
    exact = run.ramp.at(pressure.time_s)
    spread = np.std((pressure.value - exact) / np.hypot(run.gauge.share * exact, run.gauge.floor))
    assert spread == pytest.approx(1.0, abs=0.15)  # 250 samples


@pytest.mark.parametrize(("camera", "shift_s"), [("top", 0.0371), ("side", -0.0524)])
def test_the_light_tells_each_cameras_clock(recorded: tuple[Path, PrintedRun], camera: str, shift_s: float) -> None:
    path, run = recorded
    times, states = run.led
    bench = [Flash(t, t, 1e-5, bool(on)) for t, on in zip(times[1:].tolist(), states[1:], strict=True)]
    seen = flashes(brightness(film(path, camera), LED), run.cameras.exposure)
    found = offset(*(of_known_length(steps, run.cameras.lit) for steps in (bench, seen)))
    assert found.low_s - 2 * found.sigma_s <= shift_s <= found.high_s + 2 * found.sigma_s
    assert found.sigma_s < 0.02


def test_marker_and_outline_give_twist_and_extension_back(recorded: tuple[Path, PrintedRun]) -> None:
    path, run = recorded
    top = assemble(list(rows(film(path, "top"), Tracker())))
    truth = run.twist(top.time_s + run.cameras.top_offset)
    assert abs(truth[-1]) > np.radians(3)  # it twists
    wrong = -top.angle_rad - (truth - truth[0])  # the camera looks against the axis: its sense is the other one
    assert np.abs(wrong).max() < 6 * np.median(top.sigma_rad) * np.sqrt(2)
    tips = [
        (frame.time_s, side(frame.picture).extension_px) for frame in film(path, "side") if frame.picture is not None
    ]
    time_s, tip_px = np.array(tips).T
    expected = 1e3 * run.extension(time_s + run.cameras.side_offset)
    moved = 1e3 * (tip_px - tip_px[0]) / run.cameras.scale
    assert moved == pytest.approx(expected - expected[0], abs=0.01)  # mm: a twentieth of a pixel


def test_an_exposure_is_no_longer_than_a_period() -> None:
    with pytest.raises(BadInput, match="a period at most"):
        Cameras(exposure=0.2)
