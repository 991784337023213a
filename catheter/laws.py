"""What the five laws say of a stretch: their columns for least squares, and where they are stable (Drucker)."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from data.signal import Array
from fem.material import Hooke, Law, MooneyRivlin, NeoHooke, Ogden, Yeoh

Maker = Callable[[list[float]], Law]

LINEAR: dict[str, tuple[tuple[str, ...], Maker]] = {  # names of the numbers [Pa], and the law made of them
    "Hooke": (("young",), lambda n: Hooke(*n)),
    "neo-Hooke": (("c1",), lambda n: NeoHooke(*n)),
    "Mooney-Rivlin": (("c1", "c2"), lambda n: MooneyRivlin(*n)),
    "Yeoh": (("c1", "c2", "c3"), lambda n: Yeoh(*n)),
}
OGDEN = "Ogden"
NUMBERS = {name: names for name, (names, _) in LINEAR.items()} | {OGDEN: ("mu", "alpha")}  # Ogden: one term
MODES = {"tension": (1.0, -0.5), "both ways": (1.0, 1.0), "shear": (1.0, 0.0)}  # log strains 1 and 2 over the first


def columns(name: str, stretch: Array) -> Array:
    """Return d stress / d number of a law that is linear in its numbers, at stretches (n,): (n, k) [1]."""
    names, make = LINEAR[name]
    unit = [1.0] + [0.0] * (len(names) - 1)  # alone, a higher number would make no solid
    base = make(unit).uniaxial(stretch)
    raised = [[a + (k == i) for i, a in enumerate(unit)] for k in range(len(names))]
    return np.stack([make(numbers).uniaxial(stretch) - base for numbers in raised], axis=1)


def powers(law: Law) -> tuple[list[tuple[float, float]], tuple[float, float]]:
    """Return W of an incompressible law as sum c (l1^a + l2^a + l3^a) over pairs (c, a), and Yeoh's (c2, c3)."""
    match law:
        case NeoHooke():
            return [(law.c1, 2.0)], (0.0, 0.0)
        case MooneyRivlin():
            return [(law.c1, 2.0), (law.c2, -2.0)], (0.0, 0.0)
        case Yeoh():
            return [(law.c1, 2.0)], (law.c2, law.c3)
        case Ogden():
            return [(m / a, a) for m, a in zip(law.mu, law.alpha, strict=True)], (0.0, 0.0)
        case Hooke():  # mu E:E with mu = young / 3; E = (l^2 - 1) / 2
            return [(law.young / 12, 4.0), (-law.young / 6, 2.0)], (0.0, 0.0)
    raise TypeError(law)


def stiffness(law: Law, e1: Array, e2: Array) -> Array:
    """Return the Hessian of W over the log strains (e1, e2), e3 = -e1 - e2, (..., 2, 2) [Pa].

    In plane stress it takes rates of log strain to rates of true stress of an incompressible body.
    """
    pairs, (c2, c3) = powers(law)
    total = sum((c * _second(e1, e2, a) for c, a in pairs), np.zeros((*np.shape(e1), 2, 2)))
    if c2 or c3:
        rise = np.exp(2 * e1) + np.exp(2 * e2) + np.exp(-2 * (e1 + e2)) - 3
        third = np.exp(-2 * (e1 + e2))
        first = np.stack([2 * (np.exp(2 * e1) - third), 2 * (np.exp(2 * e2) - third)], axis=-1)
        total = total + (2 * c2 * rise + 3 * c3 * rise**2)[..., None, None] * _second(e1, e2, 2.0)
        total = total + (2 * c2 + 6 * c3 * rise)[..., None, None] * first[..., :, None] * first[..., None, :]
    return np.asarray(total)


def _second(e1: Array, e2: Array, a: float) -> Array:
    x, y, z = np.exp(a * e1), np.exp(a * e2), np.exp(-a * (e1 + e2))
    return np.asarray(a * a * np.stack([np.stack([x + z, z], axis=-1), np.stack([z, y + z], axis=-1)], axis=-2))


@dataclass(frozen=True)
class Stability:
    """Where a law is stable: per mode the stretches nearest to 1 at which it stops, 0 and infinity if it does not.

    Modes are tension (and compression), both ways (equibiaxial) and shear (planar). to: the
    farthest stretch that was tried; 1 / to in compression.
    """

    limits: dict[str, tuple[float, float]]
    to: float

    @property
    def everywhere(self) -> bool:
        """Whether it is stable as far as was tried, in every mode."""
        return all(low == 0 and math.isinf(high) for low, high in self.limits.values())

    @property
    def words(self) -> str:
        """The limits in words."""
        if self.everywhere:
            return f"stable for stretches of {1 / self.to:.2f} to {self.to:.2f}"
        parts = []
        for mode, (low, high) in self.limits.items():
            below, above = f"below {low:.2f}" if low else "", "" if math.isinf(high) else f"above {high:.2f}"
            if below or above:
                parts.append(f"{mode} {' and '.join(filter(None, (below, above)))}")
        return f"unstable in {', '.join(parts)}"


def drucker(law: Law, to: float, steps: int = 400) -> Stability:
    """Return where Drucker's condition holds, d(true stress) : d(log strain) > 0, for stretches 1/to to `to`."""
    limits = {}
    for mode, (one, two) in MODES.items():
        ends = []
        for sign in (-1, 1):
            e = sign * np.linspace(0, math.log(to), steps + 1)
            bad = np.linalg.eigvalsh(stiffness(law, one * e, two * e))[:, 0] <= 0
            ends.append(float(np.exp(e[np.argmax(bad)])) if bad.any() else (0.0 if sign < 0 else math.inf))
        limits[mode] = (ends[0], ends[1])
    return Stability(limits, to)
