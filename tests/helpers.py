"""What several test files use."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
SIMULATED = {"kind": "simulated", "title": "test"}


def catheter(*arguments: object, cwd: Path, env: dict[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    """Run the command line in a fresh process, from another folder."""
    command = [sys.executable, "-m", "catheter", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=300, env=env, check=False)
