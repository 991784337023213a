"""The README is true: its programs run, its pictures and files exist."""

import re
import subprocess
import sys
from pathlib import Path

from helpers import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_programs_of_the_readme_run_in_order(tmp_path: Path) -> None:
    programs = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    assert len(programs) == 3
    for program in programs:
        done = subprocess.run(
            [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
    checked = "from data.recording import Recording; r = Recording('run.mcap'); print(len(r.signal('/pressure/1')))"
    done = subprocess.run([sys.executable, "-c", checked], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout == "100\n"


def test_what_the_readme_shows_and_names_is_there() -> None:
    for path in re.findall(r"\]\(([^)]+)\)", README):
        assert (ROOT / path).is_file(), path
    for name in re.findall(r"`((?:data|sysid|vision|fem|catheter)(?:\.(?!py`)[a-z_]+)+)`", README):
        path = ROOT / Path(*name.split("."))
        assert path.with_suffix(".py").is_file() or path.is_dir(), name


def test_every_dependency_has_a_row() -> None:
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    rows = README[README.index("| dependency |") :]
    for requirement in (*project["dependencies"], *project["optional-dependencies"]["dev"]):
        name = re.match(r"[a-z0-9-]+", requirement)
        assert name is not None
        stub = "stubs" in requirement or requirement.startswith("types-")
        assert stub or name.group() in rows, requirement
