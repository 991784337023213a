"""Material constants of a printed actuator from its measured pressure and twist, with intervals.

A handful of moduli, one for each group of voxels, by least squares on the twist curve. Both channels are
noisy: each sample's true pressure is sought along with the moduli (orthogonal distance regression: Boggs, Byrd and
Schnabel, SIAM J. Sci. Stat. Comput. 8, 1987). Weighing at the noisy pressures themselves would be biased.
So is the twist's zero: it is counted from one frame, whose noise all others share.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from data.errors import BadInput, DidNotConverge
from data.signal import Array
from fem.observation import Pose, twist
from fem.sensitivity import adjoint
from fem.voxels import Standing, Voxels

NORMAL_95 = 1.959963984540054
MOST_STEPS = 30
SETTLED = 0.05  # of a modulus's standard deviation: a step below it is the last, for each is far below the one before


@dataclass(frozen=True, eq=False)
class Curve:
    """Twist angle [rad] at pressures (k,) [Pa] from 0 up: its slope over pressure, and over log moduli (k, m)."""

    pressure: Array
    angle: Array
    slope: Array
    by_log: Array

    def at(self, pressure: Array) -> tuple[Array, Array, Array]:
        """Return angle, slope (n,) and slope over log moduli (n, m) elsewhere, straight beyond the ends."""
        from scipy.interpolate import CubicHermiteSpline, CubicSpline

        inside = np.clip(pressure, self.pressure[0], self.pressure[-1])
        spline = CubicHermiteSpline(self.pressure, self.angle, self.slope)
        slope = spline(inside, 1)
        return spline(inside) + slope * (pressure - inside), slope, CubicSpline(self.pressure, self.by_log)(inside)


@dataclass(frozen=True, eq=False)
class Calibration:
    """Moduli (m,) [Pa], the covariance (m, m) of their logarithms, and 95 % intervals (m, 2) [Pa].

    misfit: root mean square misfit in its own standard deviation, about 1 where the noise is as said.
    curve: the model there, but for the last step.
    """

    moduli: Array
    covariance: Array
    interval: Array
    misfit: float
    steps: int
    curve: Curve


def calibrate(
    curve: Callable[[Array], Curve],
    pressure: Array,
    angle: Array,
    *,
    angle_sd: float,
    pressure_share: float,
    seed: Array,
) -> Calibration:
    """Return the moduli that explain twists (n,) [rad] at pressures (n,) [Pa].

    curve gives the model at log moduli (m,); angle_sd [rad] and pressure_share (of the reading) are the noises.
    Raises BadInput for data that cannot be weighed, DidNotConverge where steps do not settle.
    """
    pressure, angle = np.asarray(pressure, dtype=float), np.asarray(angle, dtype=float)
    if pressure.shape != angle.shape or len(pressure) <= len(seed) or not np.isfinite(pressure + angle).all():
        raise BadInput("calibration", f"{pressure.shape} pressures, {angle.shape} twists", "expected more than moduli")
    if not (angle_sd > 0 and pressure_share >= 0):
        raise BadInput("calibration, noise", f"is {angle_sd:g} rad", "expected above 0")
    log, true, zero = np.log(seed), pressure, 0.0
    for number in range(1, MOST_STEPS + 1):
        model = curve(log)
        value, slope, by_log = model.at(true)
        if number == 1 and float(angle @ value) < 0:
            raise BadInput(
                "calibration, twist",
                f"reaches {np.degrees(angle[np.abs(angle).argmax()]):.1f} deg where the model turns the other way",
                "expected anticlockwise, as seen from beyond the tip, above 0: was it filmed from behind?",
            )
        by_pressure = slope * pressure_share * true  # standard deviation of the twist from that of the pressure
        weight = 1 / np.hypot(angle_sd, by_pressure)
        left = angle - zero - value - slope * (pressure - true)
        misfit, known = left * weight, np.append(np.zeros(len(log)), 1 / angle_sd)  # the zero is one frame's
        rows = np.vstack([np.column_stack([by_log, np.ones(len(left))]) * weight[:, None], known])
        *moved, off = np.linalg.lstsq(rows, np.append(misfit, -zero / angle_sd), rcond=None)[0]
        step, zero = np.array(moved), zero + float(off)
        log = log + step * min(1.0, 0.3 / float(np.abs(step).max() or 1.0))
        true = pressure + (left - off - by_log @ step) * weight**2 * by_pressure * pressure_share * true
        covariance = _inverse(rows.T @ rows)[:-1, :-1]
        half = NORMAL_95 * np.sqrt(np.diag(covariance))
        if (np.abs(step) < SETTLED * half / NORMAL_95).all():
            interval: Array = np.exp(np.stack([log - half, log + half], axis=1))
            return Calibration(np.exp(log), covariance, interval, float(np.sqrt((misfit**2).mean())), number, model)
    raise DidNotConverge(
        f"calibration: steps of {np.abs(step).max():.1e} after {MOST_STEPS}; measure at more pressures"
    )


def _inverse(curvature: Array) -> Array:
    try:
        return np.asarray(np.linalg.inv(curvature), dtype=np.float64)
    except np.linalg.LinAlgError:
        raise BadInput(
            "calibration", "the twists do not tell the moduli apart", "measure at higher pressures"
        ) from None


def groups(voxels: Voxels, material: Any) -> Voxels:
    """Return the voxels (v,) taken together by material (v,), numbered from 0: one modulus for each."""
    which = np.where(voxels.which < 0, -1, np.asarray(material)[voxels.which])
    return Voxels(voxels.mesh, which.astype(np.int32), voxels.law, voxels.rest, voxels.newton)


def twist_curve(voxels: Voxels, pressures: Array) -> Callable[[Array], Curve]:
    """Return the full model: log moduli (m,) to the curve at these pressures (k,) [Pa], ascending above 0."""

    def curve(log: Array) -> Curve:
        path = voxels.path(log, pressures.tolist())
        points = [(0.0, np.nan, np.zeros(voxels.count)), *(_point(voxels, one) for one in path)]
        angle, slope, by_log = (np.array(column) for column in zip(*points, strict=True))
        known = np.append(0.0, pressures)
        fit = np.polynomial.Polynomial.fit(known[:4], angle[:4], 3)  # the tangent at rest is not solved for
        slope[0] = fit.deriv()(0.0)
        return Curve(known, angle, slope, by_log)

    return curve


def _point(voxels: Voxels, standing: Standing) -> tuple[float, float, Array]:
    """Return angle, slope over pressure and over log moduli at an equilibrium."""
    rest, x, ring = voxels.mesh.nodes, standing.state.x, voxels.mesh.ring
    seen = Pose(
        pressure=standing.state.load,
        ring=ring,
        rest=rest,
        shift=np.zeros(3),
        turn=np.zeros(3),
        arm=1.0,
        angle_only=True,
    )
    rows = seen.slope(x)
    rise = standing.tangent.solve(-standing.tangent.slope[:, None])[:, 0]
    slope = float((rows @ (voxels.onto(x) @ rise))[0])
    return twist(rest[ring], x[ring]), slope, adjoint(voxels, standing, rows)[0]


def surrogate(
    curve: Callable[[Array], Curve], centre: Array, reach: float, degree: int = 4
) -> Callable[[Array], Curve]:
    """Return a model tabulated on Chebyshev points of log moduli within +-reach of centre (2,), for many repeats.

    Interpolates angle, slope and derivatives by products of Chebyshev polynomials. Raises BadInput for other than
    two moduli, and where it is asked outside.
    """
    from numpy.polynomial import chebyshev

    if centre.shape != (2,):
        raise BadInput("surrogate", f"{centre.shape} moduli", "it holds for two")
    at = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
    table = [[curve(centre + reach * np.array([a, b])) for b in at] for a in at]
    inverse = np.linalg.inv(chebyshev.chebvander(at, degree))
    stacked = [
        np.array([[getattr(one, name) for one in row] for row in table]) for name in ("angle", "slope", "by_log")
    ]
    weights = [np.einsum("ai,bj,ij...->ab...", inverse, inverse, values) for values in stacked]

    def model(log: Array) -> Curve:
        inside = (log - centre) / reach
        if np.abs(inside).max() > 1.0:
            raise BadInput("surrogate", f"asked at {np.exp(log)} Pa", "tabulate further")
        x, y = (chebyshev.chebvander(np.array([v]), degree)[0] for v in inside)
        found = [np.einsum("a,b,ab...->...", x, y, w) for w in weights]
        return Curve(table[0][0].pressure, found[0], found[1], found[2])

    return model
