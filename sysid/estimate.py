"""What a fit is worth: standard errors, block-bootstrap intervals, inclusion, whiteness, dropped terms."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput
from data.options import option
from sysid.reduction import Reduction, _triangle
from sysid.selection import RULES, Selection, select

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Bootstrap:
    """Moving blocks of `block_units` units (see `Reduction`), drawn round the record's end."""

    resamples: int = option(400, least=20, most=100_000)
    block_units: int = option(4, least=1)
    level: float = option(0.95, least=0.5, most=0.999)
    seed: int = option(0, least=0)


@dataclass(frozen=True, eq=False)
class Estimate:
    """One chosen model: its constant first, then its terms; arrays are (p+1,) unless said.

    standard_errors hold for white residuals; low and high are percentiles over block-bootstrap
    resamples, which allow for residuals that are alike for up to a block. inclusion: for each
    rule the share of resamples that picks each of all k terms, (k,).
    """

    names: tuple[str, ...]
    values: Array
    standard_errors: Array
    low: Array
    high: Array
    inclusion: dict[str, Array]
    rmse: float
    root_sum_square: float
    fit_percent: float
    condition: float
    samples: int
    options: Bootstrap


@dataclass(frozen=True)
class Whiteness:
    """Ljung-Box: Q = n (n+2) sum r_h^2 / (n-h) over `lags`, against chi-square; first: r_1."""

    statistic: float
    p_value: float
    lags: int
    first: float


def standard_errors(reduction: Reduction, selection: Selection, mask: int) -> tuple[Array, float]:
    """Return (standard errors of the constant and a subset's terms for white residuals, condition).

    Raises BadInput for collinear terms.
    """
    active = [0, *(bit + 1 for bit in range(len(selection.terms)) if (mask >> bit) & 1)]
    columns = reduction.total[:, active]
    length = np.linalg.norm(columns, axis=0)
    singular, right = np.linalg.svd(columns / np.where(length > 0, length, 1))[1:]
    if singular[-1] < 1e-11 * singular[0]:
        names = ", ".join(selection.names(mask))
        found = f"condition number {singular[0] / max(singular[-1], 1e-300):.1e}"
        raise BadInput(f"terms 1, {names}", found, "leave out one of the terms that say the same")
    spare = max(1, len(reduction) - len(active))
    deviation = float(selection.rmse[mask]) * np.sqrt(len(reduction) / spare)
    spread = np.linalg.norm(right.T / singular, axis=1)
    return deviation * spread / length, float(singular[0] / singular[-1])


def estimate(reduction: Reduction, selection: Selection, mask: int, options: Bootstrap | None = None) -> Estimate:
    """Return a chosen subset's weights with their uncertainty. Raises BadInput for collinear terms."""
    chosen = options or Bootstrap()
    mask = selection.support(mask)
    errors, condition = standard_errors(reduction, selection, mask)
    draws, picks = _resampled(reduction, selection, mask, chosen)
    tail = (1 - chosen.level) / 2
    low, high = np.quantile(draws, [tail, 1 - tail], axis=0)
    rmse = float(selection.rmse[mask])
    spread = selection.response_deviation
    return Estimate(
        names=("1", *selection.names(mask)),
        values=_values(selection, mask, mask),
        standard_errors=errors,
        low=low,
        high=high,
        inclusion={rule: picks[index] / chosen.resamples for index, rule in enumerate(RULES)},
        rmse=rmse,
        root_sum_square=float(rmse * np.sqrt(len(reduction))),
        fit_percent=100 * (1 - rmse / spread) if spread > 0 else float("nan"),
        condition=condition,
        samples=len(reduction),
        options=chosen,
    )


def _values(selection: Selection, mask: int, shown: int) -> Array:
    kept = [bit for bit in range(len(selection.terms)) if (shown >> bit) & 1]
    return np.array([selection.constants[mask], *selection.weights[mask, kept]])


def _resampled(reduction: Reduction, selection: Selection, mask: int, options: Bootstrap) -> tuple[Array, Array]:
    """Return (values of the chosen terms (b, p+1), how often each rule picks each term (rules, k))."""
    draw = np.random.default_rng(options.seed)
    units = len(reduction.rows)
    length = min(options.block_units, units)
    blocks = -(-units // length)
    values, picks = [], np.zeros((len(RULES), len(selection.terms)))
    for _ in range(options.resamples):
        starts = draw.integers(units, size=blocks)
        counts = np.bincount(((starts[:, None] + np.arange(length)) % units).ravel(), minlength=units)
        drawn = np.flatnonzero(counts)
        stack = np.sqrt(counts[drawn])[:, None, None] * reduction.triangles[drawn]
        rows = np.array([int(counts @ reduction.rows)])
        again = select(
            Reduction(reduction.terms, _triangle(stack)[None], rows),
            constant_free=selection.constant_free,
            signed=selection.signed,
        )
        values.append(_values(again, mask, mask))
        for index, rule in enumerate(RULES):
            picked = again.choose(rule)
            picks[index] += [(picked >> bit) & 1 for bit in range(len(selection.terms))]
    return np.array(values), picks


def ljung_box(residual: Array, lags: int = 20) -> Whiteness:
    """Test whether a residual (n,) is white (Ljung and Box 1978). Raises BadInput for too few samples."""
    from scipy.stats import chi2

    n = len(residual)
    if n <= lags + 1:
        raise BadInput("Ljung-Box test", f"{n} samples for {lags} lags", "give fewer lags")
    centred = residual - residual.mean()
    power = float(centred @ centred)
    if power == 0:
        return Whiteness(0.0, 1.0, lags, 0.0)
    r = np.array([float(centred[h:] @ centred[:-h]) / power for h in range(1, lags + 1)])
    statistic = n * (n + 2) * float(np.sum(r**2 / (n - np.arange(1, lags + 1))))
    return Whiteness(statistic, float(chi2.sf(statistic, lags)), lags, float(r[0]))


def dropped(selection: Selection, columns: Array, response: Array) -> tuple[Array, Array]:
    """Return each term's difference of cumulative error when it leaves (thesis eq. 3.33, 3.34), and its end in %.

    (n, k) in the response's unit: sqrt(cumsum(e_p^2)) - sqrt(cumsum(e^2)), a root of sums without
    1/N, which the thesis calls RMSE; (k,) percent of the full model's at the end. columns: X (n, k).
    """
    full = len(selection.rmse) - 1

    def cumulative(mask: int) -> Array:
        error = response - selection.constants[mask] - columns @ selection.weights[mask]
        return np.asarray(np.sqrt(np.cumsum(error**2)))

    whole = cumulative(full)
    differences = np.stack([cumulative(full ^ (1 << bit)) - whole for bit in range(len(selection.terms))], axis=1)
    last = whole[-1] if whole[-1] > 0 else np.nan
    return differences, 100 * differences[-1] / last
