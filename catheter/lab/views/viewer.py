"""A viewer without a window, for pictures: started, asked, and never left behind."""

import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

# Runs beside the viewer, in one process group with it. The pipe on its input closes when we end,
# however we end; then it clears up and kills the group, so that not even a killed session leaves a
# viewer.
GUARD = """
import os, shutil, signal, subprocess, sys, threading

def end():
    os.read(0, 1)
    shutil.rmtree(sys.argv[1], ignore_errors=True)
    os.killpg(0, signal.SIGKILL)

threading.Thread(target=end, daemon=True).start()
viewer = [sys.executable, "-P", "-m", "rerun_cli", *sys.argv[2:]]
os._exit(subprocess.call(viewer, stdin=subprocess.DEVNULL) & 255)
"""


@dataclass(frozen=True)
class Viewer:
    """A running viewer: where it is asked, its process, and where it prints."""

    url: str
    process: "subprocess.Popen[bytes]"
    log: Path

    @property
    def ended(self) -> bool:
        """Whether it ended by itself."""
        return self.process.poll() is not None

    def printed(self) -> str:
        """Return what it has printed."""
        return self.log.read_text("utf-8", errors="replace")


@contextmanager
def viewer(size: tuple[int, int]) -> Iterator[Viewer]:
    """Run a viewer without a window, of `size` pixels, for the length of the block.

    It listens on 127.0.0.1 alone, keeps its settings in a temporary folder, where its collection
    of usage data is off, and leaves the user's own settings as they are.
    """
    with tempfile.TemporaryDirectory(prefix="catheter-viewer-") as name:
        home, port = Path(name), _free_port()
        arguments = [
            *("--headless", "--hide-welcome-screen", "--bind", "127.0.0.1", "--port", str(port)),
            *("--renderer", "vulkan", "--window-size", f"{size[0]}x{size[1]}"),
        ]
        log = home / "log"
        with log.open("wb") as output:
            process = subprocess.Popen(
                [sys.executable, "-I", "-c", GUARD, name, *arguments],
                stdin=subprocess.PIPE,
                stdout=output,
                stderr=output,
                env=_environment(home),
                start_new_session=True,
            )
        try:
            yield Viewer(f"rerun+http://127.0.0.1:{port}/proxy", process, log)
        finally:
            _end(process)


def _end(process: "subprocess.Popen[bytes]") -> None:
    """Kill the viewer's whole group and wait until none of it runs."""
    assert process.stdin is not None
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    process.stdin.close()
    for _ in range(100):  # the viewer itself is no child of ours: poll until its group is empty
        try:
            os.killpg(process.pid, 0)
        except (ProcessLookupError, PermissionError):
            return
        time.sleep(0.02)


def _environment(home: Path) -> dict[str, str]:
    """Return our environment with the viewer's own folders, in which it is told to collect nothing."""
    config, data = home / "config" / "rerun", home / "data"
    config.mkdir(parents=True)
    settings = {
        "analytics_enabled": False,
        "analytics_id": "",
        "metadata": {},
        "config_file_path": str(config / "analytics.json"),
        "data_dir_path": str(data),
    }
    (config / "analytics.json").write_text(json.dumps(settings), "utf-8")
    folders = {"XDG_CONFIG_HOME": str(home / "config"), "XDG_DATA_HOME": str(data), "XDG_RUNTIME_DIR": str(home)}
    folders["TMPDIR"] = str(home)  # where it leaves folders behind when it is killed
    return os.environ | folders | {"RERUN_APP_ONLY": "true"}


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
