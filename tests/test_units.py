"""Units are converted at the edge, exactly, and never guessed."""

import pytest

from data.errors import BadInput
from data.units import factor_to_si, quantity, si_unit


@pytest.mark.parametrize(
    ("unit", "si", "factor"),
    [
        ("kPa", "Pa", 1e3),
        ("psi", "Pa", 6894.757293168362),  # 0.45359237 kg x 9.80665 m/s^2 / (0.0254 m)^2
        ("bar", "Pa", 1e5),
        ("mL", "m^3", 1e-6),
        ("mm", "m", 1e-3),
        ("in", "m", 0.0254),
        ("deg", "rad", 0.017453292519943295),
        ("rpm", "rad/s", 0.10471975511965977),
        ("Hz", "Hz", 1.0),
        ("ms", "s", 1e-3),
        ("%", "1", 0.01),
        ("m^3 Pa^-0.5 s^-1", "m^3 Pa^-0.5 s^-1", 1.0),
    ],
)
def test_factors_are_the_defined_ones_to_the_last_digit(unit: str, si: str, factor: float) -> None:
    assert si_unit(unit) == si
    assert factor_to_si(unit) == pytest.approx(factor, rel=3e-16)


def test_a_quantity_has_the_digits_that_were_written() -> None:
    assert quantity("29.06 mL", "m^3") == 29.06e-6
    assert quantity(" -4.71 V ", "V") == -4.71
    assert quantity("3", "1") == 3.0


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("5", "m"),  # no unit written: a guess
        (5.0, "m"),
        ("83 kPa", "m"),
        ("30 deg", "1"),  # an angle is not a plain number
        ("30 rpm", "Hz"),
        ("9**9**9 m", "m"),
        ("1 __import__('os')", "m"),
        ("1 " + "m*" * 500 + "m", "m"),
        ("1e9999 m", "m"),
        ("20 degC", "K"),
        ("nan m", "m"),
        ("", "m"),
    ],
)
def test_what_is_no_such_quantity_is_refused_in_words(text: object, unit: str) -> None:
    with pytest.raises(BadInput, match="unit|quantity"):
        quantity(text, unit)
