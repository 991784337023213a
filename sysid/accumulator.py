"""Pressure of an accumulator over its volume: a polynomial whose order the data choose."""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class AccumulatorFit:
    """P = sum c_n x^n [Pa], x = V - 1, V the volume over the rest volume, n = 1 .. order (thesis eq. 3.3).

    coefficients, standard_errors (order,) [Pa], the latter for white residuals. rising: the widest
    interval of V within the data where dP/dV > 0, (nan, nan) if there is none. residuals [Pa] and
    conditions: root-sum-square residual and the basis's condition number of every order tried.
    """

    coefficients: Array
    standard_errors: Array
    order: int
    rising: tuple[float, float]
    range: tuple[float, float]
    rmse_pa: float
    residuals: Array
    conditions: Array

    def pressure_pa(self, ratio: Array) -> Array:
        """Return P at volume ratios V, (n,) [Pa]."""
        return np.asarray(np.polynomial.polynomial.polyval(ratio - 1, np.concatenate([[0.0], self.coefficients])))


def fit_accumulator(
    ratio: Array, pressure_pa: Array, *, threshold: float = 0.025, most_order: int = 12, enough_pa: float = 0.0
) -> AccumulatorFit:
    """Fit volume ratios V (n,) and pressures (n,), raising the order while that lowers the residual.

    The order is the last one whose residual is by `threshold` or more below that of the order
    before (thesis eq. 3.5, 3.6: 2.5 %; read literally the rule would keep one order more, the
    first that no longer helps), or the first whose RMSE is `enough_pa`: data without noise have no
    order that no longer helps. Solved by QR of x times Chebyshev polynomials over the data's
    interval, scaled to length 1, and converted to powers at the end: plain powers lose the high
    orders to rounding. Raises BadInput for values that are not finite, a volume that never
    changes, too few samples, or a residual that still falls at `most_order`.
    """
    _check(ratio, pressure_pa, most_order)
    x = ratio - 1
    columns, powers = _basis(x, most_order)
    length = np.linalg.norm(columns, axis=0)
    orthogonal, upper = np.linalg.qr(columns / length)
    shares = orthogonal.T @ pressure_pa
    left = pressure_pa[:, None] - np.cumsum(orthogonal * shares, axis=1)
    residuals = np.linalg.norm(left, axis=0)
    enough = max(1e-12 * float(np.linalg.norm(pressure_pa)), enough_pa * np.sqrt(len(x)))
    order = _order(residuals, enough, threshold)
    conditions = np.array([np.linalg.cond(upper[:n, :n]) for n in range(1, most_order + 1)])
    to_powers = powers[:order, :order] @ np.diag(1 / length[:order]) @ np.linalg.inv(upper[:order, :order])
    coefficients = to_powers @ shares[:order]
    deviation = residuals[order - 1] / np.sqrt(max(1, len(x) - order))
    return AccumulatorFit(
        coefficients=coefficients,
        standard_errors=deviation * np.linalg.norm(to_powers, axis=1),
        order=order,
        rising=_rising(coefficients, float(x.min()), float(x.max())),
        range=(float(ratio.min()), float(ratio.max())),
        rmse_pa=float(residuals[order - 1] / np.sqrt(len(x))),
        residuals=residuals,
        conditions=conditions,
    )


def _check(ratio: Array, pressure_pa: Array, most_order: int) -> None:
    if ratio.shape != pressure_pa.shape or ratio.ndim != 1:
        raise BadInput("accumulator", f"V {ratio.shape}, P {pressure_pa.shape}", "expected two (n,) arrays")
    if not (np.isfinite(ratio).all() and np.isfinite(pressure_pa).all()):
        raise BadInput("accumulator", "volume or pressure is not finite", "drop those samples first")
    if len(np.unique(ratio)) <= most_order + 1:
        found = f"{len(np.unique(ratio))} different volumes"
        raise BadInput("accumulator", found, f"order {most_order} needs more than {most_order + 1}; move the piston")


def _basis(x: Array, order: int) -> tuple[Array, Array]:
    """Return x T_j over the data's interval (n, order), and their coefficients of x^1 .. x^order (column j)."""
    low, high = float(x.min()), float(x.max())
    columns = x[:, None] * np.polynomial.chebyshev.chebvander((2 * x - low - high) / (high - low), order - 1)
    powers = np.zeros((order, order))
    for j in range(order):
        series = np.polynomial.Chebyshev.basis(j, domain=[low, high])
        powers[: j + 1, j] = series.convert(kind=np.polynomial.Polynomial).coef
    return columns, powers


def _order(residuals: Array, enough: float, threshold: float) -> int:
    for order in range(1, len(residuals)):
        before, after = residuals[order - 1], residuals[order]
        if before <= enough or (before - after) / before < threshold:
            return order
    fall = 1 - residuals[-1] / residuals[-2]
    found = f"order {len(residuals)} still lowers the residual by {100 * fall:.1f} %"
    raise BadInput(
        "accumulator", found, f"expected less than {100 * threshold:g} %; measure more evenly, or allow more"
    )


def _rising(coefficients: Array, low: float, high: float) -> tuple[float, float]:
    """Return the widest interval of V in [1 + low, 1 + high] where dP/dV > 0."""
    slope = np.polynomial.Polynomial(coefficients * np.arange(1, len(coefficients) + 1))
    roots = slope.roots()
    real = np.sort(roots[np.abs(roots.imag) < 1e-9 * (1 + np.abs(roots))].real)
    edges = np.concatenate([[low], real[(real > low) & (real < high)], [high]])
    pieces = [(b - a, a, b) for a, b in itertools.pairwise(edges) if slope((a + b) / 2) > 0]
    if not pieces:
        return float("nan"), float("nan")
    _, first, last = max(pieces)
    return 1 + float(first), 1 + float(last)
