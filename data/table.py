"""The thesis's tables with units and source, and a mark on whatever the thesis does not print."""

import difflib
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import nan
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np

from data.errors import BadInput
from data.units import UNDOCUMENTED, quantity, si_unit

_FOLDER = Path(__file__).parent / "tables"


@dataclass(frozen=True, kw_only=True)
class Column:
    """One column: `unit` is "" for text and "undocumented" where it is neither printed nor inferred."""

    name: str
    meaning: str
    unit: str
    unit_printed: bool = True

    def __post_init__(self) -> None:
        if self.unit not in ("", UNDOCUMENTED):
            si_unit(str(self.unit))


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One entry as printed ("-": not printed, "217 ?": its unit is not known) and in SI, or what it lacks."""

    printed: str
    si: float = nan
    lack: str = ""


@dataclass(frozen=True, kw_only=True)
class Table:
    """One table; rows go by their entry in the first column, columns by their name, both in order."""

    number: str
    title: str
    source: str
    notes: tuple[str, ...]
    columns: Mapping[str, Column]
    rows: Mapping[str, Mapping[str, Cell]]

    def row(self, label: str) -> Mapping[str, Cell]:
        """Return a row's cells by column; raises BadInput with the nearest label for an unknown one."""
        return self.rows[_known(label, self.rows, f"Table {self.number}, row")]

    def value(self, label: str, name: str) -> float:
        """Return one number in SI: table("5.1").value("Agilus30", "c1") is 0.2e6 [Pa].

        Raises BadInput for an unknown row or column with the nearest, for text, and with the
        reason where the thesis prints no number or the number's unit is not known.
        """
        cell = self.row(label)[_known(name, self.columns, f"Table {self.number}, column")]
        if cell.lack or not self.columns[name].unit:
            place = f"Table {self.number}, row {label!r}, column {name!r}"
            raise BadInput(place, cell.lack or f"{cell.printed!r} is text", "the notes of the table say more")
        return cell.si

    def column(self, name: str) -> Any:
        """Return a column: float64 array [rows] in SI, NaN where not printed; a text column as list[str].

        Raises BadInput for an unknown name with the nearest, and naming the rows whose number has no
        known unit: as NaN they would drop out of a fit without a word.
        """
        column = self.columns[_known(name, self.columns, f"Table {self.number}, column")]
        cells = {label: row[name] for label, row in self.rows.items()}
        if unusable := [label for label, cell in cells.items() if cell.lack and cell.printed != "-"]:
            place = f"Table {self.number}, column {name!r}, rows {', '.join(unusable)}"
            raise BadInput(place, cells[unusable[0]].lack, "take the other rows one by one with value()")
        return np.array([cell.si for cell in cells.values()]) if column.unit else [c.printed for c in cells.values()]

    def text(self) -> str:
        """Return the table as printed, then meanings, gaps, source and notes, 100 characters wide."""
        units = [f"[{c.unit}{'' if c.unit_printed else '*'}]" if c.unit else "" for c in self.columns.values()]
        grid = [[*self.columns], units, *([cell.printed for cell in row.values()] for row in self.rows.values())]
        widths = [max(map(len, entries)) for entries in zip(*grid, strict=True)]
        pads = [str.rjust if unit else str.ljust for unit in units]
        lines = ["  ".join(map(lambda pad, *entry: pad(*entry), pads, line, widths)).rstrip() for line in grid]
        below = [f"{column.name}: {column.meaning}" for column in self.columns.values()]
        below += ["* this unit is not printed in the thesis"] * any("*" in unit for unit in units)
        below += [f"{a}, {b}: {cell.lack}" for a, row in self.rows.items() for b, cell in row.items() if cell.lack]
        below += [f"Source: {self.source}", *(f"- {note}" for note in self.notes)]
        wrapped = [line for paragraph in below for line in wrap(paragraph, 100, subsequent_indent="  ")]
        return "\n".join([f"Table {self.number}: {self.title}", "", *lines, "", *wrapped])


def tables() -> list[str]:
    """Return the numbers of the tables in order: ["3.1", "3.2", ...]."""
    numbers = (path.name.split("_")[0] for path in _FOLDER.glob("[0-9]*.[0-9]*_*.toml"))
    return sorted(numbers, key=lambda number: [int(part) for part in number.split(".")])


def table(number: str) -> Table:
    """Return the thesis's table of that number; raises BadInput with the nearest for another."""
    return read_table(next(_FOLDER.glob(f"{_known(number, tables(), 'table')}_*.toml")))


def read_table(path: Path) -> Table:
    """Read one table file; raises BadInput naming the file and the field that is wrong."""
    try:
        # Numbers stay text: a float forgets the digits printed (1.60).
        raw = tomllib.loads(path.read_text("utf-8"), parse_float=str)
        columns = {name: Column(name=name, **column) for name, column in raw.pop("columns").items()}
        rows, key = [_row(row, columns) for row in raw.pop("row")], next(iter(columns), "")
        labelled = {row[key].printed: row for row in rows}
        if len(labelled) < len(rows) or columns[key].unit:
            raise BadInput(f"first column {key!r}", "is no text that tells the rows apart")
        return Table(notes=tuple(raw.pop("notes")), columns=columns, rows=labelled, **raw)
    except (BadInput, OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise BadInput(path, f"is no table: {error}", "compare the tables in data/tables") from error


def _row(raw: dict[str, Any], columns: Mapping[str, Column]) -> dict[str, Cell]:
    units, lacks = raw.pop("units", {}), raw.pop("not_printed", {})
    place = f"row {next(iter(raw.values()), '')!r}, column"
    for name in (*raw, *units, *lacks):
        _known(name, columns, place)
    return {
        name: _cell(raw.get(name), units.get(name, column.unit), lacks.get(name), column, f"{place} {name!r}")
        for name, column in columns.items()
    }


def _cell(printed: object, unit: str, lack: str | None, column: Column, place: str) -> Cell:
    if (printed is None) == (lack is None):
        raise BadInput(place, "needs either a value or a reason in not_printed")
    if lack is not None:
        return Cell(printed="-", lack=f"not printed in the thesis: {lack}")
    if not column.unit:
        return Cell(printed=str(printed))
    known = "1" if unit == UNDOCUMENTED else unit
    si = quantity(f"{printed} {known}", known, place)
    if unit == UNDOCUMENTED:
        return Cell(printed=f"{printed} ?", lack=f"{printed} is printed without a unit, and none is inferred")
    return Cell(printed=f"{printed}" if unit == column.unit else f"{printed} {unit}", si=si)


def _known(name: object, valid: Iterable[str], place: str) -> str:
    names = list(valid)
    if name in names:
        return str(name)
    folded = {known.casefold(): known for known in names}
    (nearest,) = difflib.get_close_matches(str(name).casefold(), folded, n=1, cutoff=0)
    raise BadInput(place, f"{name!r} is unknown", f"the nearest is {folded[nearest]!r}")
