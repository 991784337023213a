"""Tensile tests: specimens from a table of text, each freed from toe and preload before anything is fitted."""

import csv
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from io import TextIOWrapper
from pathlib import Path

import numpy as np

from data.errors import BadInput, nearest
from data.files import open_regular
from data.options import option
from data.signal import Array
from data.units import factor_to_si

LEAST_SAMPLES = 8
LEAST_MISFIT = 0.005  # of the stress: what the neo-Hookean curve itself cannot follow over the span
MOST_ROWS = 1_000_000


@dataclass(frozen=True, eq=False)
class Specimen:
    """One tensile test up to its greatest stress: engineering strain (n,), engineering stress (n,) [Pa].

    broke: whether the test ended by rupture; None where the table does not say.
    """

    name: str
    strain: Array
    stress: Array
    broke: bool | None = None


@dataclass(frozen=True, kw_only=True)
class Columns:
    """Where a table keeps its tests: columns of strain, stress and rupture (0 or 1), "" to find them by their names.

    specimen: the columns that tell specimens apart. where: "column=value" of the rows to keep.
    Units are the names' ends (stress_MPa, strain_pct); a strain without one is a ratio.
    """

    strain: str = ""
    stress: str = ""
    broke: str = ""
    specimen: tuple[str, ...] = ()
    where: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Toe:
    """How a specimen's stress-free state is found.

    span: the strains over which the stress is taken for neo-Hookean. factor: the toe ends where that
    curve misses a span's samples by at most this many times what it misses the best span's.
    """

    span: float = option(0.3, least=0.05, most=0.6)
    factor: float = option(3.0, least=1.0, most=10.0)


@dataclass(frozen=True, eq=False)
class Rested:
    """A specimen without its toe: strain (m,) from the stress-free state, stress (m,) [Pa].

    shift: what was added to the strain, positive for a preload, negative for slack. dropped: leading
    samples left out. c1: half the small-strain shear modulus that the zero was found with [Pa].
    """

    name: str
    strain: Array
    stress: Array
    shift: float
    dropped: int
    c1: float
    broke: bool | None


def read_tensile(path: Path, columns: Columns | None = None) -> list[Specimen]:
    """Return the specimens of a table of comma-separated values with a header line.

    Raises BadInput naming file, line and column for unknown columns, what is no number, a unit
    that is not known, and a strain that does not increase (two specimens taken for one).
    """
    wanted = columns or Columns()
    groups: dict[tuple[str, ...], list[tuple[float, float, float]]] = {}
    with TextIOWrapper(open_regular(path), encoding="utf-8-sig", newline="") as file:
        try:
            table = csv.DictReader(file, strict=True)
            names = list(table.fieldnames or ())
            strain, to_ratio = _column(path, names, wanted.strain, "strain", {"pct": 0.01, "percent": 0.01})
            stress, to_pa = _column(path, names, wanted.stress, "stress", {})
            broke = _known(path, names, wanted.broke) if wanted.broke else ("broke" if "broke" in names else "")
            keys = [_known(path, names, name) for name in wanted.specimen]
            kept = _conditions(path, names, wanted.where)
            for row in _checked(table, path):
                if all(row[name].strip() == value for name, value in kept.items()):
                    numbers = [
                        _number(path, table.line_num, row, name) for name in (strain, stress, *filter(None, [broke]))
                    ]
                    group = groups.setdefault(tuple(row[key] for key in keys), [])
                    group.append((numbers[0] * to_ratio, numbers[1] * to_pa, numbers[2] if broke else np.nan))
        except (csv.Error, UnicodeDecodeError) as error:
            raise BadInput(path, f"is no table: {error}", "expected comma-separated text with a header") from error
    if not groups:
        raise BadInput(path, "has no rows" + " that match" * bool(wanted.where), "see the table's header and values")
    named = {" ".join(f"{k} {value}" for k, value in zip(keys, group, strict=True)): group for group in groups}
    return [_specimen(path, name or path.stem, np.array(groups[group])) for name, group in named.items()]


def rested(test: Specimen, toe: Toe | None = None) -> Rested:
    """Return a specimen counted from where its material is free of stress, without toe and preload.

    A test's strain is counted from where its machine began: before it a preload has stretched the
    specimen, or grips still take up slack (the toe). ASTM D638 extends a straight line from beyond the
    toe to zero stress, which a rubber's curve bends away from at once. Here the line is the
    neo-Hookean curve 2 c1 (l - l^-2), l = 1 + strain + shift: Mooney-Rivlin follows it to first order
    in the strain, Yeoh's law to second, so that its two numbers, c1 and shift, are what the samples up
    to `span` can tell. The toe ends at the first sample from which the curve fits about as well as
    from any later one.
    Raises BadInput for too few samples, or a curve that is never stiff.
    """
    chosen = toe or Toe()
    strain, stress = test.strain, test.stress
    last = min(int(np.searchsorted(strain, strain[0] + chosen.span)), len(strain) - LEAST_SAMPLES + 1)
    if last < 1:
        raise BadInput(f"specimen {test.name}", f"has {len(strain)} samples before it tore", "expected 8")
    fits = [_neo_hookean(strain, stress, start, chosen.span) for start in range(last)]
    best = min(misfit for _, _, misfit in fits)
    if not np.isfinite(best):
        raise BadInput(
            f"specimen {test.name}", "has no stress-free state by its first samples", "is it a tensile test?"
        )
    first = next(k for k, (_, _, misfit) in enumerate(fits) if misfit <= max(chosen.factor * best, LEAST_MISFIT))
    c1, shift, _ = fits[first]
    return Rested(test.name, strain[first:] + shift, stress[first:], shift, first, c1, test.broke)


def _neo_hookean(strain: Array, stress: Array, first: int, span: float) -> tuple[float, float, float]:
    """Return (c1 [Pa], shift, misfit) of the neo-Hookean curve nearest to a span of samples, by Gauss-Newton.

    misfit: root mean square distance over the span's last stress, infinite where no such curve is near.
    """
    window = slice(first, max(int(np.searchsorted(strain, strain[first] + span)), first + LEAST_SAMPLES))
    strain, stress = strain[window], stress[window]
    slope, height = np.polyfit(strain, stress, 1)
    c1, shift = float(slope) / 6, float(height / slope) if slope > 0 else 0.0
    for _ in range(50):
        stretch = 1 + strain + shift
        if not (c1 > 0 and (stretch > 0.2).all()):
            break
        bend, steep = 2 * (stretch - stretch**-2), 2 * c1 * (1 + 2 * stretch**-3)
        away = stress - c1 * bend
        step = np.linalg.lstsq(np.stack([bend, steep], axis=1), away, rcond=None)[0]
        if abs(step[1]) < 1e-11 and abs(step[0]) < 1e-10 * c1:
            return c1, shift, float(np.sqrt(np.mean(away**2)) / stress[-1])
        c1, shift = c1 + float(step[0]), shift + float(step[1])
    return np.nan, np.nan, np.inf


def _specimen(path: Path, name: str, rows: Array) -> Specimen:
    """Return a test up to its greatest stress. Raises BadInput for too few samples or a strain that turns."""
    strain, stress, broke = rows.T
    if len(strain) < LEAST_SAMPLES:
        raise BadInput(f"{path}, specimen {name}", f"has {len(strain)} samples", f"expected {LEAST_SAMPLES} or more")
    if not (np.diff(strain) > 0).all():
        at = int(np.argmin(np.diff(strain) > 0)) + 1
        advice = "name the columns that tell specimens apart, as --specimen plate,spec"
        raise BadInput(f"{path}, specimen {name}", f"its strain does not increase at its sample {at + 1}", advice)
    end = int(np.argmax(stress)) + 1
    return Specimen(name, strain[:end], stress[:end], None if np.isnan(broke[0]) else bool(broke[0]))


def _checked(table: "csv.DictReader[str]", path: Path) -> Iterable[dict[str, str]]:
    for number, row in enumerate(table):
        if None in row or None in row.values():
            raise BadInput(f"{path}, line {table.line_num}", "is longer or shorter than the header")
        if number == MOST_ROWS:
            raise BadInput(path, f"has more than {MOST_ROWS:,} rows", "thin it out")
        yield row


def _column(path: Path, names: list[str], given: str, what: str, more: Mapping[str, float]) -> tuple[str, float]:
    """Return a column's name and its factor to SI, from the end of its name."""
    found = [_known(path, names, given)] if given else [name for name in names if what in name.lower()]
    if len(found) != 1:
        raise BadInput(f"{path}, line 1", f"{len(found)} columns are named {what}", f"name one of {', '.join(names)}")
    parts = [part for part in re.split(r"[\W_]+", found[0].replace("%", " pct ")) if part]
    last = parts[-1] if parts else ""
    if last.lower() in more:
        return found[0], more[last.lower()]
    if what == "strain":
        return found[0], 1.0
    try:
        scale = factor_to_si(last)
        known = factor_to_si(f"{last}/Pa") == scale
    except BadInput:
        known = False
    if not known:
        raise BadInput(f"{path}, column {found[0]!r}", "does not end in a unit of stress", "rename it, as stress_MPa")
    return found[0], scale


def _known(path: Path, names: list[str], name: str) -> str:
    if name not in names:
        raise BadInput(f"{path}, line 1", f"has no column {name!r}", nearest(name, names))
    return name


def _conditions(path: Path, names: list[str], where: tuple[str, ...]) -> dict[str, str]:
    found = {}
    for text in where:
        name, equals, value = text.partition("=")
        if not equals:
            raise BadInput("--where", f"is {text!r}", "expected COLUMN=VALUE")
        found[_known(path, names, name.strip())] = value.strip()
    return found


def _number(path: Path, line: int, row: dict[str, str], name: str) -> float:
    try:
        value = float(row[name])
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise BadInput(f"{path}, line {line}, column {name!r}", f"{row[name]!r:.60} is not a finite number")
    return value
