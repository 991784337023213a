"""What `run`, `tune` and the stability report print is what they promise."""

import json
from pathlib import Path

import pytest

from catheter.lab import cli


def test_run_prints_events_beside_the_published(capsys) -> None:
    assert cli.run(["run", "locomotion", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["events_s"] == pytest.approx({"tB": 0.03140, "tC": 0.15486, "tE": 1.01400, "tF": 1.20574}, abs=1e-5)
    assert found["J"] == pytest.approx(0.17219, abs=1e-5)
    assert found["mismatch"]["events_s"]["tF"] == pytest.approx(1.20574 - 1.16, abs=1e-5)
    assert found["stroke_mm"] == pytest.approx(92.8 / 3, abs=0.1)  # 92.8 mm for a length of 300 mm (independently)


def test_tune_prints_the_optimum_and_its_cost(capsys) -> None:
    assert cli.run(["tune", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["K2"], found["K3"]) == pytest.approx((3.59e-7, 4.55e-8), rel=3e-3)
    assert (found["map"]["n2"], found["map"]["n3"], found["cells"]) == (26, 3, 118 * 118)
    assert found["J_published"] / found["J"] == pytest.approx(0.966, abs=2e-3)
    assert 0 < found["seconds"] < 60


def test_another_kind_of_scene_is_refused(capsys) -> None:
    assert cli.run(["run", "bender"]) == 2
    assert "is of kind 'bender'; name a locomotion or robot scene" in capsys.readouterr().err


def test_every_extreme_is_solved_to_its_tolerance_or_refused(tmp_path: Path, capsys) -> None:
    assert cli.run(["report", "hydraulics-stability", "--quick", "--json", "--out", str(tmp_path)]) == 0
    rows = {row["level"]: row for row in json.loads(capsys.readouterr().out)["rows"]}
    assert len(rows) == 12
    assert rows.pop("source -50 kPa")["failed"].startswith("failed: circuit at 0.65")
    assert all(row["error"] < 1e-6 and not row["failed"] for row in rows.values())


def test_a_fit_from_a_recording_goes_into_the_circuit(tmp_path: Path, capsys) -> None:
    for scene, model, more in (
        ("accumulator", "accumulator", ("--rest-volume", "20 mL")),
        ("valve", "valve", ("--target", "3.05e-7 m^3 Pa^-0.5 s^-1")),
    ):
        recording, fit = str(tmp_path / f"{scene}.mcap"), str(tmp_path / f"{scene}.toml")
        assert cli.run(["record", scene, "--out", recording]) == 0
        assert cli.run(["fit", recording, "--model", model, "--out", fit, *more]) == 0
    capsys.readouterr()
    fits = ["--fit", f"1={tmp_path / 'accumulator.toml'}", "--fit", f"2={tmp_path / 'valve.toml'}"]
    assert cli.run(["run", "locomotion", *fits, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["J"] == pytest.approx(0.17219, rel=0.02)  # fitted to what the thesis prints, with noise
    assert found["J"] != pytest.approx(0.17219, rel=1e-5)
    (tmp_path / "other.toml").write_text("[fit]\nmodel = 'bender'\n")
    for wrong, said in (
        (f"4={tmp_path / 'valve.toml'}", "4 of 3"),
        ("x", "write N=FIT.toml"),
        (f"1={tmp_path / 'other.toml'}", "expected an accumulator or a valve fit"),
    ):
        assert cli.run(["run", "locomotion", "--fit", wrong]) == 2
        assert said in capsys.readouterr().err
