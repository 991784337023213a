"""The simulated twist experiment: what cameras, light and gauge recorded leads back to the truth."""

import json
from pathlib import Path

import numpy as np
import pytest

from catheter.filmed import Filmed
from catheter.lab import cli
from catheter.lab.record import record
from catheter.lab.scene import Scene
from catheter.printed_bench import Cameras, PrintedRun
from data.errors import BadInput
from data.recording import Recording

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
    found = Filmed(path, run.cameras).clock(camera)
    assert found.low_s - 2 * found.sigma_s <= shift_s <= found.high_s + 2 * found.sigma_s
    assert found.sigma_s < 0.02


def test_marker_and_outline_give_twist_and_extension_back(recorded: tuple[Path, PrintedRun]) -> None:
    path, run = recorded
    film = Filmed(path, run.cameras)
    at = film.twist.time_s - film.clock("top").offset_s + run.cameras.top_offset
    truth = run.twist(at)
    assert abs(truth[-1]) > np.radians(3)  # it twists
    wrong = film.twist.value - (truth - truth[0])
    assert np.abs(wrong / film.twist_sigma)[1:].max() < 5
    assert film.missing == 0
    at = film.extension.time_s - film.clock("side").offset_s + run.cameras.side_offset
    expected = run.extension(at)
    assert film.extension.value == pytest.approx(expected - expected[0], abs=1e-5)  # m: a twentieth of a pixel


def test_an_exposure_is_no_longer_than_a_period() -> None:
    with pytest.raises(BadInput, match="a period at most"):
        Cameras(exposure=0.2)


def test_a_film_drives_the_twin_and_gives_the_materials_back(
    recorded: tuple[Path, PrintedRun], capsys: pytest.CaptureFixture[str]
) -> None:
    path, _ = recorded
    scene = path.with_name("small.toml")
    scene.write_text(SCENE)
    assert cli.run(["twin", str(scene), str(path), "--json"]) == 0
    twin = json.loads(capsys.readouterr().out)
    assert twin["compared"] == 50  # frames
    assert np.radians(0.02) < twin["rmse_rad"] < np.radians(1)  # the table's materials are not those printed
    assert cli.run(["invert", str(path), "--pressure-noise", "0.0025", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["materials"]
    for name, true_pa in (("Agilus30", 0.2e6 * 1.05), ("FLX9785", 1.89e6 * 0.95)):
        low, high = found[name]["interval_pa"]
        width = high - low
        assert low - width / 2 < true_pa < high + width / 2  # twice the 95 % interval
        assert width < 0.5 * true_pa
