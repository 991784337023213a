"""FMUs of other tools as sources of pressure: each runs in a process of its own, for it may hang or crash."""

import json
import os
import signal
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from catheter.drive import Drive, recorded
from data.errors import BadInput
from data.options import option
from data.signal import Array, Signal
from data.units import quantity

MOST_BYTES = 1 << 30  # unpacked


@dataclass(frozen=True, kw_only=True)
class FmuSource:
    """An FMU as the source of pressure: its output of that name, sampled every `step`, straight between samples.

    unit: of the output, for an FMU that does not state one. An FMU is a program: run those you trust.
    """

    path: str
    output: str
    unit: str = ""
    step: float = option(0.01, unit="s", least=1e-6, most=1e3)
    timeout: float = option(60.0, unit="s", least=0.1, most=1e5)

    def drive(self, end_s: float) -> Drive:
        """Run it from 0 to end_s. Raises BadInput for what is no FMU, cannot run here, hangs or crashes."""
        found = run(Path(self.path), (self.output,), end_s, step_s=self.step, timeout_s=self.timeout)
        place, stated = f"{self.path}, {self.output}", found.units[self.output]
        if not (stated or self.unit):
            raise BadInput(place, "states no unit", "name it with `unit`")
        if self.unit and stated not in ("", self.unit):
            raise BadInput(place, f"is in {stated}, `unit` says {self.unit}", "leave `unit` out")
        pressure_pa = quantity(f"1 {stated or self.unit}", "Pa", place) * found.values[self.output]
        return recorded(Signal(found.time_s, pressure_pa, "Pa", name=place))


@dataclass(frozen=True, eq=False)
class FmuRun:
    """A run of an FMU: times (n,) in s, each output (n,) in its own unit, and those units ("" where none is stated)."""

    time_s: Array
    values: dict[str, Array]
    units: dict[str, str]


def run(
    path: Path,
    outputs: tuple[str, ...],
    end_s: float,
    *,
    step_s: float,
    kind: str = "",
    inputs: dict[str, Array] | None = None,
    tolerance: float = 1e-6,
    timeout_s: float = 60.0,
) -> FmuRun:
    """Run an FMU in a process of its own and return its outputs.

    kind: "ModelExchange" (with SUNDIALS CVode) or "CoSimulation", by default what it offers.
    inputs: "time" (m,) and values (m,) by name, straight between them; a time twice is a jump.
    Raises BadInput for an archive that is none, climbs out of its folder or is too large, for a
    missing binary or output, for a model that fails, crashes, or takes longer than timeout_s.
    """
    with _unpacked(path) as folder:
        task = {"fmu": str(folder / "fmu"), "outputs": outputs, "end": end_s, "step": step_s, "kind": kind}
        task |= {"tolerance": tolerance, "inputs": inputs is not None, "folder": str(folder)}
        if inputs:
            np.savez(folder / "inputs.npz", allow_pickle=False, **inputs)
        units = _child(path, task, timeout_s)
        with np.load(folder / "result.npz") as result:
            return FmuRun(result["time"], {name: result[name] for name in outputs}, units)


def _child(path: Path, task: dict[str, Any], timeout_s: float) -> dict[str, str]:
    command = [sys.executable, "-m", "catheter.fmu_child", json.dumps(task)]
    root = {"PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "stdin": subprocess.DEVNULL}
    with subprocess.Popen(command, text=True, env=os.environ | root, start_new_session=True, **pipes) as child:  # type: ignore[call-overload]
        try:
            said, _ = child.communicate(timeout=timeout_s)
        except BaseException as error:  # a second that is too long, or Ctrl-C: the model must not go on
            os.killpg(child.pid, signal.SIGKILL) if hasattr(os, "killpg") else child.kill()
            if not isinstance(error, subprocess.TimeoutExpired):
                raise
            found = f"was stopped: it did not finish {task['end']:g} s of its time in {timeout_s:g} s"
            raise BadInput(path, found, "raise `timeout`, or look at the model") from None
    answer = said.splitlines()[-1] if said and said.splitlines() else ""
    if child.returncode or not answer.startswith("{"):
        raise BadInput(path, f"ended its process with code {child.returncode}", "the model in it crashed")
    told: dict[str, Any] = json.loads(answer)
    if "error" in told:
        raise BadInput(path, told["error"])
    return dict(told["units"])


@contextmanager
def _unpacked(path: Path) -> Iterator[Path]:
    """Yield a folder that holds the FMU unpacked under "fmu"; it is gone afterwards."""
    try:
        archive = zipfile.ZipFile(path)
    except OSError as error:
        raise BadInput(path, f"cannot be read: {error.strerror or error}") from error
    except zipfile.BadZipFile as error:
        raise BadInput(path, f"is no FMU: {error}", "expected a zip archive with modelDescription.xml") from error
    with archive, tempfile.TemporaryDirectory() as folder:
        names = [entry.filename for entry in archive.infolist()]
        for name in names:
            if name.startswith("/") or ".." in name.split("/") or "\\" in name or ":" in name:
                raise BadInput(f"{path}, entry {name!r:.80}", "leads out of its folder", "do not open this file")
        size = sum(entry.file_size for entry in archive.infolist())
        if size > MOST_BYTES:
            raise BadInput(path, f"unpacks to {size / 1e9:.1f} GB", f"at most {MOST_BYTES / 1e9:.1f} GB are believed")
        if "modelDescription.xml" not in names:
            raise BadInput(path, "holds no modelDescription.xml", "expected an FMU")
        try:
            archive.extractall(Path(folder) / "fmu")
        except (zipfile.BadZipFile, OSError, EOFError, RuntimeError, NotImplementedError) as error:
            raise BadInput(path, f"cannot be unpacked: {error}", "bytes were changed") from error
        yield Path(folder)
