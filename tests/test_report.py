"""Reports keep failures as rows, and say what they were made on."""

import csv
import json
from pathlib import Path

import numpy as np

from catheter.lab import cli, plot
from catheter.lab.report import Report, Row, machine, measure, write
from data.errors import CatheterError


def test_a_solve_that_fails_is_a_row_that_says_so() -> None:
    def fails() -> object:
        raise CatheterError("residual 3e-4 > 1e-8")

    row = measure("method", "1", fails, lambda _: 0.0)
    assert "residual 3e-4" in row.failed
    assert np.isnan(row.error)
    good = measure("method", "1", lambda: 3.0, lambda answer: abs(answer - np.pi))
    assert good.error == abs(3.0 - np.pi)
    assert good.seconds > 0


def test_a_report_is_csv_picture_and_what_it_was_made_on(tmp_path: Path) -> None:
    rows = [Row(method="a", level=f"{n}", error=10.0**-n, seconds=0.1 * n) for n in (1, 2, 3)]
    rows.append(Row(method="b", level="1", error=float("nan"), seconds=0.1, failed="failed: too stiff"))
    made = Report(name="r", title="Error against run time", level="order", error="error [1]", rows=rows)
    for _ in range(2):  # a later run replaces the earlier one
        paths = {path.suffix: path for path in write(made, tmp_path / "out")}
    with paths[".csv"].open(newline="") as file:
        read = list(csv.DictReader(file))
    assert [float(row["error [1]"]) for row in read[:3]] == [0.1, 0.01, 0.001]
    assert read[3]["failed"] == "failed: too stiff"
    about = json.loads(paths[".json"].read_text())
    assert {"machine", "python", "numpy", "commit", "date"} <= set(about)
    import cv2

    picture = cv2.imread(str(paths[".png"]))
    assert picture.std() > 10  # not blank
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["r.csv", "r.json", "r.png"]


def test_error_over_run_time_is_drawn_on_two_logarithmic_axes_with_units() -> None:
    rows = [Row(method="a", level=f"{n}", error=10.0**-n, seconds=0.1 * n) for n in (1, 2, 3)]
    rows.append(Row(method="a", level="4", error=float("nan"), seconds=0.1, failed="failed: too stiff"))
    figure = plot.sheet("title", "simulated")
    axes = plot.work_precision(figure, rows, error="relative error")
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("run time [s]", "relative error")
    assert axes.lines[0].get_ydata().tolist() == [0.1, 0.01, 0.001]  # what failed has no point
    assert figure.get_suptitle() == "simulated: title"
    exact = [*rows, Row(method="b", level="1", error=0.0, seconds=1.0)]
    assert plot.work_precision(plot.sheet("t"), exact, error="e").get_yscale() == "symlog"  # 0 is on it
    assert plot.label("force", "N") == "force [N]"


def test_the_machine_is_named() -> None:
    assert all(machine().values())


def test_regression_report_finds_ours_as_exact_as_any(tmp_path: Path, capsys) -> None:
    assert cli.run(["report", "regression", "--quick", "--json", "--out", str(tmp_path)]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    ours = [row["error"] for row in rows if row["method"].startswith("this project")]
    assert len(ours) == 2
    assert max(ours) < 1e-12
    gram = [row["error"] for row in rows if row["method"].startswith("Gram")]
    assert min(gram) > max(ours)  # squaring the condition number costs digits


def test_damage_report_finds_nothing_silent(tmp_path: Path, capsys) -> None:
    assert cli.run(["report", "damage", "--quick", "--json", "--out", str(tmp_path)]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert [row["error"] for row in rows] == [0.0] * 6


def test_hysteresis_report_on_the_shipped_recording(tmp_path: Path, capsys) -> None:
    assert cli.run(["report", "hysteresis", "--quick", "--json", "--out", str(tmp_path)]) == 0
    found = json.loads(capsys.readouterr().out)
    by_level = {row["level"]: row["error"] for row in found["rows"] if row["method"].startswith("stop")}
    assert by_level["5"] < by_level["1"]


def test_selection_report_agrees_with_direct_solution_and_is_far_faster(tmp_path: Path, capsys) -> None:
    assert cli.run(["report", "selection", "--quick", "--json", "--out", str(tmp_path)]) == 0
    ours, loop = json.loads(capsys.readouterr().out)["rows"]
    assert ours["error"] < 1e-8
    assert ours["seconds"] < loop["seconds"] / 10


def test_recordings_report_shows_in_sample_and_held_out(tmp_path: Path, capsys) -> None:
    assert cli.run(["report", "sysid-recordings", "--quick", "--json", "--out", str(tmp_path)]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert [row["level"] for row in rows][:3] == ["in-sample", "every other tenth held out", "second half held out"]
    assert all(0 < row["error"] < 1 for row in rows)
