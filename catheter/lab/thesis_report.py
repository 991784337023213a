"""`report thesis`: every number and figure of the thesis that can be computed, beside the published one.

A part of the thesis is a function `(*, quick) -> Section` (see `thesis.entries`), named in SECTIONS: a new part adds
one line. A part that fails is an entry with its error, and the others go on.
"""

import csv
import json
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, fields
from importlib import import_module
from pathlib import Path
from typing import Any

from catheter.lab.report import Progress, machine, writable
from catheter.lab.thesis.entries import FAILED, UNKNOWN, VERDICTS, Entry, Figure, Section, told
from data.files import fresh

NAME = "thesis"
SECTIONS = (  # in the thesis's order; a module below catheter.lab, and its function
    "thesis.design.design",
    "thesis.accumulators.accumulators",
    "thesis.locomotion.locomotion",
    "thesis.valves.valves",
    "thesis.bender.bender_force",
    "thesis.shapes.shapes",
    "thesis.materials.materials",
    "thesis.inverse.inverse",
    "thesis.reconstructions.reconstructions",
)
FIGURES = (  # every figure that is to be drawn anew; one that no section draws is an entry that says so
    *("3.10", "3.11", "3.12", "3.13", "3.16", "3.20"),
    *(f"3.{n}" for n in range(26, 34)),
    *(f"4.{n}" for n in range(4, 8)),
    "6.7",
    *(f"6.{n}" for n in range(9, 19)),
    "6.22",
)
HEADER = ("place", "quantity", "published", "ours", "off by", "verdict [why]")


@dataclass(frozen=True, kw_only=True)
class Regenerated:
    """The thesis regenerated: entries and figures in the thesis's order."""

    entries: list[Entry]
    figures: list[Figure]

    @property
    def counts(self) -> dict[str, int]:
        """How many entries have each verdict."""
        found = Counter(entry.verdict for entry in self.entries)
        return {verdict: found[verdict] for verdict in VERDICTS if found[verdict]}

    @property
    def failed(self) -> list[Entry]:
        """Entries whose computation failed."""
        return [entry for entry in self.entries if entry.verdict == FAILED]

    @property
    def unexplained(self) -> list[Entry]:
        """Entries that differ without a reason, which nothing should."""
        return [entry for entry in self.entries if not entry.explained]


def regenerate(*, quick: bool, progress: Progress) -> Regenerated:
    """Compute every section. quick: coarser grids and shorter recordings, the same entries."""
    entries: list[Entry] = []
    figures: list[Figure] = []
    for done, path in enumerate(SECTIONS, start=1):
        made = _section(path, quick)
        entries += made.entries
        figures += made.figures
        progress(done / (len(SECTIONS) + 1))
    drawn = {figure.number for figure in figures}
    entries += [
        told(f"Fig {number}", "the figure", "a picture", "-", verdict=UNKNOWN, reason="not drawn in this version")
        for number in FIGURES
        if number not in drawn
    ]
    return Regenerated(entries=entries, figures=figures)


def _section(path: str, quick: bool) -> Section:
    module, _, name = path.rpartition(".")
    try:
        make: Callable[..., Section] = getattr(import_module(f"catheter.lab.{module}"), name)
        return make(quick=quick)
    except Exception as error:  # one part's fault must not cost the others
        return Section(entries=[_failed(path, error)])


def _failed(what: str, error: Exception) -> Entry:
    return told(what, "all of it", "-", "-", verdict=FAILED, reason=f"{type(error).__name__}: {error}"[:300])


def places(folder: Path) -> list[Path]:
    """Return the files that stand beside the folder of figures."""
    return [folder / f"{NAME}.{ending}" for ending in ("csv", "json", "rrd")]


def write(made: Regenerated, folder: Path) -> list[Path]:
    """Write thesis.csv, thesis.json, thesis.rrd and a picture of each figure into a folder; return them.

    A figure that cannot be drawn becomes an entry. Files of an earlier run are replaced. Raises CannotWrite.
    """
    writable(folder / NAME)
    pictures: dict[str, Path] = {}
    for figure in made.figures:
        path = folder / NAME / f"fig_{figure.number}.png"
        try:
            with fresh(path, replace=True) as temporary:
                _draw(figure, temporary)
            pictures[f"{figure.kind}: Fig {figure.number}"] = path
        except (ValueError, ArithmeticError, LookupError, TypeError) as error:
            made.entries.append(_failed(f"Fig {figure.number}", error))
    table_path, about_path, view_path = places(folder)
    with fresh(table_path, replace=True) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(field.name for field in fields(Entry))
        writer.writerows(vars(entry).values() for entry in made.entries)
    with fresh(about_path, replace=True) as temporary:
        about: dict[str, Any] = {"counts": made.counts, **machine()}
        temporary.write_text(json.dumps(about, indent=1), encoding="utf-8")
    from catheter.lab.views import report as view

    shown, notes = numbered(made)
    with fresh(view_path, replace=True) as temporary:
        title = "The thesis regenerated, from simulated and published data"
        view.save(temporary, title, header=HEADER, rows=shown, notes=notes, pictures=pictures)
    return [table_path, about_path, view_path, *pictures.values()]


def _draw(figure: Figure, path: Path) -> None:
    from catheter.lab import plot

    drawing = plot.sheet(f"Fig {figure.number}, {figure.title}", figure.kind, size=figure.size)
    figure.draw(drawing)
    plot.save(drawing, path)


def numbered(made: Regenerated) -> tuple[list[list[str]], list[str]]:
    """Return the entries as texts in the order of HEADER, and the reasons they refer to by number, each once."""
    reasons: dict[str, int] = {}
    shown = []
    for entry in made.entries:
        note = f" [{reasons.setdefault(entry.reason, len(reasons) + 1)}]" if entry.reason else ""
        published = f"{entry.published} {entry.unit}".strip()
        off = "" if math.isnan(entry.mismatch_percent) else f"{entry.mismatch_percent:+.1f} %"
        shown.append([entry.place, entry.quantity, published, entry.ours, off, entry.verdict + note])
    return shown, [f"[{number}] {reason}" for reason, number in reasons.items()]


def parts(made: Regenerated) -> list[Any]:
    """Return the entries for people: a table with numbers for the reasons, the reasons below, and the counts."""
    from catheter.lab.outcome import table

    shown, notes = numbered(made)
    counts = ", ".join(f"{count} {verdict}" for verdict, count in made.counts.items())
    whole = table(HEADER, shown, "The thesis regenerated: simulated beside published", words=4)
    return [whole, *notes, f"{len(made.entries)} rows: {counts}"]
