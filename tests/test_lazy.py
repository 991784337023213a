"""Imports stay lazy: what a scene does not need is not loaded, in a fresh process."""

import subprocess
import sys
import time

import pytest
from helpers import ROOT

HEAVY = {"cv2", "rerun", "pandas", "control", "fmpy", "filterpy", "matplotlib", "numba", "scipy", "pint", "rich"}
HEAVY |= {"trimesh", "networkx", "lxml"}


def loaded(code: str) -> set[str]:
    """Run code in a fresh process; return the top-level modules it loaded."""
    script = f"import sys\n{code}\nprint(*sorted({{name.partition('.')[0] for name in sys.modules}}))"
    done = subprocess.run([sys.executable, "-c", script], cwd="/", capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize(
    ("code", "allowed"),
    [
        ("import data.recording", set()),
        ("import data.recorder", set()),
        ("import data.csv_import", set()),
        ("import catheter.bench", set()),
        ("import catheter.search, catheter.refine, catheter.locomotion, catheter.valve", set()),
        ("import catheter.bench_runs", set()),
        ("import catheter.target, catheter.occlusion, fem.print_files, fem.slices", set()),
        ("from catheter.lab.scene import Scene; Scene.load('renal_spiral')", {"pint", "scipy"}),
        ("import catheter.lab.fit_commands", set()),
        ("import catheter.lab.cli", set()),
        ("import catheter.lab.scene", set()),
        ("import catheter.lab.replay", set()),
        ("import sysid.fit", {"numba", "scipy"}),  # numba itself asks whether scipy is there
        ("from catheter.lab.scene import Scene; Scene.load('bender')", {"pint", "scipy"}),  # and so does pint
        (
            "from catheter.lab.scene import Scene; from catheter.search import search\n"
            "search(Scene.load('free').tables['task'])",
            {"pint", "scipy"},
        ),
        (
            "from catheter.lab.replay import Replay; from data.recording import Recording\n"
            "from catheter.lab.recording_commands import SHIPPED\n"
            "r = Replay(Recording(SHIPPED)); r.signals; r.title",
            {"numba", "scipy"},  # the reader's compiled loops
        ),
        (
            "from catheter.lab.replay import Replay; from data.recording import Recording\n"
            "from catheter.lab.recording_commands import SHIPPED\n"
            "Replay(Recording(SHIPPED)).models",
            {"numba", "scipy", "pint"},
        ),
    ],
)
def test_only_what_is_needed_is_loaded(code: str, allowed: set[str]) -> None:
    assert loaded(code) & HEAVY <= allowed


def test_the_instruments_do_not_know_the_robot_nor_each_other() -> None:
    assert not loaded("import sysid.fit") & {"catheter", "vision", "fem"}


def test_help_costs_at_most_three_times_numpy() -> None:
    def seconds(*command: str) -> float:
        taken = []
        for _ in range(5):
            started = time.perf_counter()
            subprocess.run([sys.executable, *command], cwd="/", capture_output=True, check=True)
            taken.append(time.perf_counter() - started)
        return min(taken)

    assert seconds("-m", "catheter", "--help") < 3 * seconds("-c", "import numpy")


def test_our_packages_are_the_ones_that_python_finds() -> None:
    from catheter.__main__ import PACKAGES, namesakes

    assert namesakes() == []
    for name in PACKAGES:
        script = f"import {name}; print({name}.__file__)"
        done = subprocess.run([sys.executable, "-c", script], cwd="/", capture_output=True, text=True, check=True)
        assert done.stdout.strip() == str(ROOT / name / "__init__.py")
