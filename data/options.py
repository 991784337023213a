"""Frozen dataclasses read from TOML: units converted, unknown keys and impossible values refused."""

import json
import math
import tomllib
import types
from collections.abc import Mapping
from dataclasses import MISSING, field, fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from data.errors import BadInput, nearest
from data.files import open_regular
from data.units import quantity

MOST_TOML = 1 << 20
MOST_INTEGER = 1 << 53  # beyond it a float cannot hold it

T = TypeVar("T")


def option(
    default: Any = MISSING,
    *,
    unit: str = "",
    least: float | None = None,
    most: float | None = None,
    choices: tuple[str, ...] = (),
) -> Any:
    """Declare a field of an options dataclass.

    unit: the SI unit of a float, which TOML then gives as text ("83 kPa"). least, most: bounds
    in SI, both allowed themselves. choices: the words a text may be.
    """
    metadata = {"unit": unit, "least": least, "most": most, "choices": choices}
    return field(metadata=metadata) if default is MISSING else field(default=default, metadata=metadata)


def shipped_names(folder: Path) -> list[str]:
    """Return the names of the TOML files that come with the project in a folder."""
    return sorted(path.stem for path in folder.glob("*.toml"))


def find_toml(name: str | Path, folder: Path, what: str) -> Path:
    """Return the path of a shipped file by its name, or of the user's own, which ends in .toml.

    Raises BadInput with the nearest name for one that is not shipped.
    """
    path, names = Path(name), shipped_names(folder)
    if path.suffix == ".toml":
        return path
    if str(name) not in names:
        raise BadInput(f"{what} {str(name)!r}", "is not known", nearest(str(name), names) + "; or name a .toml file")
    return folder / f"{name}.toml"


def load_toml(path: Path) -> tuple[dict[str, Any], str]:
    """Return a TOML file's tables and its text. Raises BadInput naming the file, and the line of a fault."""
    with open_regular(path) as file:
        content = file.read(MOST_TOML + 1)
    if len(content) > MOST_TOML:
        raise BadInput(path, f"is longer than {MOST_TOML} bytes", "name a TOML file")
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise BadInput(path, f"is not TOML: {error}") from error
    return parse_toml(text, str(path)), text


def parse_toml(text: str, place: str) -> dict[str, Any]:
    """Return the tables of a TOML text. Raises BadInput naming `place` and the line of a fault."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: TOML's own errors, and numbers of 5000 digits
        raise BadInput(place, f"is not TOML: {str(error)[:200]}") from error


def read(kind: type[T], table: object, place: str) -> T:
    """Return an options object of dataclass `kind` from a TOML table.

    Raises BadInput naming the place and key for a missing or unknown key, a wrong type, a wrong
    unit, or a value out of bounds.
    """
    if not isinstance(table, Mapping):
        raise BadInput(place, f"is {table!r:.60}", "expected a table")
    hints = get_type_hints(kind)
    known = {f.name: f for f in fields(kind)}  # type: ignore[arg-type]
    for key in table:
        if key not in known:
            raise BadInput(f"{place}, {key}", "is no such key", nearest(key, known))
    values = {}
    for name, f in known.items():
        if name in table:
            values[name] = _convert(table[name], hints[name], f.metadata, f"{place}, {name}")
        elif f.default is MISSING and f.default_factory is MISSING:
            raise BadInput(f"{place}, {name}", "is missing", "it must be given")
    return kind(**values)


def check(options: object, what: str) -> None:
    """Check the bounds and choices that a dataclass's fields declare, for one made in Python.

    Raises BadInput naming `what`, the field, its value and what was expected.
    """
    for f in fields(options):  # type: ignore[arg-type]
        value = getattr(options, f.name)
        for one in value if isinstance(value, tuple) else (value,):
            if one is not None:
                _check(one, f.metadata, f"{what}, {f.name}")


def _convert(value: object, hint: Any, metadata: Mapping[str, Any], place: str) -> object:
    if isinstance(hint, types.UnionType):
        hint = _alternative(value, [part for part in get_args(hint) if part is not types.NoneType])
    if is_dataclass(hint):
        return read(hint, value, place)  # type: ignore[arg-type]
    if get_origin(hint) is tuple:
        if not isinstance(value, list):
            raise BadInput(place, f"is {value!r:.60}", "expected a list")
        return tuple(_convert(v, get_args(hint)[0], metadata, f"{place}[{i}]") for i, v in enumerate(value))
    if hint is float and metadata.get("unit"):
        value = quantity(value, metadata["unit"], place)
    elif isinstance(value, int) and abs(value) > MOST_INTEGER:
        raise BadInput(place, f"is an integer of {len(hex(value)) * 4} bits", f"expected at most {MOST_INTEGER}")
    elif hint is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if type(value) is not hint:
        raise BadInput(place, f"is {value!r:.60}", f"expected {hint.__name__}")
    if isinstance(value, float) and not math.isfinite(value):
        raise BadInput(place, f"is {value}", "expected a finite number")
    _check(value, metadata, place)
    return value


def _alternative(value: object, hints: list[Any]) -> Any:
    """Return the X of X | None (TOML has no null), and of several kinds of table the first with all the keys given."""
    for hint in hints[1:] and hints:
        if is_dataclass(hint) and isinstance(value, Mapping) and value.keys() <= {f.name for f in fields(hint)}:
            return hint
    return hints[0]


def _check(value: Any, metadata: Mapping[str, Any], place: str) -> None:
    least, most, choices, unit = (metadata.get(key) for key in ("least", "most", "choices", "unit"))
    if least is not None and not value >= least:
        raise BadInput(place, f"is {value:g} {unit}".rstrip(), f"expected at least {least:g} {unit}".rstrip())
    if most is not None and not value <= most:
        raise BadInput(place, f"is {value:g} {unit}".rstrip(), f"expected at most {most:g} {unit}".rstrip())
    if choices and value not in choices:
        raise BadInput(place, f"is {value!r}", nearest(str(value), choices))


def to_toml(tables: Mapping[str, Mapping[str, Any]]) -> str:
    """Return TOML text of tables of texts, numbers, booleans, lists and tables of these; floats keep every digit."""
    lines = []
    for name, table in tables.items():
        lines += [f"[{name}]", *(f"{key} = {_toml(value)}" for key, value in table.items()), ""]
    return "\n".join(lines)


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {_toml(one)}" for key, one in value.items()) + "}"
    return repr(float(value)) if isinstance(value, float) else str(value)
