"""The command line: one clear sentence and exit code 2 for bad input, nothing lost, no traceback."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from helpers import REAL, ROOT, catheter

from catheter.lab import cli
from catheter.lab.recording_commands import SHIPPED


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    code = cli.run([str(argument) for argument in arguments])
    printed = capsys.readouterr()
    return code, printed.out, printed.err


def damaged(folder: Path, kind: str) -> Path:
    content = bytearray(SHIPPED.read_bytes())
    if kind == "cut":
        del content[6 * len(content) // 10 :]
    elif kind == "flipped":
        content[100_000] ^= 16
    elif kind == "empty":
        content.clear()
    elif kind == "text":
        content[:] = b"time,force\n0,1\n"
    path = folder / f"{kind}.mcap"
    path.write_bytes(content)
    return path


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("cut", "cut off after"),
        ("flipped", "checksum is|cannot be unpacked"),
        ("empty", "is empty; expected an MCAP"),
        ("text", "begins with"),
    ],
)
def test_a_damaged_recording_is_one_sentence_and_exit_code_2(tmp_path, capsys, kind, said) -> None:
    import re

    path = damaged(tmp_path, kind)
    before = path.read_bytes()
    code, out, err = run(capsys, "replay", path, "--no-view")
    assert code == 2
    assert re.search(said, err)
    assert str(path) in err
    assert len(err.strip().splitlines()) == 1
    assert "Traceback" not in err
    assert path.read_bytes() == before
    assert ("Maxwell slip" in out) == (kind == "cut")  # what came before the cut is shown


def test_debug_shows_the_traceback(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = run(capsys, "replay", damaged(tmp_path, "empty"), "--debug")
    assert code == 2
    assert "Traceback" in err


def test_json_holds_the_results_and_the_errors(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "replay", "--no-view", "--json")
    found = json.loads(out)
    assert code == 0
    assert found["kind"] == "simulated"
    assert {m["name"] for m in found["models"]} >= {"Maxwell slip + pressure", "cubic, weights >= 0 (thesis)"}
    assert all(m["rmse"] > 0 and m["weights"] for m in found["models"])
    code, out, _ = run(capsys, "replay", damaged(tmp_path, "empty"), "--json")
    assert code == 2
    assert "is empty" in json.loads(out)["error"]


def test_an_output_that_exists_is_refused_and_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = tmp_path / "mine.rrd"
    mine.write_text("mine")
    for arguments in (
        ("replay", "--out", mine),
        ("replay", "--out", tmp_path / "new.rrd", "--picture", mine),
        ("record", "bender", "--out", mine),
        ("replay", "--out", tmp_path / "no" / "folder.rrd"),
        ("replay", "--out", tmp_path),
    ):
        code, _, err = run(capsys, *arguments)
        assert code == 2
        assert "not overwritten" in err or "does not exist" in err or "is a folder" in err
    assert mine.read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["mine.rrd"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tmp_path.chmod(0o500)
    code, _, err = run(capsys, "record", "bender", "--out", tmp_path / "a.mcap")
    assert code == 2
    assert "cannot be written" in err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("replay", "none.mcap"), "none.mcap: cannot be read"),
        (("replay", "--response", "/torque", "--no-view"), "/torque: is not in the recording"),
        (("replay", "--no-view", "--out", "a.rrd"), "leave one of them out"),
        (("import", "log.csv"), "needs LOG, --mapping and --out"),
        (("import", "log.csv", "--mapping", "zilen", "--out", "a.mcap"), "did you mean 'zillen'"),
        (("record", "bendr", "--out", "a.mcap"), "did you mean 'bender'"),
        (("table", "3.33"), "3.3"),
    ],
)
def test_bad_arguments_are_one_sentence(capsys, tmp_path, monkeypatch, arguments, said) -> None:
    monkeypatch.chdir(tmp_path)
    code, _, err = run(capsys, *arguments)
    assert code == 2
    assert said in err
    assert len(err.strip().splitlines()) == 1


def test_what_is_asked_for_by_name_is_done_or_refused(capsys) -> None:
    code, out, _ = run(capsys, "replay", "--no-view", "--json", "--response", "/pressure")
    assert code == 0
    assert (json.loads(out)["response"], json.loads(out)["others"]) == ("/pressure", [])
    for arguments, said in (
        (("--split", "steps"), "at least 4 are needed"),
        (("--with", "/force"), "is response or input already"),
        (("--response", "/volume"), "is response and input at once"),
    ):
        code, _, err = run(capsys, "replay", "--no-view", *arguments)
        assert code == 2
        assert said in err


def test_a_fault_of_ours_is_said_to_be_ours(capsys, monkeypatch) -> None:
    from catheter.lab import report_commands

    monkeypatch.setattr(report_commands, "table_", lambda _: 1 // 0)
    code, _, err = run(capsys, "table")
    assert code == 1
    assert "a fault of this program: ZeroDivisionError" in err
    assert "Traceback" not in err


@pytest.mark.parametrize(
    "arguments", [("table",), ("table", "3.5"), ("import", "--list"), ("replay", "--no-view")], ids=" ".join
)
def test_text_fits_100_columns_and_json_is_json(capsys, arguments) -> None:
    code, out, _ = run(capsys, *arguments)
    assert code == 0
    assert max(map(len, out.splitlines())) <= 100
    code, out, _ = run(capsys, *arguments, "--json")
    assert code == 0
    json.loads(out)


def test_import_then_replay_of_a_real_log(real: Path, tmp_path: Path, capsys) -> None:
    log, out = real / "hydraulic_rig" / "MotorRotation.csv", tmp_path / "motor.mcap"
    code, printed, _ = run(capsys, "import", log, "--mapping", "motor_rotation", "--out", out)
    assert code == 0
    assert "undocumented" in printed
    code, printed, _ = run(capsys, "replay", out, "--no-view")
    assert code == 0
    assert "(measured)" in printed
    assert "undocumented unit" in printed
    code, printed, _ = run(capsys, "replay", out, "--no-view", "--split", "half")
    assert "that is extrapolation" in printed


@pytest.mark.parametrize(("name", "log"), sorted((name, log) for name, (log, _, _) in REAL.items()))
def test_every_real_log_replays_to_a_dashboard_that_rerun_accepts(real: Path, tmp_path: Path, name, log) -> None:
    done = catheter("import", real / log, "--mapping", name, "--out", "run.mcap", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    done = catheter("replay", "run.mcap", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "(measured)" in done.stdout
    rerun = Path(sys.executable).with_name("rerun")
    subprocess.run([rerun, "rrd", "verify", tmp_path / "run.rrd"], check=True, capture_output=True, timeout=120)


def test_a_full_disk_is_one_sentence_and_leaves_nothing_half_done(tmp_path: Path) -> None:
    limit = "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000)); "
    start = "from catheter.__main__ import main; sys.exit(main())"
    for arguments, left in (
        (("replay", "--out", "a.rrd"), []),
        (("record", "bender", "--out", "b.mcap"), ["b.partial.mcap"]),  # what was recorded is kept
    ):
        command = [sys.executable, "-c", limit + start, *arguments]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120)
        assert done.returncode == 2
        assert done.stderr.startswith(f"error: {arguments[-1]}: cannot be written")
        assert len(done.stderr.splitlines()) == 1
        assert [path.name for path in tmp_path.iterdir()] == left


def test_a_plain_folder_named_like_a_package_does_no_harm_and_a_package_is_named(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    assert catheter("table", cwd=tmp_path).returncode == 0
    (tmp_path / "data" / "__init__.py").write_text("")
    done = catheter("table", cwd=tmp_path)
    assert done.returncode == 2
    assert f"must come from {ROOT / 'data'}" in done.stderr
    assert str(tmp_path / "data") in done.stderr
    assert "Traceback" not in done.stderr


def test_a_reader_that_leaves_early_is_no_error(tmp_path: Path) -> None:
    command = f"{sys.executable} -m catheter table 3.5 | head -1"
    done = subprocess.run(command, shell=True, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout.startswith("Table 3.5")
    assert done.stderr == ""
