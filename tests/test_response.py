"""A simulated actuator between its equilibria: as a curve for a recording, as a spring for the circuit."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catheter.circuit import thesis_circuit, with_fit
from catheter.lab import cli
from catheter.response import Fineness, respond, spring
from catheter.twin import Twinning, twin
from data.errors import BadInput, DidNotConverge
from data.recorder import Recorder
from data.recording import Recording
from data.signal import Signal
from data.topics import Topic, standard
from fem.material import printable
from fem.tube import Tube

KPA = 1e3
SCENE = """[scene]
kind = "tube"
title = "small"
[tube]
divisions = [8, 8, 1]
voxels = [8, 8]
[map]
pattern = "helix"
period = 4
width = 1
[path]
pressures = ["10 kPa", "25 kPa", "40 kPa", "50 kPa"]
"""


@pytest.fixture(scope="module")
def tube() -> Tube:
    """The scene's tube: a helical wrap that twists."""
    material = np.full((8, 8), printable("Agilus30"), dtype=object)
    i, j = np.indices(material.shape)
    material[(i - j) % 4 < 1] = printable("FLX9785")
    return Tube(length=32e-3, outer_radius=5e-3, wall=1e-3, divisions=(8, 8, 1), material=material)


def test_a_curve_foretells_twists_that_were_not_solved(tube: Tube) -> None:
    tolerance = 2e-6
    found = respond(tube, -3 * KPA, 50 * KPA, Fineness(tolerance=tolerance))
    asked = np.array([3.3, 17.7, 44.1, 49.0]) * KPA
    solved = tube.inflate(asked)
    assert np.abs(found.at(asked) - solved.twist).max() < tolerance
    assert found.at(asked, "extension") == pytest.approx(solved.extension, abs=2e-7)
    assert found.at(np.array([0.0, np.nan]))[0] == pytest.approx(0, abs=1e-12)
    assert np.isnan(found.at(np.array([np.nan]))).all()
    assert found.error <= tolerance
    with pytest.raises(BadInput, match="solved -3 to 50 kPa"):
        found.at(np.array([51 * KPA]))


def test_a_pressure_beyond_the_limit_point_and_an_impossible_fineness_are_refused(tube: Tube) -> None:
    with pytest.raises(DidNotConverge, match="control='volume'"):
        respond(tube, 0.0, 500 * KPA)
    with pytest.raises(DidNotConverge, match="allow more"):
        respond(tube, 0.0, 50 * KPA, Fineness(tolerance=1e-8, most=10))
    with pytest.raises(BadInput, match="expected a range"):
        respond(tube, 0.0, 0.0)


def test_the_spring_holds_the_simulated_volumes(tube: Tube) -> None:
    found = spring(tube.inflate(np.array([10, 25, 40, 50, 60]) * KPA))
    between = tube.inflate([18 * KPA, 55 * KPA])
    ratio = between.volume / tube.rest_volume
    assert found.accumulator.rest_volume == pytest.approx(tube.rest_volume, rel=1e-12)
    # 1e-3 of the greatest pressure is where the polynomial stops, and the cubics' own error is below it
    assert found.accumulator.pressure_pa(ratio) == pytest.approx(between.pressure, abs=3e-3 * 60 * KPA)
    assert found.accumulator.volume(55 * KPA) == pytest.approx(ratio[1], rel=5e-3)


def test_two_equilibria_and_their_slopes_make_a_spring(tube: Tube) -> None:
    found, between = spring(tube.inflate([30 * KPA, 60 * KPA])), tube.inflate([15 * KPA, 50 * KPA])
    ratio = between.volume / tube.rest_volume
    assert found.accumulator.pressure_pa(ratio) == pytest.approx(between.pressure, abs=1e-3 * 60 * KPA)  # as is enough


def test_a_path_that_falls_has_no_spring(tube: Tube) -> None:
    with pytest.raises(BadInput, match="no stable equilibrium above rest"):
        spring(tube.inflate([-1 * KPA]))


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """The tube's scene in a file."""
    path = tmp_path / "small.toml"
    path.write_text(SCENE, encoding="utf-8")
    return path


def test_inflate_writes_what_the_circuit_and_paraview_read(scene: Path, tmp_path: Path, tube: Tube, capsys) -> None:
    law, pvd, view = tmp_path / "spring.toml", tmp_path / "t.pvd", tmp_path / "t.rrd"
    command = ["inflate", str(scene), "--accumulator", str(law), "--vtu", str(pvd), "--view", str(view)]
    assert cli.run(command) == 0
    assert "5 file(s)" in " ".join(capsys.readouterr().out.split())  # 4 loads and the collection
    circuit = with_fit(thesis_circuit(), 1, law)
    volume = circuit.volume(40 * KPA)[1]
    assert circuit.segments[1].accumulator.rest_volume == pytest.approx(tube.rest_volume, rel=1e-9)
    solved = tube.inflate([40 * KPA])
    assert volume == pytest.approx(float(solved.volume[0]) / tube.rest_volume, rel=2e-3)
    from xml.etree import ElementTree

    sets = list(ElementTree.parse(pvd).iter("DataSet"))
    assert [float(one.get("timestep")) for one in sets] == [10e3, 25e3, 40e3, 50e3]
    assert all((tmp_path / one.get("file")).is_file() for one in sets)
    import subprocess
    import sys

    rerun = Path(sys.executable).with_name("rerun")
    subprocess.run([rerun, "rrd", "verify", view], check=True, capture_output=True, timeout=120)
    assert cli.run(command) == 2
    assert "not overwritten" in capsys.readouterr().err
    assert cli.run(["inflate", str(scene), "--vtu", "t.vtk"]) == 2


def _recorded(path: Path, tube: Tube, kind: str = "measured") -> tuple[np.ndarray, np.ndarray]:
    """Record a pressure and the twist the model itself has half a second later, 1 mrad off."""
    time_s = np.arange(0, 10, 0.02)
    pressure = 101e3 + 20e3 * (1 - np.cos(time_s))
    curve = respond(tube, 0.0, 40.1 * KPA)
    later = np.arange(0.5, 9, 0.1)
    twist = curve.at(20e3 * (1 - np.cos(later - 0.5))) - 1e-3
    with Recorder(path, {"kind": kind, "title": "bench"}, flush_s=None) as recorder:
        recorder.add(standard("/pressure"))
        recorder.add(standard("/twist"))
        for at, value in zip(time_s, pressure, strict=True):
            recorder.write("/pressure", float(at), float(value))
        for at, value in zip(later, twist, strict=True):
            recorder.write("/twist", float(at), [float(value), 1e-3])
    return pressure, twist


def test_a_recorded_pressure_drives_the_model(tmp_path: Path, tube: Tube, scene: Path, capsys) -> None:
    source, out = tmp_path / "bench.mcap", tmp_path / "twin.mcap"
    pressure, twist = _recorded(source, tube)
    command = ["twin", str(scene), str(source), "--ambient", "101 kPa", "--lag", "0.5 s", "--out", str(out), "--json"]
    assert cli.run(command) == 0
    import json

    found = json.loads(capsys.readouterr().out)
    assert (found["recording_kind"], found["model_kind"]) == ("measured", "simulated")
    assert found["offset_rad"] == pytest.approx(1e-3, abs=2e-5)
    assert found["spread_rad"] < 2e-5  # between samples of the pressure it is linear
    with Recording(out) as recording:
        assert recording.kind == "measured"
        assert (recording.signal("/pressure").value == pressure).all()
        assert recording.signal("/twist").value == pytest.approx(twist)
        model, residual = recording.signal("/simulated/twist"), recording.signal("/simulated/residual")
        assert model.note.startswith("simulated")
        assert residual.value == pytest.approx(1e-3, abs=1e-4)
        at = int(np.argmin(np.abs(pressure - 121e3)))
        assert model.value[at] == pytest.approx(float(tube.inflate([pressure[at] - 101e3]).twist[0]), abs=5e-4)
    assert cli.run(command) == 2
    assert "not overwritten" in capsys.readouterr().err
    assert cli.run(["twin", str(scene), str(source)]) == 2
    assert "--ambient takes what it is at rest" in capsys.readouterr().err


def test_a_twin_keeps_gaps_and_lives_without_a_twist(tube: Tube) -> None:
    time_s = np.arange(5.0)
    pressure = Signal(time_s, np.array([0, 5e3, np.nan, 10e3, 0]), "Pa", name="/pressure")
    found = twin(tube, pressure)
    assert np.isnan(found.twist).tolist() == [False, False, True, False, False]
    assert found.compared == 0
    assert np.isnan(found.rmse)
    measured = Signal(np.array([0.5, 1.5, 3.5, 9.0]), np.zeros(4), "rad", name="/twist")
    beside = twin(tube, pressure, measured, options=Twinning())
    assert np.isnan(beside.residual).tolist() == [False, True, False, True]
    with pytest.raises(BadInput, match="expected 1, rad"):
        twin(tube, pressure, replace(measured, unit="1"))
    with pytest.raises(BadInput, match="has no number"):
        twin(tube, Signal(time_s, np.full(5, np.nan), "Pa", name="/pressure"))


def test_a_recording_that_does_not_say_what_it_is_makes_no_other(tmp_path: Path, scene: Path, capsys) -> None:
    source = tmp_path / "plain.mcap"
    with Recorder(source, {"kind": "simulated"}, flush_s=None) as recorder:
        recorder.add(Topic(name="/force", components=("force",), units=("N",)))
        recorder.write("/force", 0.0, 1.0)
    assert cli.run(["twin", str(scene), str(source)]) == 2
    assert "/pressure" in capsys.readouterr().err
    assert cli.run(["twin", "bender", str(source)]) == 2
    assert "has no [tube]" in capsys.readouterr().err
