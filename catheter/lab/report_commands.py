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
    "materials": "material_study",
    "directions": "direction_study",
    "shape": "shape_study",
    "shape-pictures": "shape_pictures",
    "inverse": "inverse_study",
    "inverse-spiral": "reach_study",
    "calibration": "calibration_study",
    "inverse-stability": "inverse_study",
    "twist": "vision_study",
    "twist-stress": "vision_stress",
    "twist-containers": "container_study",
    "camera-clock": "clock_study",
    "fuzz": "fuzz",
}

WITH_PEERS = ("hydraulics", "fem")  # reports that can run other tools beside ours
UNTIMED = (  # reports of accuracy, whose seconds are by the way: several may run at once
    "materials", "directions", "shape-pictures", "inverse-spiral", "calibration", "identification", "sysid-recordings",
    "camera-clock",
)  # fmt: skip
STABILITY = ("damage", "fuzz", "twist-stress")  # beside all that end with "-stability"
THESIS = "thesis"
GATHERED = {  # reports of reports, and the kinds they hold
    "error-vs-time": ("error-vs-time",),
    "stability": ("stability",),
    "all": (THESIS, "error-vs-time", "stability"),
}


def kind_of(name: str) -> str:
    """Return what kind of report a name is: thesis, error-vs-time or stability."""
    if name == THESIS:
        return THESIS
    return "stability" if name.endswith("-stability") or name in STABILITY else "error-vs-time"


def timed(name: str) -> bool:
    """Say whether a report's seconds are a result, so that nothing else may run beside it."""
    return kind_of(name) == "error-vs-time" and name not in UNTIMED


def report_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `report`."""
    parser.add_argument("name", choices=[*STUDIES, THESIS, *GATHERED], help="which report")
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
    if options.name in GATHERED:
        return _gathered(options, folder)
    if options.name == THESIS:
        return _thesis(options, folder)
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


def _plain(options: argparse.Namespace) -> None:
    """Raise BadInput for options that are for single studies."""
    if options.recording is not None:
        raise BadInput("--recording", f"given for the {options.name} report", "it makes its own data")


def _thesis(options: argparse.Namespace, folder: Path) -> Outcome:
    from catheter.lab import thesis_report

    _plain(options)
    if options.peers:
        raise BadInput("--peers", f"given for the {options.name} report", f"only {', '.join(WITH_PEERS)} can take it")
    for path in (*thesis_report.places(folder), folder / THESIS):
        if path.exists() and not options.force:
            check_free(path)
    with progress(options.name) as advance:
        made = thesis_report.regenerate(quick=options.quick, progress=advance)
        written = thesis_report.write(made, folder)
    values = {
        "report": options.name,
        "files": [str(path) for path in written],
        "counts": made.counts,
        "rows": [vars(entry) for entry in made.entries],
    }
    shown = [str(path) for path in written if path.suffix != ".png"]
    parts = [*thesis_report.parts(made), *shown, f"{len(made.figures)} pictures in {folder / THESIS}"]
    return Outcome(values, parts, code=1 if made.unexplained or made.failed else 0)


def _gathered(options: argparse.Namespace, folder: Path) -> Outcome:
    """Make the reports of one kind, or all; exit code 1 when one could not be made."""
    from catheter.lab import gather

    _plain(options)
    for path in gather.index_paths(folder):
        check_free(path, options.force) if folder.exists() else None
    with_peers = ("--peers",) if options.peers else ()
    jobs = [
        gather.Job(name=name, kind=kind_of(name), timed=timed(name), options=with_peers if name in WITH_PEERS else ())
        for name in (THESIS, *STUDIES)
        if kind_of(name) in GATHERED[options.name]
    ]
    with progress(options.name) as advance:
        found = gather.gather(jobs, folder, quick=options.quick, progress=advance)
        written = gather.write_index(found, folder)
    missing = [made.job.name for made in found if made.why]
    failed = gather.failures(found)
    unexplained = [text for text in failed if text.endswith(gather.UNEXPLAINED)]
    notes = [f"{len(found) - len(missing)} of {len(found)} reports made. Rows that failed or were refused:"]
    notes += [*(f"- {text}" for text in failed), f"{len(failed)} in all, {len(unexplained)} of them unexplained."]
    several = "All" if options.quick else "Those of stability, of the thesis and of accuracy alone"
    notes.append(f"{several} ran several at once: their times are indicative.")
    values = {
        "report": options.name,
        "files": [str(path) for path in written],
        "missing": missing,
        "failures": failed,
        "unexplained": unexplained,
        "rows": [dict(zip(gather.HEADER, made.cells, strict=True)) for made in found],
    }
    shown = table(gather.HEADER, [made.cells for made in found], "Reports", words=2)
    return Outcome(values, [shown, *notes, *map(str, written)], code=1 if missing or unexplained else 0)


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
