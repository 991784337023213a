"""Reports of reports: one that cannot be made, or hangs, is a row with the reason, and stops no other."""

import csv
import json
import time
from pathlib import Path

import pytest

from catheter.lab import cli, gather
from catheter.lab.gather import Job
from catheter.lab.report_commands import GATHERED, STUDIES, kind_of


def test_every_study_is_of_a_kind_that_is_gathered() -> None:
    for name in STUDIES:
        assert kind_of(name) in GATHERED["all"]
    assert kind_of("fem-stability") == kind_of("damage") == "stability"
    assert kind_of("fem") == "error-vs-time"
    assert kind_of("thesis") == "thesis"


def test_what_cannot_be_made_is_a_row_with_the_reason(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(gather, "MOST_S", 15.0)  # --quick: a tenth of it, which the slow one needs many times
    told: list[float] = []
    jobs = [Job(name="damage", kind="stability"), Job(name="no-such", kind="error-vs-time")]
    slow, wrong = gather.gather(jobs, tmp_path, quick=True, progress=told.append)
    assert slow.why == "no answer within 2 s: ended"
    assert "no-such" in wrong.why
    monkeypatch.setattr(gather, "MOST_S", 600.0)
    (made,) = gather.gather([Job(name="valves", kind="error-vs-time")], tmp_path, quick=True, progress=told.append)
    assert (made.why, made.rows, made.failures) == ("", 8, ())
    assert told[-1] == 1.0
    paths = gather.write_index([slow, wrong, made], tmp_path)
    with paths[0].open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["report"] for row in rows] == ["damage", "no-such", "valves"]
    assert [row["outcome"] for row in rows] == [slow.why, wrong.why, "made"]
    listed = json.loads(paths[1].read_text())["reports"][2]
    assert all(Path(path).is_file() for path in listed["files"])
    assert all(str(tmp_path / "error-vs-time") in path for path in listed["files"])
    assert paths[2].stat().st_size > 10_000  # the picture is in it


def test_a_row_that_failed_is_told_and_one_without_words_is_found() -> None:
    row = {"method": "m", "level": "1", "error": 0.5, "seconds": 1.0, "failed": ""}
    assert gather._failure(row) == ""
    assert gather._failure(row | {"error": None, "failed": "refused: too stiff"}) == "m, 1: refused: too stiff"
    assert gather._failure(row | {"error": None}).endswith(gather.UNEXPLAINED)
    entry = {"place": "p", "quantity": "q", "verdict": "failed", "reason": "ValueError: x"}
    assert gather._failure(entry) == "p, q: ValueError: x"
    assert gather._failure(entry | {"verdict": "differs"}) == ""


def test_an_interruption_ends_what_runs(tmp_path: Path) -> None:
    def stop(_: float) -> None:
        raise KeyboardInterrupt

    jobs = [Job(name="no-such", kind="stability"), Job(name="twist-stress", kind="stability")]
    with pytest.raises(KeyboardInterrupt):
        gather.gather(jobs, tmp_path, quick=True, progress=stop)


def test_an_index_overwrites_nothing_unasked(tmp_path: Path, capsys) -> None:
    (tmp_path / "index.csv").write_text("mine")
    assert cli.run(["report", "all", "--quick", "--out", str(tmp_path)]) == 2
    assert "not overwritten" in capsys.readouterr().err
    assert cli.run(["report", "stability", "--recording", "x", "--out", str(tmp_path)]) == 2


def test_a_timed_report_runs_alone_and_the_others_together(tmp_path: Path, monkeypatch) -> None:
    running, most = list[str](), dict[str, int]()

    def slow(job: Job, *_) -> gather.Made:
        running.append(job.name)
        time.sleep(0.1)
        most[job.name] = len(running)
        running.remove(job.name)
        return gather.Made(job=job, rows=1, failures=(), seconds=0.1, why="", files=())

    monkeypatch.setattr(gather, "_make", slow)
    monkeypatch.setattr(gather.os, "cpu_count", lambda: 2)
    jobs = [Job(name=name, kind="k", timed=name in "ace") for name in "abcdef"]
    found = gather.gather(jobs, tmp_path, quick=False, progress=lambda _: None)
    assert [made.job.name for made in found] == list("abcdef")
    assert {name for name, count in most.items() if count == 1} >= set("ace")
    assert max(most[name] for name in "bdf") == 2
