"""Units at the edge: what a user writes becomes SI, and SI becomes what a user reads.

Inside the project every number is SI. The conversion itself is pint's; what stands here
keeps hostile text away from it and gives the errors their words.
"""

import re
from functools import cache
from typing import Any

from data.errors import BadInput

UNDOCUMENTED = "undocumented"

_UNIT = re.compile(r"[A-Za-z%°µ]+(?:\^[-+]?\d(?:\.\d)?)?(?:\s*[ */·]\s*[A-Za-z%°µ]+(?:\^[-+]?\d(?:\.\d)?)?){0,5}")
_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?)(?![\d.])\s*(.*?)\s*")
SI_SPELLINGS = (
    *("Pa", "N", "V", "A", "K", "kg", "s", "Hz", "rad", "rad/s", "1"),
    *("m", "m^2", "m^3", "m/s", "m/s^2", "m^3/s", "m^3 Pa^-0.5 s^-1", "Pa s", "kg/m^3"),
    *("N/m", "N m", "N m^2", "N m^3", "V m^3", "V m", "m^-2", "rad^-2"),
)


@cache
def _registry() -> Any:
    from decimal import Decimal

    import pint

    # Decimal keeps 1 mL at exactly 1e-6 m^3, where binary floats give 1.0000000000000002e-06.
    return pint.UnitRegistry(non_int_type=Decimal, autoconvert_offset_to_baseunit=True)


@cache
def _parse(unit: str) -> Any:
    """Return the pint unit of `unit`; raise BadInput naming it when it is none."""
    import pint

    if unit == "1":
        return _registry().Unit("")
    if len(unit) > 60 or not _UNIT.fullmatch(unit):
        raise BadInput(f"unit {unit!r:.60}", "is not written like a unit", "write for example 'kPa', 'mL' or 'm^3/s'")
    try:
        return _registry().Unit(unit.replace("^", "**").replace("·", "*").replace("%", "percent"))
    except (pint.PintError, AttributeError, ValueError, TypeError) as error:
        raise BadInput(f"unit {unit!r}", "is unknown", "write for example 'kPa', 'mL' or 'm^3/s'") from error


@cache
def _root(unit: str) -> tuple[Any, str]:
    """Return (factor, root units). Root units keep the radian, so 'rpm' is never taken for 'Hz'."""
    parsed = _parse(unit)
    if _registry().Quantity(0, parsed).to_root_units().magnitude:
        raise BadInput(f"unit {unit!r}", "has an offset from its SI unit", "give the value in K")
    quantity = _registry().Quantity(_registry().non_int_type(1), parsed).to_root_units()
    return quantity.magnitude, str(quantity.units)


@cache
def si_unit(unit: str) -> str:
    """Return the SI spelling of a unit: 'kPa' -> 'Pa', 'mL' -> 'm^3', 'deg' -> 'rad', '%' -> '1'.

    Raises BadInput when the unit is unknown or the project has no SI spelling for it.
    """
    root = _root(unit)[1]
    for spelling in SI_SPELLINGS:
        if _root(spelling)[1] == root:
            return spelling
    raise BadInput(f"unit {unit!r}", "has no SI spelling here", f"known are {', '.join(SI_SPELLINGS)}")


@cache
def factor_to_si(unit: str) -> float:
    """Return the factor from `unit` to its SI spelling: 'kPa' -> 1000.0. Raises as `si_unit`."""
    return float(_root(unit)[0] / _root(si_unit(unit))[0])


def quantity(text: object, unit: str, place: str = "quantity") -> float:
    """Return the SI value of a text such as '83 kPa', which must have the dimension of `unit`.

    Raises BadInput naming `place` when the text is no number with a unit, or the dimension
    differs. A bare number is refused: a unit that is not written is a guess.
    """
    match = _QUANTITY.fullmatch(text) if isinstance(text, str) and len(text) < 100 else None
    if match is None:
        raise BadInput(place, f"{text!r} is not a number with a unit", f"write for example '1.5 {unit}'")
    number, written = match.groups()
    written = written or "1"
    try:
        written_root = _root(written)
    except BadInput as error:
        raise BadInput(place, f"{text!r} is no quantity: {error}") from error
    if written_root[1] != _root(unit)[1]:
        raise BadInput(place, f"{text!r} has the wrong dimension", f"expected something in {unit}")
    return float(_registry().non_int_type(number) * written_root[0] / _root(si_unit(unit))[0])
