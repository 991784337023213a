"""Other tools, run beside ours for comparison: each in an environment of its own, never imported here."""

import json
import os
import subprocess
import sys
import venv
from hashlib import sha256
from pathlib import Path
from typing import Any

from data.errors import CatheterError

SCRIPTS = Path(__file__).with_name("peer_scripts")


def run_peer(script: str, requirements: tuple[str, ...], task: dict[str, Any], *, timeout_s: float = 600.0) -> Any:
    """Return what a script of `peer_scripts` prints last, JSON; task: what it is asked.

    Its environment is made once, in the user's cache folder, from the package index. Raises
    CatheterError when that or the script fails.
    """
    python = _environment(requirements)
    command = [str(python), str(SCRIPTS / script), json.dumps(task)]
    one_thread = os.environ | {"OMP_NUM_THREADS": "1"}  # as ours: with two, small blocks wait for one another
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=timeout_s, env=one_thread)
    lines = done.stdout.splitlines()
    if done.returncode or not lines:
        said = done.stderr.strip().splitlines()
        raise CatheterError(f"{script} failed: {said[-1][:200] if said else f'code {done.returncode}'}")
    return json.loads(lines[-1])


def _environment(requirements: tuple[str, ...]) -> Path:
    """Return the Python of an environment that holds the requirements."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = cache / "catheter-peers" / sha256(" ".join(requirements).encode()).hexdigest()[:16]
    python = folder / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
    if not (folder / "complete").exists():
        venv.create(folder, with_pip=True, clear=True)
        command = [str(python), "-m", "pip", "install", "--quiet", *requirements]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            said = done.stderr.strip().splitlines()
            raise CatheterError(f"{', '.join(requirements)} cannot be installed: {said[-1][:200] if said else ''}")
        (folder / "complete").touch()
    return python
