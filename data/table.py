"""The thesis's tables with units and source, and a mark on whatever the thesis does not print."""

import difflib
import tomllib
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np

from data.errors import BadInput
from data.units import UNDOCUMENTED, quantity

_FOLDER = Path(__file__).parent / "tables"
_FILE = {"number": str, "title": str, "source": str, "notes": list, "columns": dict, "row": list}
_COLUMN = {"name": str, "meaning": str, "unit": str, "unit_printed": bool}


LONG = 30  # characters of a text that stands below its table, not in it


@dataclass(frozen=True, kw_only=True)
class Column:
    """One column: `unit` is "" for text and "undocumented" where it is neither printed nor inferred."""

    name: str
    meaning: str
    unit: str
    unit_printed: bool = True


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One entry as printed ("-": not printed, "217 ?": its unit is not known) and in SI, or what it lacks."""

    printed: str
    si: float = np.nan
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
        """Return one number in SI; raises BadInput for an unknown name, for text, and with the reason for a lack."""
        cell = self.row(label)[_known(name, self.columns, f"Table {self.number}, column")]
        if lack := cell.lack or ("" if self.columns[name].unit else f"{cell.printed!r} is text"):
            raise BadInput(f"Table {self.number}, row {label!r}, column {name!r}", lack)
        return cell.si

    def column(self, name: str) -> Any:
        """Return a column in SI: float64 array [rows], NaN where not printed; list[str] of a text column.

        Raises BadInput for an unknown name, and for rows without a known unit: NaN would hide those numbers.
        """
        column = self.columns[_known(name, self.columns, f"Table {self.number}, column")]
        cells = {label: row[name] for label, row in self.rows.items()}
        if bare := [label for label, cell in cells.items() if cell.lack and cell.printed != "-"]:
            raise BadInput(f"Table {self.number}, column {name!r}, rows {', '.join(bare)}", cells[bare[0]].lack)
        return np.array([c.si for c in cells.values()]) if column.unit else [c.printed for c in cells.values()]

    def text(self) -> str:
        """Return the table as printed, then meanings, gaps, source and notes, 100 characters wide."""
        widest = {name: max(len(row[name].printed) for row in self.rows.values()) for name in self.columns}
        long = [name for name in [*self.columns][1:] if not self.columns[name].unit and widest[name] > LONG]
        columns = {name: column for name, column in self.columns.items() if name not in long}
        units = [f"[{c.unit}{'' if c.unit_printed else '*'}]" if c.unit else "" for c in columns.values()]
        cells = [[row[name].printed for name in columns] for row in self.rows.values()]
        grid = [[*columns], units, *cells]
        widths = [max(map(len, entries)) for entries in zip(*grid, strict=True)]
        pads = [str.rjust if unit else str.ljust for unit in units]
        lines = ["  ".join(map(lambda pad, *entry: pad(*entry), pads, line, widths)).rstrip() for line in grid]
        below = [f"{column.name}: {column.meaning}" for column in self.columns.values()]
        below += ["* this unit is not printed in the thesis"] * any("*" in unit for unit in units)
        below += [f"{a}, {b}: {cell.lack}" for a, row in self.rows.items() for b, cell in row.items() if cell.lack]
        below += [f"{a}: {row[name].printed}" for name in long for a, row in self.rows.items() if row[name].printed]
        below += [f"Source: {self.source}", *(f"- {note}" for note in self.notes)]
        wrapped = [line for paragraph in below for line in wrap(paragraph, 100, subsequent_indent="  ")]
        return "\n".join([f"Table {self.number}: {self.title}", "", *lines, "", *wrapped])


def tables() -> list[str]:
    """Return the numbers of the tables in order: ["3.1", "3.2", ...]; "3.text" holds the numbers of a text."""
    return sorted(path.name.split("_")[0] for path in _FOLDER.glob("[0-9].*_*.toml"))


def table(number: str) -> Table:
    """Return the thesis's table of that number; raises BadInput with the nearest for another."""
    return read_table(next(_FOLDER.glob(f"{_known(number, tables(), 'table')}_*.toml")))


def read_table(path: Path) -> Table:
    """Read one table file; raises BadInput naming the file and the field that is wrong."""
    try:  # numbers stay text, because a float forgets the digits printed (1.60)
        raw = _checked(tomllib.loads(path.read_text("utf-8"), parse_float=str), _FILE, "field")
        columns = {name: Column(name=name, **head) for name, head in raw.pop("columns").items()}
        for column in columns.values():
            _checked(vars(column), _COLUMN, f"column {column.name}, field")
        rows, key = [_row(row, columns) for row in raw.pop("row")], next(iter(columns), "")
    except (BadInput, OSError, ValueError, TypeError, AttributeError, RecursionError) as error:
        raise BadInput(path, f"is no table: {error}", "compare the tables in data/tables") from error
    labelled = {row[key].printed: row for row in rows}
    if not labelled or len(labelled) < len(rows) or columns[key].unit:
        raise BadInput(f"{path}, column {key!r}", "is the first, but no text that tells the rows apart")
    return Table(**raw | {"notes": tuple(map(str, raw["notes"]))}, columns=columns, rows=labelled)


def _row(raw: dict[str, Any], columns: Mapping[str, Column]) -> dict[str, Cell]:
    units, lacks = raw.pop("units", {}), raw.pop("not_printed", {})
    at = f"row {next(iter(raw.values()), '')!r}, column"
    _checked({"units": units, "not_printed": lacks}, {"units": dict, "not_printed": dict}, at)
    for name in (*raw, *units, *lacks):
        _known(name, columns, at)
    return {n: _cell(raw.get(n), lacks.get(n), c.unit, units.get(n, c.unit), f"{at} {n!r}") for n, c in columns.items()}


def _cell(printed: object, lack: str | None, head: str, unit: str, place: str) -> Cell:
    if (printed is None) == (lack is None):
        raise BadInput(place, "needs either a value or a reason in not_printed")
    if lack is not None:
        return Cell(printed="-", lack=f"not printed in the thesis: {lack}")
    if not head:
        return Cell(printed=str(printed))
    if unit == UNDOCUMENTED:
        quantity(f"{printed} 1", "1", place)
        return Cell(printed=f"{printed} ?", lack=f"{printed} is printed without a unit, and none is inferred")
    written = f"{printed} {unit}"
    return Cell(printed=str(printed) if unit == head else written, si=quantity(written, unit, place))


def _checked(raw: dict[str, Any], kinds: Mapping[str, type], place: str) -> dict[str, Any]:
    for name in (*raw, *kinds):
        if not isinstance(raw.get(name), kinds[_known(name, kinds, place)]):
            raise BadInput(f"{place} {name!r}", f"is {raw.get(name)!r:.60}", f"expected {kinds[name].__name__}")
    return raw


def _known(name: object, valid: Collection[str], place: str) -> str:
    if name in valid:
        return str(name)
    folded = {known.casefold(): known for known in valid}
    (nearest,) = difflib.get_close_matches(str(name).casefold(), folded, n=1, cutoff=0)
    raise BadInput(place, f"{name!r} is unknown", f"the nearest is {folded[nearest]!r}")
