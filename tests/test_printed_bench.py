"""The simulated twist experiment: what cameras, light and gauge recorded leads back to the truth."""

import io
import json
import pickle
import shutil
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import ROOT
from rerun.chunk import RrdReader

from catheter.design_loop import DesignLoop, Specimen
from catheter.error_map import error_map
from catheter.filmed import Filmed
from catheter.inflatable import Pattern, drawn
from catheter.lab import cli
from catheter.lab.record import record, with_map
from catheter.lab.scene import Scene, recorded_scene
from catheter.printed_bench import Cameras, PrintedRun
from catheter.reconstruction import Wanted, tube_case
from data.errors import BadInput, CannotWrite, CatheterError, DamagedRecording, DidNotConverge
from data.recording import Recording
from fem.voxel_map import Sizes, VoxelMap, load_map, write_map

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


def dashboard(path: Path) -> tuple[list[str], dict[str, np.ndarray]]:
    """Return the names of a dashboard's views, and when each of its entities was logged [ns]."""
    reader = RrdReader(path)
    names, times = [], {}
    for chunk in reader.stream(store=reader.blueprints()[0]):
        batch = chunk.to_record_batch()
        if "ViewBlueprint:display_name" in batch.schema.names:
            names += [name for (name,) in batch.column("ViewBlueprint:display_name").to_pylist()]
    for chunk in reader.stream(store=reader.recordings()[0]):
        batch = chunk.to_record_batch()
        if "t" in batch.schema.names:
            stamps = np.asarray(batch.column("t").cast("int64"))
            entity = str(chunk.entity_path)
            times[entity] = np.union1d(times.get(entity, stamps), stamps)
    return names, times


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, PrintedRun]:
    path = tmp_path_factory.mktemp("bench") / "twist.mcap"
    run = record(Scene.parse(SCENE, "test"), path)
    assert isinstance(run, PrintedRun)
    return path, run


@pytest.fixture(scope="module")
def again(recorded: tuple[Path, PrintedRun]) -> tuple[Path, PrintedRun]:
    """A second actuator, printed from a map of its own."""
    path = recorded[0].with_name("again.mcap")
    scene = SCENE.replace("[map]", "[print]\nsoft = 1.01\nstiff = 1.02\n[gauge]\nseed = 7\n[map]")
    tables = Scene.parse(scene, "test").tables
    stiff = tables["map"].stiff_voxels(8, 8)
    stiff[0, 1] = True
    made = VoxelMap(title="t", sizes=Sizes(), materials=("FLX9785", "Agilus30"), voxels=np.where(stiff, 0, 1))
    write_map(made, path.with_name("map.toml"))
    run = record(with_map(Scene.parse(scene, "test"), str(path.with_name("map.toml"))), path)
    assert isinstance(run, PrintedRun)
    return path, run


@pytest.fixture(scope="module")
def looped(recorded: tuple[Path, PrintedRun], again: tuple[Path, PrintedRun]) -> dict[str, Any]:
    """What a replay says of both films; its files are in `out` beside them, its dashboard is `loop.rrd`."""
    path, said = recorded[0], io.StringIO()
    outputs = ["--print", str(path.with_name("out")), "--out", str(path.with_name("loop.rrd"))]
    with redirect_stdout(said):
        assert cli.run(["replay", str(path), "--again", str(again[0]), *outputs, "--json"]) == 0
    found: dict[str, Any] = json.loads(said.getvalue())
    return found


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


def test_a_map_as_drawn_is_the_map() -> None:
    helix = Pattern(pattern="helix", period=4, width=1)
    stiff = helix.stiff_voxels(8, 6)
    assert np.array_equal(drawn(helix, stiff).stiff_voxels(8, 6), stiff)
    assert drawn(helix, stiff).rows[1] == "abaaabaa"  # the second ring: one voxel further anticlockwise
    with pytest.raises(BadInput, match="expected 7"):
        drawn(helix, stiff).stiff_voxels(8, 7)
    with pytest.raises(BadInput, match="letters a and b"):
        Pattern(pattern="rows", rows=("abc",)).stiff_voxels(3, 1)
    with pytest.raises(BadInput, match="the scene's tube is"):
        with_map(Scene.parse(SCENE, "test"), "twist7")


@pytest.mark.parametrize(
    "error",
    [
        BadInput("a.mcap, /led", "is missing", "record it"),
        DamagedRecording("a.mcap", "byte 7"),
        CannotWrite(Path("out"), "exists"),
        DidNotConverge("8 steps"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_what_is_wrong_with_a_film_is_said_though_another_process_read_it(error: CatheterError) -> None:
    error.add_note("a note")
    there = pickle.loads(pickle.dumps(error))
    assert (type(there), str(there), vars(there)) == (type(error), str(error), vars(error))


def test_turning_a_body_is_an_error_of_place_and_not_of_strain() -> None:
    small = Scene.parse(SCENE, "test").tables
    case = tube_case(small["tube"], small["map"], Wanted(pressures=(20e3,)))
    at, turn = case.whole[0], np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    turned = replace(at, log=at.log + np.log(1.1), state=replace(at.state, x=at.state.x @ turn.T))
    found = error_map(case, turned)
    assert np.abs(found.strain).max() < 1e-13  # rounding
    assert found.modulus == pytest.approx(np.full((8, 8), 0.1))
    farthest = 2 * np.sin(np.arctan2(0.6, 0.8) / 2) * np.hypot(*at.state.x[:, :2].T).max()  # a chord
    assert found.displacement.max() == pytest.approx(farthest)


def test_the_loop_ends_in_print_files_of_a_better_design(
    looped: dict[str, Any], recorded: tuple[Path, PrintedRun]
) -> None:
    told, (path, run) = looped, recorded
    assert told["kind"] == "simulated"
    assert told["missing"] == 0
    assert told["model_rmse_rad"]["calibrated"] < 0.2 * told["model_rmse_rad"]["table"]
    before, driven, anew = told["redesign"]
    assert driven["twist_rad"] == pytest.approx(told["design_twist_rad"], rel=1e-5)
    assert anew["rms_m"] <= driven["rms_m"] < before["rms_m"]
    assert np.max(told["error_maps"]["displacement_m"]) == pytest.approx(anew["largest_m"])
    assert np.max(told["error_maps"]["strain"]) == pytest.approx(anew["largest_strain"])
    folder = path.with_name("out")
    made = load_map(folder / "redesigned.toml")
    assert made.voxels.shape == run.run.tube.material.shape
    stiff = Pattern(pattern="helix", period=4, width=1).stiff_voxels(8, 8)
    assert (made.voxels != stiff).sum() == told["voxels_changed"]
    assert told["read_back"]["FLX9785"] == made.voxels.sum()
    assert told["read_back"]["Agilus30"] == (made.voxels == 0).sum()
    assert {Path(file).suffix for file in told["files"]} == {".toml", ".stl", ".3mf", ".png"}
    assert all(Path(file).stat().st_size > 200 for file in told["files"])


def test_outputs_that_exist_are_refused_before_anything_is_computed(
    looped: dict[str, Any],
    recorded: tuple[Path, PrintedRun],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def computed(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr(DesignLoop, "__init__", computed)
    path = recorded[0]
    assert cli.run(["redesign", str(path), "--out", str(path.with_name("out"))]) == 2
    assert "redesigned.toml: exists and is not overwritten" in " ".join(capsys.readouterr().err.split())
    stl = Path(next(file for file in looped["files"] if file.endswith("Agilus30.stl")))
    (only := path.with_name("only")).mkdir()
    shutil.copy(stl, only)
    assert cli.run(["replay", str(path), "--no-view", "--print", str(only)]) == 2
    assert "redesigned_Agilus30.stl: exists" in " ".join(capsys.readouterr().err.split())
    assert cli.run(["replay", str(path), "--again", str(path), "--out", str(path), "--force"]) == 2
    assert "never overwritten" in " ".join(capsys.readouterr().err.split())
    assert cli.run(["replay", str(path), "--until", "twist", "--print", str(only)]) == 2
    assert "the whole loop" in " ".join(capsys.readouterr().err.split())
    assert cli.run(["replay", "--until", "twist", "--no-view"]) == 2
    assert "bender.mcap is replayed as signals" in " ".join(capsys.readouterr().err.split())
    assert cli.run(["redesign", str(path), "--pressure", "30 m"]) == 2
    assert "30 m" in capsys.readouterr().err


def test_both_maps_are_shown_as_the_model_and_the_films_have_them(
    looped: dict[str, Any], recorded: tuple[Path, PrintedRun], again: tuple[Path, PrintedRun]
) -> None:
    curves = {(one["map"], one["film"]): one for one in looped["curves"]}
    assert curves.keys() == {("drawn", False), *((which, film) for which in ("design", "redesign") for film in (0, 1))}
    assert all("simulated" in one["name"] for one in looped["curves"])
    for which, (_, run) in (("design", recorded), ("redesign", again)):
        film, model = curves[which, True], curves[which, False]
        truth = np.asarray(run._splines[0](np.array(film["pressure_pa"])))
        assert film["twist_rad"] == pytest.approx(truth, abs=np.radians(0.2))  # 6 times the gauge's noise
        wrong = np.abs(np.interp(film["pressure_pa"], model["pressure_pa"], model["twist_rad"]) - truth).max()
        assert (wrong < np.radians(0.2)) == (which == "design")  # the other has other rubbers
    told = looped["again"]
    assert told["voxels_unlike_this_redesign"] > 0
    assert 0.8 < told["within_scatter"] <= 1.0


def test_the_dashboard_says_simulated_and_keeps_the_benchs_clock(
    looped: dict[str, Any], recorded: tuple[Path, PrintedRun]
) -> None:
    path, run = recorded
    shown, logged = dashboard(Path(looped["view"]))
    assert len(shown) == 11
    assert all(name.startswith("simulated") for name in shown), shown
    first = logged["/pictures/camera/top"][0] / 1e9
    assert first == pytest.approx(Filmed(path, run.cameras).twist.time_s[0], abs=1e-8)
    assert len(logged["/body/tube"]) == 25  # 5 s at 5 Hz


def test_the_shipped_film_gives_its_materials_back() -> None:
    path = ROOT / "data" / "recordings" / "twist.mcap"
    tables = recorded_scene(path, None, ("tube", "map")).tables
    loop = DesignLoop(Specimen(Filmed(path, tables["cameras"]), tables["tube"], tables["map"]))
    truth, interval = loop.first.truth, loop.calibration.interval
    assert truth == pytest.approx([0.21e6, 1.7955e6])
    assert ((interval[:, 0] < truth) & (truth < interval[:, 1])).all()
    assert (np.diff(interval)[:, 0] < 0.015 * truth).all()
    assert "redesign" not in vars(loop)  # nobody asked


def test_a_camera_beyond_the_tip_sees_the_models_sign(recorded: tuple[Path, PrintedRun], tmp_path: Path) -> None:
    path, run = recorded
    assert cli.run(["twist", str(path), "--topic", "/camera/top", "--out", str(tmp_path / "twist.mcap")]) == 0
    with Recording(tmp_path / "twist.mcap") as recording:
        (topic,) = [name for name in recording.channels if name.startswith("/twist")]
        seen = recording.signal(topic)
    last = float(np.asarray(seen.value).reshape(len(seen), -1)[-1, 0])  # anticlockwise as the picture shows it
    true = float(run.twist(np.array([18.0]))[0])
    assert abs(true) > 0.01
    assert last == pytest.approx(true, abs=0.1 * abs(true))
