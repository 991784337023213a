"""Materials by name: a row of thesis Table 5.1, or a fit of tensile tests in a TOML of one's own."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from data.errors import BadInput
from data.options import load_toml, option, read

if TYPE_CHECKING:
    from fem.material import Law

LAWS = ("Hooke", "neo-Hooke", "Mooney-Rivlin", "Yeoh", "Ogden")


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """The [material] of a fit: its law's name and numbers, those of other laws left out; elongation [1]."""

    name: str
    law: str = option(choices=LAWS)
    elongation: float = option(least=0.0)
    young: float | None = option(None, unit="Pa")
    c1: float | None = option(None, unit="Pa")
    c2: float | None = option(None, unit="Pa")
    c3: float | None = option(None, unit="Pa")
    mu: float | None = option(None, unit="Pa")
    alpha: float | None = option(None)


def material(name: str, *, nu: float = 0.499) -> "Law":
    """Return a material of thesis Table 5.1 by its name, or that of a fit's file, a name ending in .toml.

    Raises BadInput with the nearest name, the reason for a row without c1, or what a file lacks.
    """
    if not name.endswith(".toml"):
        from fem.material import printable

        return printable(name, nu=nu)
    from catheter.laws import NUMBERS
    from catheter.material_fit import make_law

    given = load_toml(Path(name))[0].get("material", {})
    found = read(Fitted, given, f"{name}, [material]")
    values = [getattr(found, number) for number in NUMBERS[found.law]]
    if None in values:
        raise BadInput(f"{name}, [material]", f"lacks a number of {found.law}", f"expected {NUMBERS[found.law]}")
    return make_law(found.law, np.array(values), nu, found.name, found.elongation)
