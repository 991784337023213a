"""Units as people read them; SI stays inside."""

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
