"""What the thesis says about its conical valves, held against its own Table 3.5."""

from dataclasses import dataclass

import numpy as np

from catheter.valve import INCH, Cones, cone, measured


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A sentence of the thesis, what the table says to it, whether it holds, and the cells that contradict it."""

    text: str
    table: str
    holds: bool
    against: tuple[str, ...]


def claims() -> tuple[Claim, ...]:
    """Return the thesis's claims about its valves, each computed anew from Table 3.5."""
    known = measured()
    steeper, thicker = (0, "Steeper cones"), (1, "Thicker cones")
    return (
        _range(known),
        _largest(known, degrees=35, inches=0.075, ratio=3.5),
        _small(known),
        _saddle(known),
        _trend(known, *steeper, "forward", -1),
        _trend(known, *steeper, "reverse", 1),
        _trend(known, *thicker, "forward", 1),
        _trend(known, *thicker, "reverse", 1),
    )


def _range(known: Cones) -> Claim:
    inches = known.thickness_m / INCH
    wrong = tuple(f"{x:.3f} in is in the table" for x in inches if not 0.025 <= x.round(6) <= 0.100)
    if not np.isclose(inches, 0.025).any():
        wrong += ("0.025 in is not",)
    return Claim(
        text="thickness ranged from 0.025 to 0.100 in",
        table=f"{', '.join(f'{x:.3f}' for x in inches)} in",
        holds=not wrong,
        against=wrong,
    )


def _largest(known: Cones, *, degrees: float, inches: float, ratio: float) -> Claim:
    angle = np.radians(degrees)
    found = float(cone(angle, inches * INCH).ratio)
    i, j = divmod(int(known.ratio.argmax()), known.ratio.shape[1])
    was = bool(np.isclose(known.angle_rad, angle).any())
    return Claim(
        text=f"the ratio Prev/Pfwd - 1 is {ratio:g} at {degrees:g} deg, {inches:.3f} in",
        table=f"{found:.2f}; the largest is {known.ratio[i, j]:.3f} at {_name(known, i, j)}",
        holds=was and abs(found - ratio) < 0.05,
        against=() if was else (f"{degrees:g} deg was not measured: {found:.2f} is interpolated",),
    )


def _small(known: Cones) -> Claim:
    found = float(cone(0.0, 0.1 * INCH).ratio)
    flat = known.ratio[0]
    same = "every cell of 0 deg is 0" if not flat.any() else f"0 deg spans {flat.min():.3f} to {flat.max():.3f}"
    return Claim(
        text="the ratio is below 0.5 at 0 deg, 0.100 in", table=f"{found:.3f}; {same}", holds=found < 0.5, against=()
    )


def _saddle(known: Cones) -> Claim:
    """A saddle cell: larger than both neighbours along one axis, smaller than both along the other."""
    r = known.ratio
    inner = r[1:-1, 1:-1]
    up = np.sign(inner - r[:-2, 1:-1]) + np.sign(inner - r[2:, 1:-1])
    across = np.sign(inner - r[1:-1, :-2]) + np.sign(inner - r[1:-1, 2:])
    saddles = [_name(known, i + 1, j + 1) for i, j in np.argwhere(up * across == -4)]
    extremes = [
        f"local {'maximum' if up[i, j] > 0 else 'minimum'} at {_name(known, i + 1, j + 1)}"
        for i, j in np.argwhere(up * across == 4)
    ]
    found = f"saddles: {', '.join(saddles) or 'none'}"
    return Claim(
        text="the ratio's map shows a saddle",
        table="; ".join([found, *extremes]),
        holds=bool(saddles),
        against=() if saddles else tuple(extremes),
    )


def _trend(known: Cones, axis: int, which: str, direction: str, sign: int) -> Claim:
    """Whether a cracking pressure rises (sign 1) or falls (-1) with every step along an axis."""
    pressure = {"forward": known.forward_pa, "reverse": known.reverse_pa}[direction]
    psi = pressure / 6894.757293168
    wrong = []
    for i, j in np.argwhere(sign * np.diff(pressure, axis=axis) <= 0):
        after = (i + 1, j) if axis == 0 else (i, j + 1)
        wrong.append(f"{_name(known, i, j)} to {_name(known, *after)}: {psi[i, j]:.1f} to {psi[after]:.1f} psi")
    steps = np.diff(pressure, axis=axis).size
    return Claim(
        text=f"{which} crack at a {'higher' if sign > 0 else 'lower'} {direction} pressure",
        table=f"{steps - len(wrong)} of {steps} steps do",
        holds=not wrong,
        against=tuple(wrong),
    )


def _name(known: Cones, i: int, j: int) -> str:
    return f"{np.degrees(known.angle_rad[i]):.0f} deg, {known.thickness_m[j] / INCH:.3f} in"
