"""Measure the twist in every video of a folder, several videos at a time.

    python tests/examples/twist_folder.py VIDEOS OUT

OUT gets one CSV for each video: time [s], twist [rad], its standard deviation [rad], status. Frames
without a whole marker are rows "missing", and one line says how many there were.
"""

import sys
from concurrent.futures import Executor, ProcessPoolExecutor
from pathlib import Path

import numpy as np

VIDEOS = (".mp4", ".avi", ".mov", ".mkv")


def measure(video: Path, out: Path) -> str:
    """Write one video's twist; return what there is to say of it."""
    from vision.frames import open_source
    from vision.pattern import SQUARES
    from vision.twist import MISSING, Tracker, assemble, rows

    twist = assemble(list(rows(open_source(video).frames(), Tracker(SQUARES))))
    lines = zip(twist.time_s, twist.angle_rad, twist.sigma_rad, twist.status, strict=True)
    with (out / f"{video.stem}.csv").open("x") as file:  # "x": an earlier result is not overwritten
        file.write("time_s,twist_rad,sigma_rad,status\n")
        file.writelines(f"{t:.9g},{angle:.9g},{sigma:.3g},{status}\n" for t, angle, sigma, status in lines)
    turned = np.degrees(np.nanmax(twist.angle_rad) - np.nanmin(twist.angle_rad))
    return f"{video.name}: {len(twist.status)} frames, {twist.status.count(MISSING)} missing, turned {turned:.2f} deg"


def main(folder: str, out: str, executor: Executor | None = None) -> None:
    """Measure all videos of a folder; executor: this machine's processes by default, or a cluster's."""
    Path(out).mkdir(parents=True, exist_ok=True)
    videos = sorted(path for path in Path(folder).iterdir() if path.suffix.lower() in VIDEOS)
    with executor or ProcessPoolExecutor() as pool:
        for told in pool.map(measure, videos, [Path(out)] * len(videos)):
            print(told)


if __name__ == "__main__":
    main(*sys.argv[1:3])
