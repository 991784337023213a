"""The loop as commands: `redesign`, and `replay` of a filmed, printed actuator.

Each of its parts is a command of its own too (`twist`, `twin`, `invert`, `print`).
"""

import argparse
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from catheter.lab.dashboard import quiet, take, where
from catheter.lab.loop_stages import LAST, told
from catheter.lab.outcome import Outcome, progress
from data.errors import BadInput
from data.files import check_inputs, fresh

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from catheter.design_loop import Closing, DesignLoop, Specimen
    from catheter.lab.scene import Scene


def redesign_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `redesign`."""
    parser.add_argument("recording", help="an MCAP file: /pressure, /led, /camera/top and /camera/side")
    parser.add_argument("--scene", help="the actuator's scene (default: the recording's own)")
    parser.add_argument("--pressure", default="60 kPa", help="at which the actuator should move as designed")
    parser.add_argument("--pressure-noise", type=float, default=0.0025, metavar="SHARE", help="of the gauge's reading")
    parser.add_argument(
        "--scatter", type=float, nargs=2, default=(0.05, 0.10), metavar=("SOFT", "STIFF"),
        help="standard deviation of c1 from specimen to specimen, assumed (default: 0.05 0.10)",
    )  # fmt: skip
    parser.add_argument("--again", metavar="FILE.mcap", help="the film of the actuator printed from the new design")
    parser.add_argument("--out", metavar="DIR", help="map, print files and picture of the new design")
    parser.add_argument("--force", action="store_true", help="overwrite earlier files")


def redesign_(options: argparse.Namespace) -> Outcome:
    """Close the loop from a film to print files."""
    from catheter.design_loop import Closing
    from data.options import read

    given = {
        "pressure": options.pressure,
        "noise": options.pressure_noise,
        "scatter": list(options.scatter),
    }
    return _closed(options, Path(options.recording), read(Closing, given, "command line"), prints=options.out)


def replayed_film(options: argparse.Namespace, source: Path, out: Path, picture: Path | None) -> Outcome:
    """Replay a filmed actuator: all of the loop, its dashboard, and its print files where they are asked for."""
    if options.until != LAST and (options.out or picture or options.print):
        raise BadInput("--until", f"{options.until}, given with an output", "outputs need the whole loop")
    views = [] if options.no_view or options.until != LAST else [out, *([picture] if picture else [])]
    for path in views if options.again else []:
        check_inputs(path, Path(options.again))
    return _closed(options, source, None, prints=options.print, until=options.until, views=views)


def _closed(
    options: argparse.Namespace,
    source: Path,
    closing: "Closing | None",
    *,
    prints: str | None,
    until: str = LAST,
    views: list[Path] | None = None,
) -> Outcome:
    """Return what a loop says; views: where its dashboard goes, and a picture of that."""
    from catheter.design_loop import DesignLoop
    from catheter.lab.loop_files import check_folder, write_files
    from catheter.lab.scene import recorded_scene

    scene = recorded_scene(source, options.scene, ("tube", "map"))
    first, again = _specimen(source, scene), None
    if options.again:
        second = Path(options.again)
        again = _specimen(second, recorded_scene(second, None, ("tube", "map")))
    if prints:
        check_folder(Path(prints), first, options.force)
    with _another_process(until) as executor, progress("film, twin, materials, redesign") as advance:
        loop = DesignLoop(first, again, closing, executor)
        outcome = told(loop, until, advance)
        outcome.values["recording"] = str(source)
        outcome.parts.insert(0, f"{scene.heading.title} ({first.film.kind}): {source.name}")
        if prints:
            _add(outcome, write_files(loop, scene.heading.title, Path(prints), options.force))
        if views:
            _add(outcome, _view(loop, scene.heading.title, views, options.force))
    return outcome


def _add(outcome: Outcome, one: Outcome) -> None:
    outcome.values |= one.values
    outcome.parts += one.parts


def _specimen(source: Path, scene: "Scene") -> "Specimen":
    from catheter.design_loop import Specimen
    from catheter.filmed import Filmed
    from catheter.printed_bench import Cameras

    return Specimen(Filmed(source, scene.tables.get("cameras", Cameras())), scene.tables["tube"], scene.tables["map"])


@contextmanager
def _another_process(until: str) -> "Iterator[Executor | None]":
    """Yield a process in which frames are read while this one solves the model; the first time, both compile.

    None where no model is asked for.
    """
    if until in ("clocks", "twist"):
        yield None
        return
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    pool = ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=_interruptible)
    try:
        yield pool
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _interruptible() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # it ends at once and says nothing: who asked does


def _view(loop: "DesignLoop", title: str, views: list[Path], force: bool) -> Outcome:
    quiet()
    from catheter.lab.views.design_loop import save_loop

    out, *pictures = views
    with fresh(out, force) as temporary:
        save_loop(loop, title, temporary)
    outcome = Outcome({"view": str(out), "picture": None}, [where(out)])
    for picture in pictures:
        take(outcome, out, picture, force=force)
    return outcome
