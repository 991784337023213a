"""The scripts that a student copies: each is run as it stands, and its answer checked."""

import re
import runpy
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from helpers import ROOT

from catheter.lab import cli
from vision.render import Shot, render

EXAMPLES = ROOT / "tests" / "examples"


def example(name: str) -> dict[str, Any]:
    return runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="example")


def numbers(pattern: str, text: str) -> list[float]:
    return [float(found) for found in re.findall(pattern, text)]


def test_every_example_is_tested() -> None:
    tested = set(re.findall(r'example\("(\w+)"\)', Path(__file__).read_text()))
    assert tested == {path.stem for path in EXAMPLES.glob("*.py")}


def test_a_bender_is_fitted_and_judged(capsys: pytest.CaptureFixture[str]) -> None:
    shipped = str(ROOT / "data" / "recordings" / "bender.mcap")
    example("fit_bender")["main"](shipped, shipped)
    told = capsys.readouterr().out
    assert "(simulated)" in told
    fitted, again = numbers(r"RMSE ([\d.]+) N", told)
    assert again == pytest.approx(fitted, rel=1e-3)  # judged on what it was fitted to


def test_valves_are_tuned_from_fits(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main = example("tune_from_fits")["main"]
    main()
    plain = capsys.readouterr().out
    before, after = numbers(r"J ([\d.]+)", plain)
    assert after > before
    fits = []
    for segment, model in ((1, "accumulator"), (3, "valve")):
        recording, fit = tmp_path / f"{model}.mcap", tmp_path / f"{model}.toml"
        assert cli.run(["record", model, "--out", str(recording)]) == 0
        assert cli.run(["fit", str(recording), "--model", model, "--out", str(fit)]) == 0
        fits.append(f"{segment}={fit}")
    capsys.readouterr()
    main(*fits)
    assert numbers(r"J ([\d.]+)", capsys.readouterr().out) != [before, after]


def test_a_folder_of_videos_is_measured_in_parallel(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    angles = np.radians(np.linspace(0, 24, 13))
    for name in ("a.avi", "b.avi"):
        writer = cv2.VideoWriter(str(tmp_path / name), cv2.VideoWriter_fourcc(*"MJPG"), 30, (240, 200))
        for k, angle in enumerate(angles):
            shot = Shot(width_px=240, height_px=200, middle_px=(120.0, 100.0), pitch_px=60.0, angle_rad=float(angle))
            writer.write(cv2.cvtColor(render(shot, k), cv2.COLOR_GRAY2BGR))
        writer.release()
    example("twist_folder")["main"](str(tmp_path), str(tmp_path / "out"), ThreadPoolExecutor(2))
    assert numbers(r"turned ([\d.]+) deg", capsys.readouterr().out) == pytest.approx([24, 24], abs=0.1)
    table = np.genfromtxt(tmp_path / "out" / "b.csv", delimiter=",", skip_header=1, usecols=(0, 1))
    assert table[:, 1] == pytest.approx(angles, abs=2e-3)


def test_a_map_is_sought_from_many_seeds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (ROOT / "data" / "scenes" / "invert_twist.toml").read_text(encoding="utf-8")
    small = re.sub(r"\[32, 32(, 1)?\]", lambda found: f"[8, 8{found[1] or ''}]", text).replace('"32 mm"', '"16 mm"')
    (tmp_path / "small.toml").write_text(small.replace("period = 16", "period = 4").replace("width = 4", "width = 1"))
    with ThreadPoolExecutor(1) as pool:
        example("inverse_sweep")["main"](str(tmp_path / "small.toml"), "3:5", pool)
    told = capsys.readouterr().out
    assert numbers(r"seed (\d+)", told) == [3, 4]
    assert max(numbers(r"error ([\d.e+-]+)", told)) < 1e-6
