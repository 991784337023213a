"""Units as people read them; SI stays inside."""

from typing import TYPE_CHECKING

from data.signal import Signal
from data.units import UNDOCUMENTED

if TYPE_CHECKING:
    from catheter.lab.replay import LoopFamily

DISPLAY = {
    "Pa": ("kPa", 1e-3),
    "m": ("mm", 1e3),
    "m^3": ("mL", 1e6),
    "m^3/s": ("mL/s", 1e6),
    "N m^3": ("N mL", 1e6),
    "J": ("mJ", 1e3),
    "Pa m": ("kPa mm", 1.0),
    "m m": ("mm mm", 1e6),
}


def display(unit: str) -> tuple[str, float]:
    """Return (the unit that is shown, the factor from SI to it): 'Pa' -> ('kPa', 0.001)."""
    return DISPLAY.get(unit, (unit, 1.0))


def shown_unit(signal: Signal) -> tuple[str, float]:
    """Return (the unit that is shown, the factor from SI to it); one nobody documented is said."""
    return display(signal.unit) if signal.documented else (UNDOCUMENTED, 1.0)


def area_unit(family: "LoopFamily") -> tuple[str, float]:
    """Return the unit and factor of a loop's area; a unit nobody documented is said, not left out."""
    if family.x.documented and family.y.documented:
        return display(family.unit)
    (y, of_y), (x, of_x) = shown_unit(family.y), shown_unit(family.x)
    return f"[{y}] x [{x}]", of_y * of_x
