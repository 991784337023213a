"""Hyperelastic laws with a bulk modulus of their own, and the printable materials of thesis Table 5.1.

Every law is a shape-changing part, isochoric but for Saint-Venant-Kirchhoff, and kappa/2 m^2 with
m = J - 1 (Saint-Venant-Kirchhoff: m = tr E). A mixed element takes m as its mean over the element.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from data.errors import BadInput
from data.signal import Array
from data.table import table

PARAMETERS = 6  # the most numbers a law has in a kernel's table

NEO_HOOKE, MOONEY_RIVLIN, YEOH, OGDEN, HOOKE = range(5)


@dataclass(frozen=True, kw_only=True)
class Law(ABC):
    """A material: its law's numbers [Pa], Poisson's ratio at small strain, and how far it may be stretched.

    `elongation` is the engineering strain at which the material may break (infinite: not known).
    Raises BadInput for numbers that make no stable solid at small strain.
    """

    code: ClassVar[int]
    nu: float = 0.499
    name: str = ""
    elongation: float = inf

    def __post_init__(self) -> None:
        """Check that the small-strain moduli are positive."""
        if not 0.0 <= self.nu < 0.5:
            raise BadInput("material, nu", f"is {self.nu:g}", "expected 0 up to, not including, 0.5")
        if not (all(map(isfinite, self.numbers())) and self.shear > 0):
            raise BadInput(
                "material", f"{type(self).__name__} has a shear modulus of {self.shear:g} Pa", "expected > 0"
            )

    @abstractmethod
    def numbers(self) -> tuple[float, ...]:
        """Return the law's numbers, PARAMETERS at most; those in Pa scale with the stiffness."""

    @property
    @abstractmethod
    def shear(self) -> float:
        """Shear modulus at small strain [Pa]."""

    @abstractmethod
    def uniaxial(self, stretch: ArrayLike) -> Array:
        """Return the engineering stress [Pa] of the incompressible law in uniaxial tension; broadcasts."""

    @property
    def kappa(self) -> float:
        """Modulus of the volumetric measure [Pa]: the bulk modulus 2 mu (1 + nu) / (3 (1 - 2 nu))."""
        return 2 * self.shear * (1 + self.nu) / (3 * (1 - 2 * self.nu))


@dataclass(frozen=True)
class NeoHooke(Law):
    """W = c1 (I1 - 3), I1 of J^(-1/3) F; c1 [Pa], mu = 2 c1 (thesis 2.20)."""

    code: ClassVar[int] = NEO_HOOKE
    c1: float

    def numbers(self) -> tuple[float, ...]:
        """Return (c1,)."""
        return (self.c1,)

    @property
    def shear(self) -> float:
        """Shear modulus [Pa]."""
        return 2 * self.c1

    def uniaxial(self, stretch: ArrayLike) -> Array:
        """Return 2 c1 (l - l^-2) [Pa]."""
        s = np.asarray(stretch, dtype=np.float64)
        return np.asarray(2 * self.c1 * (s - s**-2))


@dataclass(frozen=True)
class MooneyRivlin(Law):
    """W = c1 (I1 - 3) + c2 (I2 - 3), both isochoric; c1, c2 [Pa], mu = 2 (c1 + c2)."""

    code: ClassVar[int] = MOONEY_RIVLIN
    c1: float
    c2: float

    def numbers(self) -> tuple[float, ...]:
        """Return (c1, c2)."""
        return (self.c1, self.c2)

    @property
    def shear(self) -> float:
        """Shear modulus [Pa]."""
        return 2 * (self.c1 + self.c2)

    def uniaxial(self, stretch: ArrayLike) -> Array:
        """Return 2 (c1 + c2 / l) (l - l^-2) [Pa]."""
        s = np.asarray(stretch, dtype=np.float64)
        return np.asarray(2 * (self.c1 + self.c2 / s) * (s - s**-2))


@dataclass(frozen=True)
class Yeoh(Law):
    """W = c1 (I1 - 3) + c2 (I1 - 3)^2 + c3 (I1 - 3)^3; c1, c2, c3 [Pa], mu = 2 c1."""

    code: ClassVar[int] = YEOH
    c1: float
    c2: float
    c3: float

    def numbers(self) -> tuple[float, ...]:
        """Return (c1, c2, c3)."""
        return (self.c1, self.c2, self.c3)

    @property
    def shear(self) -> float:
        """Shear modulus [Pa]."""
        return 2 * self.c1

    def uniaxial(self, stretch: ArrayLike) -> Array:
        """Return 2 (c1 + 2 c2 (I1-3) + 3 c3 (I1-3)^2) (l - l^-2) [Pa]."""
        s = np.asarray(stretch, dtype=np.float64)
        i = s**2 + 2 / s - 3
        return np.asarray(2 * (self.c1 + 2 * self.c2 * i + 3 * self.c3 * i**2) * (s - s**-2))


@dataclass(frozen=True)
class Ogden(Law):
    """W = sum_p mu_p / alpha_p (l1^alpha_p + l2^alpha_p + l3^alpha_p - 3), isochoric stretches, up to 3 terms.

    `mu` [Pa] and `alpha` go together; the small-strain shear modulus is sum mu_p alpha_p / 2.
    """

    code: ClassVar[int] = OGDEN
    mu: tuple[float, ...]
    alpha: tuple[float, ...]

    def __post_init__(self) -> None:
        """Check the pairs, then as every law."""
        if not 1 <= len(self.mu) == len(self.alpha) <= PARAMETERS // 2 or 0.0 in self.alpha:
            raise BadInput(
                "Ogden", f"has {len(self.mu)} mu, {len(self.alpha)} alpha", "expected 1 to 3 pairs, no alpha 0"
            )
        super().__post_init__()

    def numbers(self) -> tuple[float, ...]:
        """Return (mu_1, mu_2, mu_3, alpha_1, alpha_2, alpha_3); a term left out has mu 0 and alpha 2."""
        rest = PARAMETERS // 2 - len(self.mu)
        return (*self.mu, *[0.0] * rest, *self.alpha, *[2.0] * rest)

    @property
    def shear(self) -> float:
        """Shear modulus at small strain [Pa]."""
        return sum(m * a for m, a in zip(self.mu, self.alpha, strict=True)) / 2

    def uniaxial(self, stretch: ArrayLike) -> Array:
        """Return sum mu_p (l^(alpha_p - 1) - l^(-alpha_p / 2 - 1)) [Pa]."""
        s = np.asarray(stretch, dtype=np.float64)
        pairs = zip(self.mu, self.alpha, strict=True)
        return np.asarray(sum((m * (s ** (a - 1) - s ** (-a / 2 - 1)) for m, a in pairs), np.zeros_like(s)))


@dataclass(frozen=True)
class Hooke(Law):
    """Saint-Venant-Kirchhoff, the thesis's Hooke option: W = mu E:E + lambda/2 (tr E)^2; `young` [Pa]."""

    code: ClassVar[int] = HOOKE
    young: float

    def numbers(self) -> tuple[float, ...]:
        """Return (mu,)."""
        return (self.shear,)

    @property
    def shear(self) -> float:
        """Shear modulus at small strain [Pa]."""
        return self.young / (2 * (1 + self.nu))

    @property
    def kappa(self) -> float:
        """Modulus of tr E [Pa]: Lame's lambda."""
        return 2 * self.shear * self.nu / (1 - 2 * self.nu)

    def uniaxial(self, stretch: ArrayLike) -> Array:
        """Return E l (l^2 - 1) / 2 [Pa], for every nu: S = E times the Green strain."""
        s = np.asarray(stretch, dtype=np.float64)
        return np.asarray(self.young * s * (s**2 - 1) / 2)


def printable(name: str, *, nu: float = 0.499) -> NeoHooke:
    """Return a material of thesis Table 5.1 by its name, with its elongation limit.

    Raises BadInput with the nearest name, or with the reason for a row without c1.
    """
    library = table("5.1")
    return NeoHooke(
        c1=library.value(name, "c1"), nu=nu, name=name, elongation=library.value(name, "elongation_at_least")
    )


def scaled(law: Law, factor: float) -> Law:
    """Return the same law, every modulus times a factor."""
    match law:
        case NeoHooke():
            return replace(law, c1=law.c1 * factor)
        case MooneyRivlin():
            return replace(law, c1=law.c1 * factor, c2=law.c2 * factor)
        case Yeoh():
            return replace(law, c1=law.c1 * factor, c2=law.c2 * factor, c3=law.c3 * factor)
        case Ogden():
            return replace(law, mu=tuple(m * factor for m in law.mu))
        case Hooke():
            return replace(law, young=law.young * factor)
    raise BadInput("material", f"is {law!r}", "expected one of the laws in fem.material")
