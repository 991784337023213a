"""A published number beside ours: what a section of the thesis's report is made of.

Published numbers come from data/tables: from the thesis's own tables, or from "3.text" and the like,
which hold the numbers of a chapter's text with the reason for each known difference.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from typing import TYPE_CHECKING

from data.table import Cell, Table, table
from data.units import factor_to_si

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

AGREES = "agrees"  # to every printed digit, or the sentence holds
DIFFERS = "differs"
MISPRINT = "misprint"
RECOVERED = "recovered"  # from our own simulated measurement of the published value: checks the method only
UNKNOWN = "not computable"
FAILED = "failed"  # our computation did: the reason is its error
VERDICTS = (AGREES, DIFFERS, MISPRINT, RECOVERED, UNKNOWN, FAILED)
RECOVERY = 0.05  # relative: what a simulated measurement must give back of its own truth


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One published number or sentence, and ours: texts in the printed unit. mismatch_percent: NaN where it means none.

    A difference without a reason is a fault: `explained` says so.
    """

    place: str
    quantity: str
    unit: str
    published: str
    ours: str
    mismatch_percent: float
    verdict: str
    reason: str

    @property
    def explained(self) -> bool:
        """Whether the thesis and we agree, or the reason is given."""
        return self.verdict == AGREES or bool(self.reason)


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A figure of the thesis, drawn anew on a matplotlib figure. kind: where our data are from, "simulated" mostly."""

    number: str
    title: str
    kind: str
    draw: "Callable[[Drawing], None]"
    size: tuple[float, float] = (8.0, 5.5)


@dataclass(frozen=True, kw_only=True)
class Section:
    """What one part of the thesis gives: entries and figures."""

    entries: list[Entry] = field(default_factory=list)
    figures: list[Figure] = field(default_factory=list)


def compare(
    number: str, row: str, ours_si: float, column: str = "published", *, recovered: bool = False, reason: str = ""
) -> Entry:
    """Return the entry of one cell of a table, ours in SI. reason: for tables that hold none.

    recovered: ours was measured on our own simulation of the published value.
    """
    source = table(number)
    cells = source.row(row)
    cell, unit = cells[column], _unit(source, cells[column], column)
    ours = ours_si / factor_to_si(unit)
    relation = cells["relation"].printed if "relation" in cells else "="
    reason = reason or (cells["reason"].printed if "reason" in cells else "")
    printed = cell.printed.partition(" ")[0]
    agrees = _agrees(relation, printed, ours)
    mismatch = 100 * (ours / float(printed) - 1) if relation == "=" and float(printed) else math.nan
    if recovered:
        verdict = RECOVERED if abs(mismatch) <= 100 * RECOVERY else DIFFERS
    else:
        verdict = AGREES if agrees else MISPRINT if reason.startswith("misprint") else DIFFERS
    return Entry(
        place=_place(source, cells),
        quantity=row if "relation" in cells else f"{row}, {column}",
        unit="" if unit == "1" else unit,
        published=printed if relation == "=" else f"{relation} {printed}",
        ours=_digits(ours, printed),
        mismatch_percent=mismatch,
        verdict=verdict,
        reason="" if verdict == AGREES else reason,
    )


def claim(number: str, row: str, found: str, *, holds: bool) -> Entry:
    """Return the entry of a sentence: what we found, and whether it holds."""
    cells = table(number).row(row)
    reason = cells["reason"].printed
    verdict = AGREES if holds else MISPRINT if reason.startswith("misprint") else DIFFERS
    place = _place(table(number), cells)
    return told(place, row, "a sentence", found, verdict=verdict, reason="" if holds else reason)


def unknown(number: str, row: str, column: str, why: str) -> Entry:
    """Return the entry of a cell that cannot be computed, with the reason."""
    source = table(number)
    cells = source.row(row)
    cell = cells.get(column)
    printed = "a sentence" if cell is None or cell.lack else cell.printed
    shown = row if "relation" in cells else f"{row}, {column}"
    return told(_place(source, cells), shown, printed, "-", verdict=UNKNOWN, reason=why)


def told(place: str, quantity: str, published: str, ours: str, *, verdict: str, reason: str = "") -> Entry:
    """Return an entry of texts, where neither table nor number says it."""
    return Entry(
        place=place, quantity=quantity, unit="", published=published, ours=ours,
        mismatch_percent=math.nan, verdict=verdict, reason=reason,
    )  # fmt: skip


def _place(source: Table, cells: Mapping[str, Cell]) -> str:
    return cells["place"].printed if "place" in cells else f"Table {source.number}"


def _unit(source: Table, cell: Cell, column: str) -> str:
    return cell.printed.partition(" ")[2] or source.columns[column].unit


def _agrees(relation: str, printed: str, ours: float) -> bool:
    if relation != "=":
        return ours < float(printed) if relation == "<" else ours > float(printed)
    exponent = Decimal(printed).as_tuple().exponent
    assert isinstance(exponent, int)
    return abs(ours - float(printed)) <= 0.5000001 * 10.0**exponent


def _digits(ours: float, printed: str) -> str:
    """Return ours with two digits more than were printed."""
    digits = len(Decimal(printed).as_tuple().digits)
    return f"{ours + 0.0:.{max(4, digits + 2)}g}"
