"""Exact solutions of finite elasticity that the elements are measured against (incompressible neo-Hookean).

Rivlin, Phil. Trans. R. Soc. A 242 (1949): inflation and extension of a tube, torsion of a cylinder.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from data.errors import DidNotConverge
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


def compressible_tube(inner: float, outer: float, mu: float, nu: float, pressure: float) -> tuple[float, float]:
    """Return the deformed radii [m] of a tube under internal pressure [Pa], plane strain, at any Poisson's ratio.

    W = mu/2 (J^(-2/3) I1 - 3) + K/2 (J - 1)^2; Chebyshev collocation of the radial equilibrium.
    Raises DidNotConverge where it finds no solution.
    """
    from scipy.optimize import root

    bulk = 2 * mu * (1 + nu) / (3 * (1 - 2 * nu))
    n = int(np.clip(60 * (outer / inner - 1), 6, 24))  # a thin wall needs few points, and rounds off with many
    at = np.cos(np.pi * np.arange(n + 1) / n)
    scale = np.where((np.arange(n + 1) % n) == 0, 2.0, 1.0) * (-1.0) ** np.arange(n + 1)
    gap = at[:, None] - at + np.eye(n + 1)
    slope = np.outer(scale, 1 / scale) / gap
    slope -= np.diag(slope.sum(axis=1))
    slope *= 2 / (outer - inner)
    R = (outer - inner) / 2 * (at + 1) + inner  # from the outside in

    def stresses(r: Array) -> tuple[Array, Array]:
        radial, hoop = slope @ r, r / R
        J = radial * hoop
        first, sphere = radial**2 + hoop**2 + 1, bulk * (J - 1)
        radial_pk, hoop_pk = (
            mu * np.abs(J) ** (-2 / 3) * (own - first / (3 * own)) + sphere * other
            for own, other in ((radial, hoop), (hoop, radial))
        )
        return radial_pk, hoop_pk

    def unbalanced(r: Array) -> Array:
        radial_pk, hoop_pk = stresses(r * inner)
        out = (slope @ radial_pk + (radial_pk - hoop_pk) / R) * inner
        out[0], out[-1] = radial_pk[0], radial_pk[-1] + pressure * r[-1]
        return out / mu

    tube, start = ThickTube(inner=inner, outer=outer, mu=mu), R / inner
    bore = np.linspace(inner, 4 * inner, 3000)
    reached = float(np.interp(pressure, tube.pressure(bore), bore))
    start = np.sqrt(reached**2 + R**2 - inner**2) / inner
    found = root(unbalanced, start, tol=1e-14)
    if np.abs(found.fun).max() > 1e-6 * bulk / mu * 1e-3:
        raise DidNotConverge(f"compressible tube at {pressure:g} Pa: {found.message}")
    return float(found.x[-1] * inner), float(found.x[0] * inner)
