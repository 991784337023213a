"""A least-squares answer is proved by its optimality conditions, not by its shape."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from data.errors import BadInput
from sysid.nonnegative import solve, triangle


def problem(seed: int, rows: int = 400, size: int = 9) -> tuple[np.ndarray, np.ndarray]:
    draw = np.random.default_rng(seed)
    columns = draw.normal(size=(rows, size)) @ (np.eye(size) + 0.3 * draw.normal(size=(size, size)))
    return columns * 10.0 ** draw.integers(-6, 7, size), draw.normal(size=rows)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("free", [0, 1, 4, 9])
def test_optimality_conditions_hold(seed: int, free: int) -> None:
    columns, target = problem(seed)
    weights = solve(columns, target, free).weights
    slope = columns.T @ (target - columns @ weights) / np.linalg.norm(columns, axis=0) / np.linalg.norm(target)
    assert np.abs(slope[:free]).max(initial=0) < 1e-12
    bound = weights[free:]
    assert (bound >= 0).all()
    assert np.abs(slope[free:][bound > 0]).max(initial=0) < 1e-12
    assert slope[free:][bound == 0].max(initial=0) < 1e-12


@pytest.mark.parametrize("seed", range(5))
def test_an_independent_solver_agrees(seed: int) -> None:
    columns, target = problem(seed)
    scale = np.linalg.norm(columns, axis=0)
    lower = np.where(np.arange(9) < 3, -np.inf, 0.0)
    other = lsq_linear(columns / scale, target, bounds=(lower, np.inf), method="bvls", tol=1e-15).x
    assert solve(columns, target, 3).weights * scale == pytest.approx(other, abs=1e-10)


@pytest.mark.parametrize("block", [1, 7, 399, 10_000])
def test_the_triangle_answers_for_all_rows_whatever_the_block(block: int) -> None:
    columns, target = problem(1)
    reduced = triangle(columns, target, block)
    for seed in range(5):
        weights = np.random.default_rng(seed).normal(size=9) / np.linalg.norm(columns, axis=0)
        norm = np.linalg.norm(reduced @ np.append(weights, -1))
        assert norm == pytest.approx(np.linalg.norm(columns @ weights - target), rel=1e-13)


def test_columns_of_wildly_different_scale_lose_no_digit() -> None:
    x = np.linspace(0, 29e-6, 5000)  # a volume in m^3: x^3 is 1e-14, the constant 1
    columns = np.stack([np.ones_like(x), x, x**2, x**3], axis=1)
    truth = np.array([0.0122, 0.0, 3.47e-3 * 1e12, 7.88e-4 * 1e18])
    found = solve(columns, columns @ truth, 0).weights
    assert found * columns.max(axis=0) == pytest.approx(truth * columns.max(axis=0), abs=1e-12 * 22)


def test_collinear_free_columns_get_the_shortest_weights() -> None:
    x = np.linspace(0, 1, 50)
    weights = solve(np.stack([x, x, np.ones(50)], axis=1), 3 * x + 1, 3).weights
    assert weights == pytest.approx([1.5, 1.5, 1.0], abs=1e-12)


@pytest.mark.parametrize("seed", range(10))
def test_a_column_that_free_ones_do_already_harms_nothing(seed: int) -> None:
    # as a play operator whose radius is never reached: a constant, beside the constant
    draw = np.random.default_rng(seed)
    x = np.cumsum(draw.normal(size=3000)) / 50
    columns = np.stack([np.ones(3000), x, x**2, x**3, np.full(3000, 0.7), 2 * x + 1, np.maximum(x, 0)], axis=1)
    target = 50 + 3 * x - 2 * x**2 + 0.5 * np.maximum(x, 0) + 0.1 * draw.normal(size=3000)
    found = solve(columns, target, 4)
    kept = columns[:, [0, 1, 2, 3, 6]]
    best = lsq_linear(kept, target, bounds=([-np.inf] * 4 + [0], np.inf), method="bvls", tol=1e-14)
    assert found.residual_norm == pytest.approx(np.sqrt(2 * best.cost), rel=1e-9)
    assert np.linalg.norm(columns @ found.weights - target) == pytest.approx(found.residual_norm, rel=1e-9)


@pytest.mark.parametrize(
    ("columns", "target", "found"),
    [
        (np.ones((3, 1)), np.array([1.0, np.nan, 1.0]), "not finite"),
        (np.ones((0, 1)), np.ones(0), "no samples"),
        (np.ones((3, 1)), np.ones(2), "expected"),
    ],
)
def test_bad_input_is_refused(columns: np.ndarray, target: np.ndarray, found: str) -> None:
    with pytest.raises(BadInput, match=found):
        solve(columns, target, 1)
