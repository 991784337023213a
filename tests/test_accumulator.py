"""The accumulator's order, coefficients and rising interval, against what the curve was made from."""

import numpy as np
import pytest

from data.errors import BadInput
from data.table import table
from sysid.accumulator import fit_accumulator


@pytest.mark.parametrize("name", ["Act 1", "Act 2", "Act 3"])
def test_the_thesis_coefficients_are_found_without_noise(name: str) -> None:
    truth = np.array([table("3.3").value(name, f"c{n}") for n in range(1, 5)])
    ratio = 1 + 0.45 * np.linspace(0, 1, 500)
    pressure = np.polynomial.polynomial.polyval(ratio - 1, [0, *truth])
    found = fit_accumulator(ratio, pressure)
    assert found.order == 4
    assert found.coefficients == pytest.approx(truth, rel=1e-10)
    assert found.pressure_pa(ratio) == pytest.approx(pressure, rel=1e-9, abs=1e-6)


def test_intervals_cover_the_truth_at_their_rate() -> None:
    truth = np.array([1.6e5, 5.92e5, -11.14e5, 7.18e5])
    ratio = 1.225 - 0.225 * np.cos(np.linspace(0, 12 * np.pi, 2000))
    clean = np.polynomial.polynomial.polyval(ratio - 1, [0, *truth])
    inside = np.zeros(4)
    for seed in range(100):
        found = fit_accumulator(ratio, clean + 150 * np.random.default_rng(seed).normal(size=2000))
        assert found.order == 4
        inside += np.abs(found.coefficients - truth) < 1.96 * found.standard_errors
    assert (inside >= 88).all()  # the 99 % binomial band of 0.95 in 100


def test_the_order_is_the_last_that_lowers_the_residual_by_its_share() -> None:
    ratio = np.linspace(1, 1.5, 300)
    pressure = 1e5 * np.sin(3 * (ratio - 1)) + 200 * np.random.default_rng(0).normal(size=300)
    found = fit_accumulator(ratio, pressure)
    falls = 1 - found.residuals[1:] / found.residuals[:-1]
    assert (falls[: found.order - 1] >= 0.025).all()
    assert falls[found.order - 1] < 0.025


def test_no_jump_at_high_orders_where_plain_powers_have_one() -> None:
    # like a balloon: steep, then falling, then steep; 56 points, as a real one measured by others
    x = np.linspace(0, 4, 56)
    pressure = 2e4 * x * np.exp(-1.3 * x) * (1 + 0.02 * x**4) + 20 * np.random.default_rng(2).normal(size=56)
    found = fit_accumulator(1 + x, pressure)
    assert (np.diff(found.residuals) <= 1e-9 * found.residuals[0]).all()
    assert found.conditions.max() < 1e4  # of powers: the square root of 1e16 and more
    powers = np.linalg.cond(x[:, None] ** np.arange(1, 13))
    assert powers > 1e9
    for order in (4, 8, 12):  # an independent solution on a scaled basis
        basis = (x / 4)[:, None] * np.polynomial.legendre.legvander(x / 2 - 1, order - 1)
        best = np.linalg.lstsq(basis, pressure, rcond=None)[0]
        norm = np.linalg.norm(pressure - basis @ best)
        assert found.residuals[order - 1] == pytest.approx(norm, rel=1e-9)


def test_the_rising_interval_is_where_the_slope_is_positive() -> None:
    ratio = np.linspace(0.97, 1.4, 400)
    truth = [table("3.3").value("Act 3", f"c{n}") for n in range(1, 5)]
    found = fit_accumulator(ratio, np.polynomial.polynomial.polyval(ratio - 1, [0, *truth]))
    assert found.rising == (pytest.approx(1.0135, abs=5e-4), pytest.approx(1.4))  # the table's note: 0.0135
    falling = fit_accumulator(ratio, -1e5 * (ratio - 1))
    assert np.isnan(falling.rising).all()


def test_what_cannot_be_fitted_is_refused() -> None:
    with pytest.raises(BadInput, match="1 different volumes"):
        fit_accumulator(np.ones(100), np.arange(100.0))
    with pytest.raises(BadInput, match="not finite"):
        fit_accumulator(np.linspace(1, 2, 50), np.full(50, np.nan))
    with pytest.raises(BadInput, match="still lowers the residual"):
        x = np.linspace(0, 1, 200)
        fit_accumulator(1 + x, np.sin(60 * x), most_order=3, threshold=1e-6)
