"""The commands that print: reports and the thesis's tables."""

import argparse
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from catheter.lab.outcome import Outcome, progress, table
from catheter.lab.recording_commands import SHIPPED
from data.errors import BadInput
from data.files import check_free, check_inputs

if TYPE_CHECKING:
    from catheter.lab.report import Report

STUDIES = {  # the module of each report; the function has its name, with "_" for "-"
    "regression": "studies",
    "hysteresis": "studies",
    "recordings": "throughput",
    "damage": "damage",
    "free": "free_study",
    "free-stability": "free_study",
    "valves": "valve_study",
    "derivatives": "sysid_study",
    "selection": "sysid_study",
    "identification": "sysid_study",
    "sysid-recordings": "sysid_study",
    "sysid-stability": "sysid_study",
    "hydraulics": "circuit_study",
    "hydraulics-stability": "circuit_study",
    "fem": "fem_study",
    "fem-stability": "fem_study",
    "inverse": "inverse_study",
    "calibration": "calibration_study",
    "inverse-stability": "inverse_study",
    "twist": "vision_study",
    "twist-stress": "vision_stress",
    "twist-containers": "container_study",
    "camera-clock": "clock_study",
}


WITH_PEERS = ("hydraulics", "fem")  # reports that can run other tools beside ours


def report_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `report`."""
    parser.add_argument("name", choices=STUDIES, help="which report")
    parser.add_argument("--recording", metavar="FILE.mcap", help="for hysteresis: judge on this recording")
    parser.add_argument("--out", metavar="FOLDER", default="out", help="the folder to write to (default: out)")
    parser.add_argument("--force", action="store_true", help="overwrite an earlier report")
    parser.add_argument("--peers", action="store_true", help="also run other tools, installed into the cache folder")
    parser.add_argument("--quick", action="store_true", help="fewer levels, seconds instead of minutes")


def table_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `table`."""
    parser.add_argument("number", nargs="?", help="such as 3.3 (default: list them)")


def report_(options: argparse.Namespace) -> Outcome:
    """Write a report of error against run time."""
    from catheter.lab import report

    folder = Path(options.out)
    for path in report.paths(options.name, folder):
        check_inputs(path, Path(options.recording or SHIPPED))
        check_free(path, options.force) if folder.exists() else None
    with progress(options.name) as advance:
        made = _made(options, advance)
    written = report.write(made, folder)
    rows = [[r.method, r.level, r.error_text, f"{r.seconds:.3g}"] for r in made.rows]
    return Outcome(
        {"report": made.name, "files": [str(path) for path in written], "rows": [vars(r) for r in made.rows]},
        [table(["method", made.level, made.error, "seconds"], rows, made.title), *made.notes, *map(str, written)],
    )


def _made(options: argparse.Namespace, advance: Callable[[float], None]) -> "Report":
    more = {}
    if options.name in ("hysteresis", "sysid-recordings"):
        more["recording"] = options.recording
    elif options.recording is not None:
        raise BadInput("--recording", f"given for the {options.name} report", "it makes its own data")
    if options.name in WITH_PEERS:
        more["peers"] = options.peers
    elif options.peers:
        raise BadInput("--peers", f"given for the {options.name} report", f"only {', '.join(WITH_PEERS)} can take it")
    study = import_module(f"catheter.lab.{STUDIES[options.name]}")
    made: Report = getattr(study, options.name.replace("-", "_"))(quick=options.quick, progress=advance, **more)
    return made


def table_(options: argparse.Namespace) -> Outcome:
    """Print a table of the thesis."""
    from data.table import table as thesis_table
    from data.table import tables

    if not options.number:
        rows = [[number, thesis_table(number).title] for number in tables()]
        return Outcome({"tables": tables()}, [table(["table", "title"], rows, words=2)])
    found = thesis_table(options.number)
    cells = {
        label: {name: {"printed": cell.printed, "si": cell.si, "lack": cell.lack} for name, cell in row.items()}
        for label, row in found.rows.items()
    }
    units = {name: column.unit for name, column in found.columns.items()}
    values = {"number": found.number, "title": found.title, "source": found.source, "units": units, "rows": cells}
    return Outcome(values, [found.text()])
