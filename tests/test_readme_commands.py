"""Every command of the README runs as it is written: no command without a run.

Each runs in an empty folder, with the inputs that it names. What a name in capitals stands for is said in one table;
a name that nobody prepares fails its test. What would take long is run smaller, and one table says how.
"""

import re
import runpy
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers import DRIVERS, NO_DRIVER, ROOT, SIMULATED

from catheter.lab import cli, outcome, report_commands
from catheter.lab.scene import FOLDER
from catheter.lab.vision_shots import qr_shot
from data.recorder import Recorder
from data.signal import Signal
from data.topics import Topic
from vision.render import Shot, render

README = (ROOT / "README.md").read_text(encoding="utf-8")
PROGRAMS = ("python", "python3", "pip", "rerun", "apt-get", "lint-imports", "ruff", "mypy")
OUTPUTS = (
    "--out",
    "--view",
    "--picture",
    "--vtu",
    "--accumulator",
    "--pwm",
    "--salvage",
    "--print",
)  # what follows is written

# Scenes that take long as they are shipped: what is replaced in their text. Other tests are about their sizes.
SMALL = {
    "chirp": {'"1800 s"': '"60 s"'},
    "printed": {
        "divisions = [32, 32, 1]": "divisions = [8, 8, 1]\nvoxels = [8, 8]",
        "period = 16\nwidth = 4": "period = 4\nwidth = 1",
        'most = "95 kPa"\ntime = "16 s"\nwait = "2 s"': 'most = "40 kPa"\ntime = "3 s"\nwait = "1 s"\n'
        '[cameras]\nflashes = ["0.237 s", "4.311 s"]',
    },
    "twist": {
        "divisions = [32, 32, 2]": "divisions = [16, 16, 1]",
        "[32, 32]": "[16, 16]",
        ', "75 kPa", "100 kPa"': "",
    },
    "invert_twist": {
        "[32, 32, 1]": "[8, 8, 1]",
        "[32, 32]": "[8, 8]",
        "period = 16\nwidth = 4": "period = 4\nwidth = 1",
    },
    "robot": {
        '"locomotion.toml"': f'"{FOLDER / "locomotion.toml"}"',
        "frames = 48": "frames = 12",
        "divisions = [32, 32, 1]": "divisions = [8, 8, 1]\nvoxels = [8, 8]",
        "period = 16\nwidth = 4": "period = 4\nwidth = 1",
        "period = 8\nwidth = 3": "period = 4\nwidth = 1",
        '"90 kPa"': '"30 kPa"',
    },
    "marked": {
        "[32, 32, 1]": "[8, 8, 1]",
        "[32, 32]": "[8, 8]",
        '"32 mm"': '"16 mm"',
        "period = 16\nwidth = 4": "period = 4\nwidth = 1",
    },
    "invert_spiral": {
        **{"[32, 32, 1]": "[8, 8, 1]", "[32, 32]": "[8, 8]", "most_iterations = 8": "most_iterations = 2"},
        **{"[0.1, 0.2, 0.3, 0.6, 1.0]": "[0.1]", '["60 kPa", "150 kPa"]': '["60 kPa"]'},
    },
}
# What takes long even so, reports with --quick, is interrupted as soon as its first part is done.
BEGUN = {
    *("fuzz", "inverse", "inverse-stability", "inverse-spiral", "calibration", "recordings", "damage", "hydraulics"),
    *("fem", "fem-stability", "shape", "identification", "twist", "twist-stress", "twist-containers", "camera-clock"),
    *("thesis", "derivatives", "shape-pictures", "sysid-stability"),
}
ELSEWHERE = {  # what another file runs, and the words that do so there
    "python3 -m venv": (".ci/run", 'eval "$(block install)"'),
    ". .venv/bin/activate": (".ci/run", 'eval "$(block install)"'),
    "pip install": (".ci/run", 'eval "$(block install)"'),
    "python -m pytest": (".ci/run", 'eval "$(block test)"'),
    "apt-get install": (".ci/run", "apt-get install"),
    "lint-imports": (".ci/run", "lint-imports"),
    "python -m catheter tune": ("tests/test_circuit_cli.py", 'cli.run(["tune"'),
    "rerun twist.rrd": (".ci/run", "rerun rrd verify twist.rrd"),
    "record printed_again --map": ("tests/test_printed_bench.py", "with_map(Scene.parse(scene"),
    "redesign twist.mcap": ("tests/test_printed_bench.py", 'cli.run(["redesign"'),
    "report directions": ("tests/test_directions.py", 'cli.run(["report", "directions"'),
    "report free": ("tests/test_search.py", 'cli.run(["report", "free", "--quick"'),
    "report free-stability": ("tests/test_search.py", 'cli.run(["report", "free-stability"'),
    "report hydraulics-stability": (
        "tests/test_circuit_cli.py",
        'cli.run(["report", "hydraulics-stability", "--quick"',
    ),
    "report selection": ("tests/test_report.py", 'cli.run(["report", "selection", "--quick"'),
    "report sysid-recordings": ("tests/test_report.py", 'cli.run(["report", "sysid-recordings", "--quick"'),
}
OPTIONS = {  # options that stand alone in the text, and the command that takes them
    "--json": "table 3.3",
    "--debug": "table 3.3",
    "--force": "replay --out FILE.rrd",
    "--mapping": "import LOG --out FILE.mcap",
    "--step": "free",
    "--torsion": "free",
    "--out spiral.rrd": "free",
    "--validate": "fit FILE.mcap --model bender",
    "--signed": "fit FILE.mcap --model bender",
    "--volume": "inflate twist",
    "--slices": "print twist7 --out FOLDER",
    "--marker": "twist CODES",
    "--out twist.mcap": "twist VIDEO --origin simulated",
    "--again data": "replay data/recordings/twist.mcap --no-view",
    "--print DIR": "replay data/recordings/twist.mcap --no-view",
    "--until twin": "replay data/recordings/twist.mcap --no-view",
    "--sweep": "invert invert_twist",
    "--out MAP.npz": "invert invert_twist",
    "--view FILE.rrd": "invert invert_twist",
    "--rate": "twist VIDEO --origin simulated",
    "--split": "replay STEPS.mcap",
    "--response": "replay MARKERS.mcap",
}


def written() -> Iterator[str]:
    """Yield every command of the README: lines of its shell blocks, and code in its text and tables."""
    for block in re.findall(r"```bash\n(.*?)```", README, flags=re.DOTALL):
        for line in block.splitlines():
            yield from line.split(" && ")
    for code in re.findall(r"`([^`]+)`", re.sub(r"```.*?```", "", README, flags=re.DOTALL)):
        first, *more = code.split()
        if first in PROGRAMS or first.startswith("--") or (first in cli.COMMANDS and more):
            yield " ".join(code.split())
    (names,) = re.findall(r"`python -m catheter report NAME`: ([^|]*)\|", README)
    yield from (f"report {name}" for name in re.findall(r"`([\w-]+)`", names))


def told(command: str) -> list[str]:
    """Return a command's words: without `python -m catheter`, and with the command that an option alone belongs to."""
    if command.startswith("--"):
        found = [key for key in OPTIONS if command.startswith(key)]
        command = f"{OPTIONS[found[0]]} {command}" if found else command
    words = shlex.split(command)
    return words[3:] if words[:3] == ["python", "-m", "catheter"] else words


def elsewhere(command: str) -> list[str]:
    """Return the entries of ELSEWHERE for a command."""
    return [start for start in ELSEWHERE if f"{command} ".startswith(f"{start} ")]


FOUND = list(dict.fromkeys(written()))
HERE = {shlex.join(told(one)): told(one) for one in FOUND if not elsewhere(one)}


# What the README's names stand for ---------------------------------------------------------------------------------


def small(name: str, path: Path) -> Path:
    """Write a shipped scene, smaller."""
    text = (FOLDER / f"{name}.toml").read_text(encoding="utf-8")
    for long, short in SMALL[name].items():
        assert long in text, f"{name}.toml no longer has {long!r}"
        text = text.replace(long, short)
    path.write_text(text, encoding="utf-8")
    return path


def run(*words: object) -> None:
    assert cli.run([str(word) for word in words]) == 0


def chirp(path: Path) -> None:
    run("record", small("chirp", path.with_suffix(".toml")), "--out", path)


def filmed(path: Path) -> None:
    run("record", small("printed", path.with_suffix(".toml")), "--out", path)


def marked(path: Path) -> None:
    run("record", small("marked", path.with_suffix(".toml")), "--out", path)


def accumulator(path: Path) -> None:
    run("record", "accumulator", "--out", path.with_suffix(".mcap"))
    run("fit", path.with_suffix(".mcap"), "--model", "accumulator", "--rest-volume", "20 mL", "--out", path)


def recorded(path: Path, units: dict[str, str], *, steps: float = 0.0) -> None:
    """Record sines, or a staircase with so many steps a second."""
    time_s = np.arange(400) / 20
    with Recorder(path, SIMULATED) as recorder:
        for k, (name, unit) in enumerate(units.items()):
            topic, *parts = name.split(":")
            recorder.add(Topic(name=topic, components=tuple(parts) or ("value",), units=(unit,) * max(1, len(parts))))
            values = np.floor(steps * time_s) if steps else 1 + np.sin(time_s - 0.1 * k)
            columns = np.stack([5e3 * values] * len(parts), axis=1) if parts else 5e3 * values
            recorder.write_signals({topic: Signal(time_s, columns, unit, components=tuple(parts))})


def video(path: Path, shots: list[Shot]) -> None:
    size = shots[0].width_px, shots[0].height_px
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30, size)
    for k, shot in enumerate(shots):
        writer.write(cv2.cvtColor(render(shot, k), cv2.COLOR_GRAY2BGR))
    writer.release()


def turning(path: Path) -> None:
    shot = {"width_px": 240, "height_px": 200, "middle_px": (120.0, 100.0), "pitch_px": 60.0}
    video(path, [Shot(angle_rad=0.05 * k, **shot) for k in range(9)])


def tensile(path: Path) -> None:
    stretch = np.linspace(1, 1.8, 40)
    stress = 2 * 0.2 * (stretch - stretch**-2)
    rows = [f"1,1,{x - 1:.5f},{y:.6f}" for x, y in zip(stretch, stress, strict=True)]
    path.write_text("\n".join(["plate,spec,strain,stress_MPa", *rows]))


def log(path: Path) -> None:
    rows = [[10 * k, 0, 0, 0, np.sin(k / 5), 1.0, np.cos(k / 5)] for k in range(60)]
    path.write_text("\n".join("\t".join(f"{number:g}" for number in row) for row in rows))


INPUTS: dict[str, tuple[str, Callable[[Path], object]]] = {  # name in the README -> file, and what makes it
    **dict.fromkeys(("FILE.mcap", "CHIRP.mcap", "OTHER.mcap"), ("chirp.mcap", chirp)),
    "twist.mcap": ("film.mcap", filmed),
    "data/recordings/twist.mcap": ("film.mcap", filmed),  # the shipped one is as sound, and longer
    "RUN.mcap": ("gauge.mcap", lambda path: recorded(path, {"/pressure": "Pa"})),
    "MARKERS.mcap": (
        "markers.mcap",
        lambda path: recorded(path, {"/markers:m4_x:m4_y": "m", "/stroke": "m", "/pressure": "Pa"}),
    ),
    "STEPS.mcap": ("steps.mcap", lambda path: recorded(path, {"/stroke": "m", "/force": "N"}, steps=0.5)),
    "spring.toml": ("accumulator.toml", accumulator),
    "fit.toml": ("accumulator.toml", accumulator),
    "data/recordings/twist_again.mcap": ("film.mcap", filmed),
    "markers.mcap": (
        "skin.mcap",
        lambda path: run("record", small("marked", path.with_suffix(".toml")), "--out", path),
    ),
    "v.mcap": ("valve.mcap", lambda path: run("record", "valve", "--out", path)),
    "TESTS.csv": ("tests.csv", tensile),
    "VIDEO": ("turning.avi", turning),
    "VIDEO|FOLDER|RECORDING": ("turning.avi", turning),
    "CODES": ("codes.avi", lambda path: video(path, [qr_shot(np.random.default_rng(k)) for k in range(2)])),
    "LOG": ("log.tsv", log),
    "NAME": ("zillen.toml", lambda path: shutil.copy(ROOT / "data" / "mappings" / "zillen.toml", path)),
    "my.toml": ("zillen.toml", lambda path: shutil.copy(ROOT / "data" / "mappings" / "zillen.toml", path)),
    "MAP": ("map.toml", lambda path: shutil.copy(ROOT / "data" / "maps" / "twist.toml", path)),
    "invert SCENE": ("invert_twist.toml", lambda path: small("invert_twist", path)),
    "SCENE": ("renal_balloon.toml", lambda path: shutil.copy(FOLDER / "renal_balloon.toml", path)),
    "bender.rrd": ("bender.rrd", lambda path: run("replay", "--out", path)),
    **{name: (f"{name}.toml", lambda path: small(path.stem, path)) for name in SMALL},
}


class Bench:
    """A folder of inputs, each made once, when a command first names it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def words(self, words: list[str]) -> list[str]:
        """Put files in the place of inputs' names; outputs and what is no name stay."""
        found = words[:1]
        for before, word in pairwise(words):
            known = f"{words[0]} {word}" if f"{words[0]} {word}" in INPUTS else word
            if before in OUTPUTS or words[0] in ("fmu", "report"):
                found.append(word)
            elif word.partition("=")[2] in INPUTS:
                head, _, tail = word.partition("=")
                found.append(f"{head}={self.made(tail)}")
            elif known in INPUTS:
                found.append(self.made(known))
            else:
                assert not re.search(r"\b[A-Z]{3,}\b", word), f"{word}: nobody prepares it"
                found.append(word)
        return found

    def made(self, name: str) -> str:
        file, make = INPUTS[name]
        if not (self.folder / file).exists():
            make(self.folder / file)
        return str(self.folder / file)


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    return Bench(tmp_path_factory.mktemp("bench"))


@pytest.mark.parametrize("command", HERE)
def test_the_command_runs(
    command: str,
    bench: Bench,
    tmp_path: Path,
    request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if HERE[command][:2] == ["report", "materials"]:
        request.getfixturevalue("real")  # or skipped, with the reason
    if "--picture" in HERE[command] and not DRIVERS:
        pytest.skip(NO_DRIVER)
    words = bench.words(HERE[command])
    monkeypatch.chdir(tmp_path)
    if words[0] == "python":
        monkeypatch.setattr(sys, "argv", words[1:])
        runpy.run_path(str(ROOT / words[1]), run_name="__main__")
    elif words[0] == "rerun":  # no window: that the file is sound
        program = Path(sys.executable).with_name("rerun")
        subprocess.run([program, "rrd", "verify", *words[1:]], check=True, capture_output=True, timeout=120)
    else:
        assert words[0] in cli.COMMANDS, f"{words[0]}: who runs it?  ELSEWHERE, OPTIONS"
        begun = words[0] == "report" and HERE[command][1] in BEGUN
        if begun:
            monkeypatch.setattr(outcome, "progress", stopping)
            monkeypatch.setattr(report_commands, "progress", stopping)
        assert cli.run(quick(words, monkeypatch)) == (130 if begun else 0)
        assert not begun or list(tmp_path.iterdir()) == []  # what is interrupted leaves nothing
    assert all(Path(path).exists() for option, path in pairwise(words) if option in OUTPUTS)


@contextmanager
def stopping(_: str) -> Iterator[Callable[[float], None]]:
    """Stand in for a progress bar: interrupt when the first part is done."""

    def stop(share: float) -> None:
        raise KeyboardInterrupt

    yield stop


def quick(words: list[str], monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return a report's words with --quick, and let one that gathers others gather two."""
    if words[0] != "report":
        return words
    words = ["valves" if word == "NAME" else word for word in words]
    if words[1] in report_commands.GATHERED:
        kept = {name: report_commands.STUDIES[name] for name in ("valves", "free-stability")}
        monkeypatch.setattr(report_commands, "STUDIES", kept)
        monkeypatch.setattr(report_commands, "THESIS", "valves")
    return [*words, *([] if "--quick" in words else ["--quick"])]


def test_what_is_run_elsewhere_is_run_there() -> None:
    for start, (file, words) in ELSEWHERE.items():
        assert words in (ROOT / file).read_text(encoding="utf-8"), start
        assert any(start in elsewhere(command) for command in FOUND), f"{start}: the README no longer has it"
