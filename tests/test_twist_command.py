"""The command `twist`: the same angles through every container, resumed runs, failures listed, bad input named."""

import csv
import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers import SIMULATED

from catheter.lab import cli
from data.recorder import Recorder
from data.recording import Recording
from data.topics import standard
from vision.render import Shot, render

ANGLES = 3.6 * np.sin(np.arange(24) / 5)  # past 180 degrees both ways
GONE = 10


@pytest.fixture(scope="module")
def film() -> list[np.ndarray]:
    shots = [
        Shot(width_px=240, height_px=200, middle_px=(120.3, 99.6), pitch_px=60.0, noise_grey=2.0, angle_rad=angle)
        for angle in ANGLES
    ]
    return [np.full((200, 240), 200, np.uint8) if k == GONE else render(s, k) for k, s in enumerate(shots)]


def video(path: Path, code: str, film: list[np.ndarray]) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*code), 30, (240, 200))
    for picture in film:
        writer.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


def recorded(path: Path, film: list[np.ndarray]) -> Path:
    with Recorder(path, SIMULATED, flush_s=None) as recorder:
        recorder.add(standard("/camera/top"))
        for k, picture in enumerate(film):
            recorder.write_picture("/camera/top", k / 30, cv2.imencode(".png", picture)[1].tobytes(), "png")
    return path


def run(*arguments: object) -> int:
    return cli.run(["twist", *map(str, arguments)])


def read(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize(("name", "most_deg"), [("v.mp4", 0.2), ("v.avi", 0.05), ("r.mcap", 0.02)])
def test_the_same_angles_through_every_container(tmp_path: Path, film, capsys, name: str, most_deg: float) -> None:
    path = tmp_path / name
    recorded(path, film) if name == "r.mcap" else video(path, "mp4v" if name == "v.mp4" else "MJPG", film)
    assert run(path, "--out", tmp_path / "twist.csv", "--json") == 0
    values = json.loads(capsys.readouterr().out)
    assert (values["frames"], values["measured"]) == (24, 23)
    assert [(f["frame"], bool(f["reason"])) for f in values["failed"]] == [(GONE, True)]
    assert values["kind"] == ("simulated" if name == "r.mcap" else "unstated")
    rows = read(tmp_path / "twist.csv")
    assert list(rows[0]) == ["time_s", "angle_rad", "sigma_rad", "status"]
    angle = np.array([float(row["angle_rad"]) for row in rows])
    assert [row["status"] for row in rows] == ["missing" if k == GONE else "ok" for k in range(24)]
    assert math.isnan(angle[GONE])
    errors = np.degrees(np.delete(angle - (ANGLES - ANGLES[0]), GONE))
    assert np.abs(errors).max() < most_deg  # a pitch of 60 px; compression noise on top
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


def test_a_recording_of_the_twist_and_its_overlay(tmp_path: Path, film, capsys) -> None:
    path = recorded(tmp_path / "r.mcap", film)
    out, view = tmp_path / "t.mcap", tmp_path / "t.rrd"
    assert run(path, "--out", out, "--view", view, "--zero", 3, "--smooth", 400) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "23 of 24 frames" in printed
    assert "simulated" in printed
    with Recording(out) as recording:
        assert recording.kind == "simulated"
        angle = recording.signal("/twist", "angle").value
        sigma = recording.signal("/twist", "sigma").value
    assert abs(angle[3]) < 1e-3
    assert abs(angle[GONE] - (ANGLES[GONE] - ANGLES[3])) < 4 * sigma[GONE]  # filled, with its own deviation
    assert sigma[GONE] > 5 * sigma[GONE - 2]
    assert view.stat().st_size > 10_000
    assert run(video(tmp_path / "v.avi", "MJPG", film), "--out", tmp_path / "u.mcap") == 2
    assert "--origin" in capsys.readouterr().err


def test_an_interrupted_run_is_continued(tmp_path: Path, film, capsys, monkeypatch) -> None:
    path, out = video(tmp_path / "v.avi", "MJPG", film), tmp_path / "twist.csv"
    assert run(path, "--out", out) == 0
    whole = read(out)
    out.unlink()
    from vision.twist import Tracker

    locate, calls = Tracker.locate, []

    def interrupted(self, picture):
        calls.append(1)
        if len(calls) == 15:
            raise KeyboardInterrupt
        return locate(self, picture)

    monkeypatch.setattr(Tracker, "locate", interrupted)
    assert run(path, "--out", out) == 130
    assert not out.exists()
    partial = tmp_path / ".twist.csv.frames"
    partial.write_text(partial.read_text() + "[15, 0.4")  # a line cut by a crash
    monkeypatch.setattr(Tracker, "locate", locate)
    capsys.readouterr()
    assert run(path, "--out", out, "--json") == 0
    assert json.loads(capsys.readouterr().out)["resumed_at"] == 14
    assert not partial.exists()
    for again, once in zip(read(out), whole, strict=True):
        assert float(again["angle_rad"]) == pytest.approx(
            float(once["angle_rad"]), abs=1e-4, nan_ok=True
        )  # searched instead of followed


def test_a_folder_of_photographs_lists_centres_by_file(tmp_path: Path, film, capsys) -> None:
    for k in (0, GONE, 20):
        cv2.imwrite(str(tmp_path / f"{k}.png"), film[k])
    (tmp_path / "bad.jpg").write_bytes(b"\xff\xd8 cut")
    assert run(tmp_path, "--json") == 0
    pictures = {p["name"]: p for p in json.loads(capsys.readouterr().out)["pictures"]}
    assert {name: p["status"] for name, p in pictures.items()} == {
        "0.png": "ok", "10.png": "missing", "20.png": "ok", "bad.jpg": "missing",
    }  # fmt: skip
    assert pictures["0.png"]["corner_px"] == pytest.approx([90.3, 69.6], abs=0.05)
    assert pictures["bad.jpg"]["corner_px"] is None


def test_bad_input_is_one_sentence_and_exit_code_2(tmp_path: Path, film, capsys) -> None:
    path = video(tmp_path / "v.avi", "MJPG", film[:3])
    (tmp_path / "empty.mp4").touch()
    (tmp_path / "there.csv").write_text("mine")
    for arguments, said in (
        ((tmp_path / "empty.mp4",), "is empty"),
        ((path, "--out", tmp_path / "t.txt"), "ending in .csv or .mcap"),
        ((path, "--out", tmp_path / "there.csv"), "not overwritten"),
        ((path, "--zero", 99), "has no marker"),
        ((path, "--size", 2), "--size"),
        ((path, "--topic", "/camera/top"), "no recording"),
        ((path, "--smooth", -1), "acceleration"),
    ):
        assert run(*arguments) == 2
        error = capsys.readouterr().err
        assert said in error
        assert len(error.strip().splitlines()) == 1
    assert (tmp_path / "there.csv").read_text() == "mine"
