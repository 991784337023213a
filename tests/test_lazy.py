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
    ],
)
def test_only_what_is_needed_is_loaded(code: str, allowed: set[str]) -> None:
    assert loaded(code) & HEAVY <= allowed


OPTIONS = {"catheter", "data", "numpy"}  # what every scene is read with
PINT = {"pint", "flexcache", "flexparser", "platformdirs", "typing_extensions", "scipy", "cython_runtime"}
BENCH = OPTIONS | PINT | {"sysid"}  # sysid: the test signals
INVERSE = [f"invert_{name}" for name in ("balloon", "bend", "cube", "fine", "graded", "spiral", "twist")]
SCENES = {  # every package, the project's and others', that reading a shipped scene loads
    "accumulator": BENCH,
    "bender": OPTIONS | PINT,
    "chirp": BENCH,
    "chirp_constrained": BENCH,
    "cone": OPTIONS,
    "cracking": BENCH,
    "free": OPTIONS | PINT,
    "inflection": OPTIONS | PINT,
    **dict.fromkeys(INVERSE, OPTIONS | PINT | {"fem", "numba", "llvmlite"}),
    "locomotion": OPTIONS | PINT,
    "marked": OPTIONS | PINT | {"fem", "numba", "llvmlite"},
    "printed": OPTIONS | PINT,
    "printed_again": OPTIONS | PINT,
    "ramp": BENCH,
    "renal_balloon": OPTIONS | PINT,
    "renal_spiral": OPTIONS | PINT,
    "robot": OPTIONS | PINT,
    "staircase": BENCH,
    "twist": OPTIONS | PINT,
    "twisting": OPTIONS | PINT,
    "valve": BENCH,
}
SHAPE = {
    "centreline", "curve", "equal_volume", "frames", "motions", "polyline", "shape", "vessel_files", "vtk_lines",
}  # fmt: skip
WALK = {"circuit", "drive", "free", "helix", "hydraulics", "periodic", "robot", "task", "tuning"}
OWN = {  # and the modules of the robot it loads: no scene knows what another is about
    "accumulator": {"actuator", "bench", "bench_runs"},
    "bender": {"bench"},
    "cone": {"free", "valve"},
    "free": {"free", "helix", "refine", "robot", "task"},
    "locomotion": WALK,
    "inflection": SHAPE,
    **{name: {"inflatable", "reconstruction"} for name in INVERSE},
    "invert_spiral": SHAPE | {"inflatable", "reconstruction", "reach"},
    "marked": {"inflatable", "marker_bench", "printed_bench"},
    "printed": {"inflatable", "printed_bench"},
    "printed_again": {"inflatable", "printed_bench"},
    "renal_balloon": SHAPE,
    "renal_spiral": SHAPE,
    "robot": WALK | {"end_effector", "gait", "inflatable", "locomotion", "response"},
    "twist": {"inflatable"},
    "twisting": SHAPE,
}


def test_a_scene_loads_its_own_instruments_only() -> None:
    from concurrent.futures import ThreadPoolExecutor

    from catheter.lab.scene import names

    groups: dict[tuple[frozenset[str], frozenset[str]], list[str]] = {}  # scenes that may load the same share a process
    for name, allowed in SCENES.items():
        groups.setdefault((frozenset(allowed), frozenset(OWN.get(name, OWN["accumulator"]))), []).append(name)

    def packages(scenes: list[str]) -> tuple[set[str], set[str]]:
        code = f"from catheter.lab.scene import Scene\nfor name in {scenes}: Scene.load(name)"
        script = f"import sys\n{code}\nprint(*sys.modules)"
        done = subprocess.run([sys.executable, "-c", script], cwd="/", capture_output=True, text=True, check=True)
        modules = done.stdout.split()
        tops = {module.partition(".")[0] for module in modules} - set(sys.stdlib_module_names)
        own = {module.split(".")[1] for module in modules if module.startswith("catheter.")} - {"lab"}
        return {top for top in tops if not top.startswith("_")}, own

    assert names() == sorted(SCENES)  # a new scene is listed here
    with ThreadPoolExecutor(2) as pool:
        found = zip(groups.items(), pool.map(packages, groups.values()), strict=True)
    for ((allowed, modules), scenes), (loaded_packages, own) in found:
        assert loaded_packages <= allowed, scenes  # fewer where pint finds less installed
        assert loaded_packages & {"sysid", "vision", "fem"} == allowed & {"sysid", "vision", "fem"}, scenes
        assert own == modules, scenes


def test_a_replay_loads_what_its_stages_need() -> None:
    bender = loaded("from catheter.lab.cli import run; run(['replay', '--no-view'])")
    assert bender & HEAVY <= {"numba", "scipy", "pint", "rich"}
    assert not bender & {"fem", "vision"}
    film = str(ROOT / "data" / "recordings" / "twist.mcap")
    clocks = loaded(f"from catheter.lab.cli import run; run(['replay', {film!r}, '--until', 'clocks'])")
    assert "vision" in clocks
    assert not clocks & {"fem", "sysid", "rerun", "matplotlib"}


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
