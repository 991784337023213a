"""Twist of one film through video files and a recording: the same angles, and memory that does not grow."""

import csv
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np

from catheter.lab.report import Progress, Report, Row
from data.recorder import Recorder
from data.signal import Array
from data.topics import standard
from vision.render import Shot, render

RATE_HZ = 30.0
_CHILD = """
import re, sys, time
from pathlib import Path
from catheter.lab import cli
started = time.perf_counter()
code = cli.run(["twist", sys.argv[1], "--out", sys.argv[2], "--json"])
peak = re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())  # Linux says; others do not
print("\\n", code, time.perf_counter() - started, 1024 * int(peak[1]) if peak else "nan")
"""


def twist_containers(*, quick: bool, progress: Progress) -> Report:
    """A turning marker of 200 px, past 180 degrees both ways, filmed once and stored four ways."""
    seconds = (1.0, 2.0) if quick else (20.0, 60.0)
    rows, notes = [], []
    with tempfile.TemporaryDirectory() as folder:
        for done, duration_s in enumerate(seconds):
            truth_rad, paths = _films(Path(folder) / f"{done}", int(duration_s * RATE_HZ))
            for at, (name, path) in enumerate(paths.items(), start=1):
                error_deg, sigma_deg, lost, spent, peak = _measured(path, truth_rad)
                level = f"{duration_s:g} s"
                rows.append(Row(method=name, level=level, error=error_deg, seconds=spent))
                notes.append(
                    f"{name}, {level}: {path.stat().st_size / 1e6:.1f} MB, reported sigma {sigma_deg:.4f} deg, "
                    f"{lost} frames missing, peak memory {peak / 1e6:.0f} MB"
                )
                progress((done + at / len(paths)) / len(seconds))
    return Report(
        name="twist-containers",
        title="Twist of a simulated film through video files and a recording",
        level="film",
        error="rms error, degrees",
        rows=rows,
        notes=[*notes, "The error is of twist since the first frame, and holds that frame's own: sigma times root 2."],
    )


def _films(folder: Path, count: int) -> tuple[Array, dict[str, Path]]:
    """Write one film four ways; return its angles in rad (n,) and the files by name."""
    import cv2

    folder.mkdir()
    truth = 4.0 * np.sin(np.arange(count) / RATE_HZ)  # +-229 degrees, at most 7.6 a frame
    shot = Shot(noise_grey=2.0)
    codes = {"mp4 (mp4v)": ("a.mp4", "mp4v"), "avi (MJPG)": ("a.avi", "MJPG")}
    paths = {name: folder / file for name, (file, _) in codes.items()}
    films = [
        cv2.VideoWriter(str(folder / file), cv2.VideoWriter.fourcc(*code), RATE_HZ, (shot.width_px, shot.height_px))
        for file, code in codes.values()
    ]
    kinds: dict[str, tuple[str, list[int]]] = {"jpeg": (".jpg", [cv2.IMWRITE_JPEG_QUALITY, 95]), "png": (".png", [])}
    paths |= {f"mcap ({kind})": folder / f"{kind}.mcap" for kind in kinds}
    with ExitStack() as open_files:
        recorders = {}
        for kind in kinds:
            recorder = Recorder(paths[f"mcap ({kind})"], {"kind": "simulated"}, flush_s=None)
            recorders[kind] = open_files.enter_context(recorder)
            recorder.add(standard("/camera/top"))
        for k, angle in enumerate(truth):
            picture = render(replace(shot, angle_rad=float(angle)), k)
            for film in films:
                film.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
            for kind, (ending, options) in kinds.items():
                data = cv2.imencode(ending, picture, options)[1].tobytes()
                recorders[kind].write_picture("/camera/top", k / RATE_HZ, data, kind)
        for film in films:
            film.release()
    return truth, paths


def _measured(path: Path, truth_rad: Array) -> tuple[float, float, int, float, float]:
    """Return rms error and mean sigma in degrees, frames missing, seconds and peak bytes of one run of the command."""
    out = path.with_suffix(f"{path.suffix}.csv")
    done = subprocess.run(
        [sys.executable, "-c", _CHILD, str(path), str(out)], capture_output=True, text=True, check=True
    )
    spent, peak = map(float, done.stdout.split()[-2:])
    with out.open(newline="") as file:
        found = list(csv.DictReader(file))
    angle, sigma = (np.degrees([float(row[name] or "nan") for row in found]) for name in ("angle_rad", "sigma_rad"))
    wrong = angle - np.degrees(truth_rad[: len(angle)] - truth_rad[0])
    return float(np.sqrt(np.nanmean(wrong**2))), float(np.nanmean(sigma)), int(np.isnan(angle).sum()), spent, peak
