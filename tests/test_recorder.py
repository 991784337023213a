"""A recorder that is used wrongly, or whose disk fails, loses nothing that it accepted in silence."""

import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from helpers import SIMULATED

from catheter.lab.damage import FLUSH_S, killed_writer
from data.errors import BadInput, DamagedRecording
from data.recorder import Recorder
from data.recording import Recording
from data.seal import SEAL
from data.signal import Signal
from data.topics import STANDARD, Topic, standard

FAILS_FOR_A_MOMENT = """
import resource, sys, time
import numpy as np
from data.errors import CannotWrite
from data.recorder import Recorder
from data.topics import standard
draw = np.random.default_rng(0)
refused = 0
with Recorder(sys.argv[1], {"kind": "measured"}, flush_s=0.05) as recorder:
    recorder.add(standard("/tip"))
    for i in range(9000):
        if i == 3000:
            time.sleep(0.2)
            resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, resource.RLIM_INFINITY))
        if i == 6000:
            time.sleep(0.2)
            resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        try:
            recorder.write("/tip", i / 83, draw.normal(size=3))
        except CannotWrite:
            refused += 1
            print(refused, flush=True)
"""


def test_a_disk_that_fails_for_a_moment_is_never_forgotten(tmp_path: Path) -> None:
    command = [sys.executable, "-c", FAILS_FOR_A_MOMENT, tmp_path / "run.mcap"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert int(done.stdout.splitlines()[-1]) >= 3000  # every write after the failure is refused
    assert "CannotWrite" in done.stderr  # and the end says it once more
    assert not (tmp_path / "run.mcap").exists()
    with pytest.warns(UserWarning, match="cut off"), Recording(tmp_path / "run.partial.mcap") as recording:
        kept = recording.signal("/tip").value
    assert len(kept) >= 2900
    assert kept.tolist() == np.random.default_rng(0).normal(size=(9000, 3))[: len(kept)].tolist()


@pytest.mark.parametrize("seed", range(8))
def test_killed_at_any_moment_at_most_the_flush_interval_is_lost(tmp_path: Path, seed: int) -> None:
    found = killed_writer(tmp_path / "run.mcap", seed)  # reads back what it wrote, or raises
    assert found.lost_s <= FLUSH_S + 0.3  # slack for a busy machine's timer; the damage report has none


@pytest.mark.parametrize(
    ("call", "found"),
    [
        (lambda r: r.note("firmware", {SEAL: "0"}), "written by the recorder itself"),
        (lambda r: r.note("\ud800", {}), "expected text"),
        (lambda r: r.note(None, {}), "expected text"),
        (lambda r: r.add(Topic(name="/x", components=("a",), units=("N",), note="\ud800")), "expected text"),
        (lambda r: r.write("/force", 1.0, [[1.0], [2.0]]), "a number for each component"),
        (lambda r: r.write("/force", 1.0, np.empty((0, 1))), "a number for each component"),
        (lambda r: r.write("/force", 1.0, []), "shape"),
        (lambda r: r.write("/force", 1.0, None), "a number for each component"),
        (lambda r: r.write_picture("/camera/top", 1.0, None), "expected bytes"),
        (lambda r: r.write_picture("/camera/top", "now", b"x"), "expected bytes and a time"),
        (lambda r: r.write_picture("/camera/top", 1.0, b"x", 3), "expected text"),
    ],
)
def test_a_wrong_call_is_refused_and_harms_nothing(tmp_path: Path, call, found: str) -> None:
    with Recorder(tmp_path / "a.mcap", SIMULATED) as recorder:
        recorder.add(standard("/force"))
        recorder.add(STANDARD["/camera/top"])
        recorder.write("/force", 0.0, 1.0)
        with pytest.raises(BadInput, match=found):
            call(recorder)
        recorder.write("/force", 2.0, 3.0)
    with Recording(tmp_path / "a.mcap") as recording:
        assert recording.signal("/force").value.tolist() == [1.0, 3.0]


@pytest.mark.parametrize("options", [{"scene": 5}, {"scene": "\ud800"}, {"flush_s": "1"}, {"flush_s": 0}])
def test_wrong_options_are_refused_before_a_file_is_made(tmp_path: Path, options: dict) -> None:
    with pytest.raises(BadInput):
        Recorder(tmp_path / "a.mcap", SIMULATED, **options)
    assert list(tmp_path.iterdir()) == []


def test_signals_are_written_all_or_none(tmp_path: Path) -> None:
    time_s = np.arange(5.0)
    with Recorder(tmp_path / "a.mcap", SIMULATED) as recorder:
        for name in ("/force", "/stroke"):
            recorder.add(standard(name))
        recorder.write("/stroke", 3.0, 0.0)
        both = {"/force": Signal(time_s, time_s, "N"), "/stroke": Signal(time_s, time_s, "m")}
        with pytest.raises(BadInput, match="/stroke: time 0 s does not come after"):
            recorder.write_signals(both)
        recorder.write_signals({"/force": both["/force"]})
    with Recording(tmp_path / "a.mcap") as recording:
        assert recording.signal("/force").value.tolist() == time_s.tolist()


def test_threads_write_one_topic_in_order_or_are_refused(tmp_path: Path) -> None:
    refused: list[str] = []
    with Recorder(tmp_path / "a.mcap", SIMULATED, flush_s=0.001) as recorder:
        recorder.add(standard("/force"))

        def work(offset: float) -> None:
            for i in range(2000):
                try:
                    recorder.write("/force", i / 1000 + offset, i)
                except BadInput as error:
                    refused.append(str(error))

        workers = [threading.Thread(target=work, args=(offset,)) for offset in (0.0, 0.0005)]
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
    with Recording(tmp_path / "a.mcap") as recording:
        assert len(recording.signal("/force")) + len(refused) == 4000


def test_a_recorder_is_used_once(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "a.mcap", SIMULATED, replace=True)
    with recorder:
        recorder.add(standard("/force"))
        recorder.write("/force", 0.0, 1.0)
    with pytest.raises(BadInput, match="used before"):
        recorder.__enter__()
    with Recording(tmp_path / "a.mcap") as recording:
        assert len(recording.signal("/force")) == 1


def test_two_origins_are_refused(tmp_path: Path) -> None:
    from mcap.writer import Writer

    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.add_metadata("origin", {"kind": "simulated"})
        writer.add_metadata("origin", {"kind": "measured"})
        writer.finish()
    with pytest.raises(DamagedRecording, match="stands twice"):
        Recording(tmp_path / "a.mcap")
