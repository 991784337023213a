"""A command's dashboard and its picture: the same two options, checks and words for every command that has one."""

import argparse
import os
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from data.errors import BadInput
from data.files import check_free, check_inputs, fresh

if TYPE_CHECKING:
    from catheter.lab.outcome import Outcome


def view_options(parser: argparse.ArgumentParser, what: str, *, flag: str = "--view") -> None:
    """Add --view (or another flag, read as options.view) for a dashboard of `what`, and --picture."""
    parser.add_argument(flag, dest="view", metavar="FILE.rrd", help=f"also write a dashboard for rerun: {what}")
    parser.add_argument("--picture", metavar="FILE.png", help="also save a picture of the dashboard, without a window")


def check_view(options: argparse.Namespace, *inputs: str | Path) -> bool:
    """Return whether a dashboard or its picture is wanted. Raises BadInput, CannotWrite for a place that cannot be."""
    wanted = [Path(path) for path in (options.view, options.picture) if path]
    if len(wanted) == 2 and wanted[0].absolute() == wanted[1].absolute():
        raise BadInput("--picture", f"is {options.picture}, as the dashboard", "name two files")
    for path in wanted:
        check_inputs(path, *map(Path, inputs))
        check_free(path, options.force)
    return bool(wanted)


def save_view(
    outcome: "Outcome",
    options: argparse.Namespace,
    save: Callable[[Path], None],
    *,
    at_s: float | None = None,
    count: str = "",
) -> None:
    """Write the dashboard where --view asks for it and its picture where --picture does, and say so.

    save: writes the dashboard to a path. at_s, count: see `save_picture`. Raises CannotWrite.
    """
    quiet()
    picture = Path(options.picture) if options.picture else None
    if options.view:
        view = Path(options.view)
        with fresh(view, options.force) as temporary:
            save(temporary)
        outcome.values["view"] = str(view)
        outcome.parts.append(where(view))
        if picture:
            take(outcome, view, picture, force=options.force, at_s=at_s, count=count)
    elif picture:
        with TemporaryDirectory() as folder:
            view = Path(folder) / "dashboard.rrd"
            save(view)
            take(outcome, view, picture, force=options.force, at_s=at_s, count=count)


def take(
    outcome: "Outcome", rrd: Path, picture: Path, *, force: bool, at_s: float | None = None, count: str = ""
) -> None:
    """Save a picture of a dashboard that is there, and say so. Raises as `save_picture`."""
    from catheter.lab.views.picture import save_picture

    with fresh(picture, force) as temporary:
        save_picture(rrd, temporary, at_s=at_s, count=count)
    outcome.values["picture"] = str(picture)
    outcome.parts.append(f"Picture: {picture}")


def where(view: Path) -> str:
    """Return the line that says where a dashboard is."""
    return f"Dashboard: {view}   (look at it with: rerun {view})"


def quiet() -> None:
    """Silence rerun's own log lines: what went wrong is said by us."""
    os.environ.setdefault("RUST_LOG", "off")
