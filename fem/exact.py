"""Exact solutions of finite elasticity that the elements are measured against (incompressible neo-Hookean).

Rivlin, Phil. Trans. R. Soc. A 242 (1949): inflation and extension of a tube, torsion of a cylinder.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from data.signal import Array


@dataclass(frozen=True, kw_only=True)
class ThickTube:
    """A tube of rest radii inner < outer [m], W = c1 (I1 - 3), shear modulus mu = 2 c1 [Pa]."""

    inner: float
    outer: float
    mu: float

    def outer_at(self, bore: ArrayLike, axial: ArrayLike) -> Array:
        """Return the deformed outer radius [m] at a bore [m] and an axial stretch; broadcasts."""
        a, stretch = np.asarray(bore, dtype=np.float64), np.asarray(axial, dtype=np.float64)
        return np.asarray(np.sqrt(a**2 + (self.outer**2 - self.inner**2) / stretch))

    def pressure(self, bore: ArrayLike, axial: ArrayLike = 1.0) -> Array:
        """Return the internal pressure [Pa] that holds a bore [m] at an axial stretch; broadcasts."""
        a, stretch = np.asarray(bore, dtype=np.float64), np.asarray(axial, dtype=np.float64)
        b = self.outer_at(a, stretch)
        c = stretch * a**2 - self.inner**2
        bend = c / 2 * (1 / (stretch * a**2) - 1 / (stretch * b**2))
        return np.asarray(self.mu / stretch * (np.log(self.outer * a / (self.inner * b)) + bend))

    def axial_force(self, bore: float, axial: float) -> float:
        """Return the force on the wall's section [N], beyond what the pressure on a closed end puts on it.

        N = 2 pi int (sigma_zz - sigma_rr / 2 - sigma_tt / 2) r dr, 0 for a free closed end.
        """
        nodes, weights = np.polynomial.legendre.leggauss(60)
        b = float(self.outer_at(bore, axial))
        r = (b - bore) / 2 * nodes + (b + bore) / 2
        rest = np.sqrt(self.inner**2 + axial * (r**2 - bore**2))
        hoop, radial = r / rest, rest / (r * axial)
        difference = self.mu * (axial**2 - radial**2 / 2 - hoop**2 / 2)
        return float(2 * np.pi * (difference * r) @ weights * (b - bore) / 2)

    def closed(self, bore: float) -> tuple[float, float]:
        """Return pressure [Pa] and axial stretch of the tube with free closed ends at a bore [m]."""
        from scipy.optimize import brentq

        axial = float(brentq(lambda stretch: self.axial_force(bore, stretch), 0.5, 4.0, xtol=1e-14, rtol=1e-14))
        return float(self.pressure(bore, axial)), axial

    def limit(self) -> tuple[float, float, float]:
        """Return pressure [Pa], bore [m] and axial stretch of the closed tube's limit point."""
        from scipy.optimize import minimize_scalar

        found = minimize_scalar(
            lambda a: -self.closed(a)[0], bounds=(self.inner, 4 * self.inner), options={"xatol": 1e-12 * self.inner}
        )
        pressure, axial = self.closed(float(found.x))
        return pressure, float(found.x), axial


def torsion(radius: float, twist_per_length: float, mu: float) -> tuple[float, float]:
    """Return torque [N m] and axial force [N] of a solid cylinder twisted at fixed length (Rivlin)."""
    moment = np.pi * mu * twist_per_length * radius**4 / 2
    return float(moment), float(-np.pi * mu * twist_per_length**2 * radius**4 / 4)
