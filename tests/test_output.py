"""Dashboards are written as they are logged: bounded memory, full disks are said, killed commands leave nothing."""

import hashlib
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from helpers import SIMULATED
from rerun.chunk import RrdReader

from catheter.lab import cli, replay
from catheter.lab.replay import Replay
from catheter.lab.views import output
from catheter.lab.views.output import PENDING, Output
from data.errors import CannotWrite
from data.recorder import Recorder
from data.recording import Recording
from data.signal import Signal
from data.topics import Topic, standard

FRAMES, FRAME = 900, 65_000


def filmed(path: Path, frames: int) -> Path:
    draw = np.random.default_rng(1)
    with Recorder(path, SIMULATED, flush_s=None) as recorder:
        recorder.add(standard("/camera/top"))
        for number in range(frames):
            recorder.write_picture("/camera/top", number / 30, b"\xff\xd8" + draw.bytes(FRAME) + b"\xff\xd9")
    return path


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of 58 MB of pictures."""
    return filmed(tmp_path_factory.mktemp("film") / "film.mcap", FRAMES)


def command(film: Path, *more: str) -> list[str]:
    return [sys.executable, "-m", "catheter", "replay", str(film), *more]


@pytest.mark.skipif(sys.platform != "linux", reason="/proc says how much memory was used")
def test_memory_does_not_grow_with_the_length_of_a_film(film: Path, tmp_path: Path) -> None:
    script = (
        "import re, sys\nfrom catheter.lab import cli\ncode = cli.run(sys.argv[1:])\n"
        "print(code, re.search(r'VmHWM:\\s+(\\d+)', open('/proc/self/status').read())[1])"
    )
    used = []
    for source, out in ((filmed(tmp_path / "short.mcap", 10), "a.rrd"), (film, "b.rrd")):
        line = [sys.executable, "-c", script, "replay", str(source), "--out", str(tmp_path / out)]
        done = subprocess.run(line, capture_output=True, text=True, check=True)
        code, kilobytes = map(int, done.stdout.split()[-2:])
        assert code == 0
        used.append(1024 * kilobytes)
    assert (tmp_path / "b.rrd").stat().st_size > FRAMES * FRAME
    assert used[1] - used[0] < 35e6  # of 58 MB; held whole it would be more than that


def test_a_full_disk_is_one_sentence_wherever_it_fills(tmp_path: Path) -> None:
    for count in (1, 40):  # in the last piece, and long before
        full = pytest.raises(CannotWrite, match="/dev/full: cannot be written: No space left")
        with full, Output("x", Path("/dev/full")) as output:
            for _ in range(count):
                output.stream.log("/a", rr.EncodedImage(contents=bytes(PENDING // 4), media_type="image/jpeg"))
                output.settle(PENDING // 4)


def test_an_error_in_the_block_is_the_one_that_is_told(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), Output("x", tmp_path / "a.rrd") as output:
        output.stream.log("/a", rr.TextLog("x"))
        raise ZeroDivisionError
    assert RrdReader(tmp_path / "a.rrd") is not None  # what was written is a sound file


def test_where_pipes_have_no_names_a_dashboard_is_refused_in_one_sentence(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(output, "DESCRIPTORS", tmp_path / "none")  # as on Windows
    assert cli.run(["replay", "--out", str(tmp_path / "a.rrd")]) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"error: {tmp_path / 'a.rrd'}: a dashboard is written through")
    assert len(told.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform != "linux", reason="/proc counts threads")
def test_finished_dashboards_keep_no_threads(tmp_path: Path) -> None:
    def threads() -> int:
        found = re.search(r"Threads:\s+(\d+)", Path("/proc/self/status").read_text())
        assert found
        return int(found[1])

    counts = []
    for _ in range(12):
        with Output("x", tmp_path / "a.rrd") as output:
            output.stream.log("/a", rr.TextLog("x"))
        counts.append(threads())
    assert counts[-1] <= counts[2] + 2


@pytest.mark.parametrize("sent", [signal.SIGTERM, signal.SIGINT])
def test_a_replay_that_is_ended_leaves_nothing_and_can_be_repeated(film: Path, tmp_path: Path, sent: int) -> None:
    out = tmp_path / "o.rrd"
    with subprocess.Popen(command(film, "--out", str(out)), stderr=subprocess.PIPE, text=True) as process:
        deadline = time.monotonic() + 60
        while not (found := [p for p in tmp_path.iterdir() if p.stat().st_size > 5_000_000]):
            assert time.monotonic() < deadline
            assert process.poll() is None
            time.sleep(0.01)
        assert [path.name for path in found] == [".o.partial.rrd"]
        process.send_signal(sent)
        _, err = process.communicate(timeout=60)
    assert process.returncode == {signal.SIGTERM: 143, signal.SIGINT: 130}[signal.Signals(sent)]
    assert "Traceback" not in err
    assert list(tmp_path.iterdir()) == []


def test_a_replay_that_is_killed_passes_nothing_off_as_whole_and_can_be_repeated(film: Path, tmp_path: Path) -> None:
    before, out = hashlib.sha256(film.read_bytes()).digest(), tmp_path / "o.rrd"
    with subprocess.Popen(command(film, "--out", str(out)), stderr=subprocess.DEVNULL) as process:
        deadline = time.monotonic() + 60
        while not any(path.stat().st_size > 1_000_000 for path in tmp_path.iterdir()):
            assert time.monotonic() < deadline
            time.sleep(0.01)
        process.kill()
    left = [path.name for path in tmp_path.iterdir()]
    assert left == [".o.partial.rrd"]  # nobody could remove it; its name says what it is
    assert cli.run(["replay", str(film), "--out", str(out)]) == 0
    assert out.stat().st_size > FRAMES * FRAME
    subprocess.run([Path(sys.executable).with_name("rerun"), "rrd", "verify", out], check=True, capture_output=True)
    assert hashlib.sha256(film.read_bytes()).digest() == before


SWALLOWED = """
import signal, sys, time
from catheter.__main__ import _answer_signals
_answer_signals()
class Dying:
    def __del__(self):
        signal.raise_signal(int(sys.argv[1]))
        time.sleep(0)  # where the signal is answered: Python ignores what is raised in here
try:
    Dying()
    time.sleep(60)
except KeyboardInterrupt:
    sys.exit(130)
"""


def test_who_asks_twice_for_the_end_does_not_disturb_it() -> None:
    script = (
        "import signal\nfrom catheter.__main__ import _answer_signals\n_answer_signals()\n"
        "try:\n    signal.raise_signal(signal.SIGTERM)\n"
        "finally:\n    signal.raise_signal(signal.SIGTERM)\n    print('outputs removed')"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (143, "outputs removed\n")


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_an_end_that_comes_inside_a_callback_is_not_lost(sent: int, code: int) -> None:
    line = [sys.executable, "-c", SWALLOWED, str(int(sent))]
    done = subprocess.run(line, capture_output=True, text=True, check=False, timeout=30)
    assert (done.returncode, done.stderr) == (code, "")


@pytest.mark.parametrize("module", ["pathlib", "importlib.util", "signal", "catheter.lab.cli"])
def test_an_interruption_while_the_command_line_starts_is_no_traceback(module: str) -> None:
    script = (
        "import builtins, sys\nfrom catheter.__main__ import main\nreal = builtins.__import__\n"
        "def stop(name, *more):\n    if name == sys.argv[1]: raise KeyboardInterrupt\n    return real(name, *more)\n"
        "builtins.__import__ = stop\nsys.exit(main())"
    )
    done = subprocess.run([sys.executable, "-c", script, module], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "")


def test_a_very_long_signal_is_thinned_and_said_to_be(tmp_path: Path, monkeypatch) -> None:
    time_s = np.arange(100_000) / 100
    values = np.stack([np.sin(time_s), np.cos(time_s)], axis=1)
    with Recorder(tmp_path / "a.mcap", SIMULATED, flush_s=None) as recorder:
        recorder.add(Topic(name="/force", components=("force",), units=("N",)))
        recorder.add(Topic(name="/tip", components=("x", "y"), units=("m", "m")))
        recorder.write_signals({"/force": Signal(time_s, values[:, 0], "N")})
        recorder.write_signals({"/tip": Signal(time_s[:9000], values[:9000], "m", components=("x", "y"))})
    monkeypatch.setattr(replay, "MOST_SAMPLES", 40_000)
    with Recording(tmp_path / "a.mcap") as recording:
        replayed = Replay(recording)
        force = replayed.signals["/force"]
        lengths = [len(part) for part in recording.blocks("/force")]
        assert any(length % 3 for length in lengths[:-1])  # it is read in pieces, which three does not divide
        assert np.array_equal(force.value, values[::3, 0])  # whatever pieces it was read in
        assert np.array_equal(force.time_s, recording.signal("/force").time_s[::3])
        assert len(replayed.signals["/tip:y"]) == 9000
        assert [text for text in replayed.left_out if text.startswith("/force: 2 of 3 samples")]
    monkeypatch.setattr(replay, "MOST_SAMPLES", 10**9)
    monkeypatch.setattr(replay, "MOST_NUMBERS", 59_000)  # of 100,000 + 18,000
    with Recording(tmp_path / "a.mcap") as recording:
        assert len(Replay(recording).signals["/force"]) == 50_000
