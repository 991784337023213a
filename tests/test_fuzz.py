"""Hostile inputs: a sample of what `report fuzz` tries by the thousand, and the fuzzer's own eyes."""

import signal
import subprocess
import sys

import numpy as np
import pytest

from catheter.lab import fuzz
from catheter.lab.fuzz_inputs import FUZZED


@pytest.mark.parametrize("kind", FUZZED)
def test_hostile_inputs_cause_no_traceback_no_hang_and_no_file_astray(kind: str) -> None:
    answers = list(fuzz.run_kind(kind, 10))
    assert [finding for _, _, finding in answers if finding] == []
    assert {code for code, _, _ in answers} <= {0, 2}
    assert len(answers) == 10


def test_the_same_number_makes_the_same_input(tmp_path) -> None:
    for kind, make in FUZZED.items():
        made = []
        for name in ("a", "b"):
            home = tmp_path / kind / name
            (home / "in").mkdir(parents=True)
            arguments = [one.replace(str(home), "") for one in make(np.random.default_rng(5), home)]
            made.append((arguments, sorted((p.name, p.read_bytes()) for p in (home / "in").iterdir())))
        assert made[0] == made[1]


BROKEN = """
import json, sys, time
print(json.dumps({"code": 0, "seconds": 0.0, "what": ""}), flush=True)
if int(sys.argv[3]) == 0:
    sys.exit(1)
time.sleep(60)
"""


def test_a_process_that_dies_or_hangs_is_a_finding_and_the_next_input_goes_on(monkeypatch) -> None:
    monkeypatch.setattr(fuzz, "_WORKER", BROKEN)
    monkeypatch.setattr(fuzz, "WAIT_S", 1.0)
    answers = list(fuzz.run_kind("scenes", 4))
    found = [finding and finding.what for _, _, finding in answers]
    assert found == [None, "died, or worked for 30 s", None, "no answer within 1 s"]


def test_an_input_that_works_for_ever_ends_its_process() -> None:
    code = "from catheter.lab.fuzz import _alarm\n_alarm(0.2)\nwhile True: pass"
    done = subprocess.run([sys.executable, "-c", code], timeout=300, check=False)
    assert done.returncode == -signal.SIGPROF


def test_the_fuzzer_sees_what_it_looks_for(tmp_path, monkeypatch) -> None:
    from catheter.lab import cli

    for code, written, found in (
        (0, "", ""),
        (1, "error: a fault", "exit code 1"),
        (2, "", "without a word"),
        (2, "Traceback (most", "traceback"),
        (2, "error: \x1b[31m", "control"),
    ):

        def run(_: list[str], code: int = code, written: str = written) -> int:
            import sys

            print(written, end="", file=sys.stderr)
            return code

        monkeypatch.setattr(cli, "run", run)
        assert found in fuzz._run(["x"])[1]
        assert bool(fuzz._run(["x"])[1]) == bool(found)

    def leave(_: list[str]) -> int:
        raise SystemExit(3)

    monkeypatch.setattr(cli, "run", leave)
    assert "SystemExit" in fuzz._run(["x"])[1]
