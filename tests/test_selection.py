"""Every subset's optimum is proved by its optimality conditions and by an independent solver."""

import time
from itertools import combinations, pairwise

import numpy as np
import pytest
from scipy.optimize import nnls

from data.errors import BadInput
from sysid.estimate import Bootstrap, dropped, estimate, ljung_box, standard_errors
from sysid.reduction import Reduction, reduce_blocks, reduce_rows
from sysid.selection import RULES, Selection, select

NAMES = tuple("abcdef")
SCALE = np.array([1e-6, 1e3, 1.0, 1e2, 1e-3, 10.0])


def problem(seed: int, rows: int = 3000, noise: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    draw = np.random.default_rng(seed)
    mixed = draw.normal(size=(rows, 6)) @ (np.eye(6) + 0.4 * draw.normal(size=(6, 6)))
    truth = np.array([1.0, -0.5, 0.0, 0.7, 0.0, 0.02])
    return mixed * SCALE, mixed @ truth + 2.0 + noise * draw.normal(size=rows)


def direct(columns: np.ndarray, response: np.ndarray, kept: list[int]) -> np.ndarray:
    """Return scipy's weights on the raw rows, constant projected out."""
    x, y = columns[:, kept], response - response.mean()
    x = x - x.mean(axis=0)
    length = np.linalg.norm(x, axis=0)
    return nnls(x / length, y)[0] / length


def violation(columns: np.ndarray, response: np.ndarray, found: Selection) -> float:
    """Return the largest breach of the optimality conditions over all subsets, lengths made 1."""
    length, worst = np.linalg.norm(columns, axis=0), 0.0
    length[length == 0] = 1
    for mask, (weights, constant) in enumerate(zip(found.weights, found.constants, strict=True)):
        residual = response - constant - columns @ weights
        slope = columns.T @ residual / length / max(np.linalg.norm(response), 1e-300)
        allowed = (mask >> np.arange(len(weights))) & 1 == 1
        assert (weights >= 0).all()
        assert (weights[~allowed] == 0).all()
        worst = max(worst, np.abs(slope[weights > 0]).max(initial=0), slope[allowed].max(initial=0))
        worst = max(worst, abs(residual.sum()) / len(residual) ** 0.5 / max(np.linalg.norm(response), 1e-300))
    return worst


@pytest.mark.parametrize("seed", range(5))
def test_optimality_conditions_hold_for_every_subset(seed: int) -> None:
    columns, response = problem(seed)
    assert violation(columns, response, select(reduce_rows(NAMES, columns, response))) < 1e-13


@pytest.mark.parametrize("seed", range(3))
def test_every_subset_equals_scipy_on_the_raw_rows(seed: int) -> None:
    columns, response = problem(seed)
    found = select(reduce_rows(NAMES, columns, response))
    for mask in range(1, 64):
        kept = [bit for bit in range(6) if (mask >> bit) & 1]
        assert found.weights[mask, kept] * SCALE[kept] == pytest.approx(direct(columns, response, kept), abs=0) or (
            np.allclose(
                found.weights[mask, kept] * SCALE[kept], direct(columns, response, kept) * SCALE[kept], atol=1e-10
            )
        )


def test_a_constant_that_must_not_be_negative_is_in_every_subset() -> None:
    columns, response = problem(1)
    for shift in (0.0, -9.0):  # with a negative offset the constant rests on its bound
        found = select(reduce_rows(NAMES, columns, response + shift), constant_free=False)
        whole = np.column_stack([np.ones(len(columns)), columns / SCALE])
        for mask in (0, 5, 63):
            kept = [0, *(bit + 1 for bit in range(6) if (mask >> bit) & 1)]
            weights, norm = nnls(whole[:, kept], response + shift)
            assert found.constants[mask] == pytest.approx(weights[0], abs=1e-10)
            assert found.rmse[mask] == pytest.approx(norm / len(response) ** 0.5, rel=1e-10)
    assert found.constants[63] == 0


def test_signed_weights_are_plain_least_squares_of_every_subset() -> None:
    columns, response = problem(1)
    found = select(reduce_rows(NAMES, columns, response), signed=True)
    for mask in (0, 1, 10, 42, 63):
        kept = [bit for bit in range(6) if (mask >> bit) & 1]
        whole = np.column_stack([np.ones(len(columns)), (columns / SCALE)[:, kept]])
        best = np.linalg.lstsq(whole, response)[0]
        assert found.constants[mask] == pytest.approx(best[0], abs=1e-12)
        assert found.weights[mask, kept] * SCALE[kept] == pytest.approx(best[1:], abs=1e-12)
    assert (found.weights < 0).any()


def test_the_best_of_each_size_is_the_best_of_all() -> None:
    columns, response = problem(2)
    found = select(reduce_rows(NAMES, columns, response))
    for size in range(1, 7):
        errors = []
        for kept in combinations(range(6), size):
            x = columns[:, kept] / SCALE[list(kept)]
            residual = nnls(x - x.mean(axis=0), response - response.mean())[1]
            errors.append(residual / len(response) ** 0.5)
        assert found.rmse[found.best[size]] == pytest.approx(min(errors), rel=1e-10)
    assert (np.diff(found.rmse[found.best]) <= 1e-15).all()  # a larger set never does worse


def test_permuting_and_scaling_the_columns_changes_nothing_else() -> None:
    columns, response = problem(3)
    order, scale = np.array([3, 0, 5, 1, 4, 2]), 10.0 ** np.arange(-9, 9, 3)  # 1e15 between the columns
    found = select(reduce_rows(NAMES, columns, response))
    other = select(reduce_rows(tuple(NAMES[i] for i in order), columns[:, order] * scale, response * 7))
    for rule in RULES:
        names = found.names(found.choose(rule))
        assert set(other.names(other.choose(rule))) == set(names)
        ours, theirs = found.weights[found.mask(names)], other.weights[other.mask(names)]
        assert theirs * scale / 7 == pytest.approx(ours[order], rel=1e-9)


def test_blocks_and_merged_units_answer_like_whole_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sysid.reduction.MOST_UNITS", 8)
    columns, response = problem(4)
    cuts = [0, 1, 17, 600, 601, 2500, 3000]
    pieces = [(columns[a:b], response[a:b]) for a, b in pairwise(cuts)]
    streamed = reduce_blocks(NAMES, pieces, 64)
    assert len(streamed.rows) <= 16
    assert len(streamed) == 3000
    weights = np.arange(6) / SCALE
    expected = np.sqrt(np.mean((1.5 + columns @ weights - response) ** 2))
    assert streamed.rmse(1.5, weights) == pytest.approx(expected, rel=1e-12)
    ends = np.cumsum(streamed.rows)  # consecutive units: each answers for its own rows
    for part, first, last in zip(streamed.triangles, ends - streamed.rows, ends, strict=True):
        norm = np.linalg.norm(1.5 + columns[first:last] @ weights - response[first:last])
        assert np.linalg.norm(part @ [1.5, *weights, -1]) == pytest.approx(norm, rel=1e-10)


def test_rules_stop_where_they_say() -> None:
    columns, response = problem(5, noise=0.05)
    found = select(reduce_rows(NAMES, columns, response))
    errors = found.rmse[found.best]
    size = bin(found.choose("1 %")).count("1")
    assert all(errors[n + 1] <= 0.99 * errors[n] for n in range(size))
    assert errors[size + 1] > 0.99 * errors[size]
    n = 3000
    for rule in ("AICc", "BIC"):
        values = []
        for mask in range(64):
            p = 2 + np.count_nonzero(found.weights[mask])
            penalty = p * np.log(n) if rule == "BIC" else 2 * p + 2 * p * (p + 1) / (n - p - 1)
            values.append(n * np.log(found.rmse[mask] ** 2) + penalty)
        assert found.information(rule) == pytest.approx(np.array(values), rel=1e-12)
        assert found.choose(rule) == found.support(int(np.argmin(values)))


@pytest.mark.parametrize(("share", "terms"), [(0.25, ("a", "b")), (0.1, ("a",))])
def test_one_percent_is_one_percent(share: float, terms: tuple[str, ...]) -> None:
    basis = np.linalg.qr(np.random.default_rng(2).normal(size=(1000, 5)) - 0.0)[0] * 1000**0.5
    columns = basis[:, :3] - basis[:, :3].mean(axis=0)
    # b lowers the error from sqrt(1 + share^2) to 1: by 3 % and by half a percent
    found = select(reduce_rows(tuple("abc"), columns, columns @ [1, share, 0] + basis[:, 3]))
    assert found.names(found.choose("1 %")) == terms


def test_full_size_takes_less_than_the_stated_time() -> None:
    draw = np.random.default_rng(0)
    columns, response = draw.normal(size=(149_400, 9)), draw.normal(size=149_400)
    names = tuple("abcdefghi")
    select(reduce_rows(names, columns[:100], response[:100]))  # compiles
    taken = []
    for _ in range(5):
        started = time.perf_counter()
        select(reduce_rows(names, columns, response))
        taken.append(time.perf_counter() - started)
    assert min(taken) < 0.15  # s; 0.03 s on an idle core


def test_standard_errors_cover_the_truth_and_so_does_the_bootstrap() -> None:
    draw = np.random.default_rng(11)
    x = np.abs(draw.normal(size=(2000, 3)))
    clean = x @ [1.0, 2.0, 0.5] + 0.3
    plain = drawn = 0
    for _ in range(200):
        reduction = reduce_rows(tuple("abc"), x, clean + draw.normal(size=2000))
        found = select(reduction)
        errors, _ = standard_errors(reduction, found, 7)
        plain += abs(found.weights[7, 1] - 2) < 1.96 * errors[2]
    for seed in range(40):
        reduction = reduce_rows(tuple("abc"), x, clean + draw.normal(size=2000))
        got = estimate(reduction, select(reduction), 7, Bootstrap(resamples=100, seed=seed))
        drawn += got.low[2] <= 2 <= got.high[2]
    assert 181 <= plain <= 197  # the 99 % binomial band of 0.95 in 200
    assert drawn >= 33  # and of 0.95 in 40


def test_the_bootstrap_sees_correlation_that_standard_errors_do_not() -> None:
    draw = np.random.default_rng(3)
    slow = np.repeat(draw.normal(size=200), 50)  # a residual alike for 50 samples
    x = np.repeat(np.abs(draw.normal(size=(200, 1))), 50, axis=0)
    reduction = reduce_rows(("a",), x, 2 * x[:, 0] + slow, unit_rows=10)
    found = estimate(reduction, select(reduction), 1, Bootstrap(block_units=20))
    # sqrt(50) = 7 times, of which blocks of 200 samples see most and single units of 10 see sqrt(10) = 3.2
    assert (found.high[1] - found.low[1]) / 3.92 > 5 * found.standard_errors[1]
    assert ljung_box(2 * x[:, 0] + slow - 2 * x[:, 0]).p_value < 1e-6
    assert ljung_box(draw.normal(size=5000)).p_value > 0.001


def test_dropping_a_term_costs_what_the_raw_rows_say() -> None:
    columns, response = problem(6)
    found = select(reduce_rows(NAMES, columns, response))
    differences, percent = dropped(found, columns, response)
    kept = [0, 1, 2, 4, 5]
    full = np.linalg.norm(response - found.constants[63] - columns @ found.weights[63])
    without = np.linalg.norm(response - found.constants[63 - 8] - columns[:, kept] @ found.weights[63 - 8, kept])
    assert differences[-1, 3] == pytest.approx(without - full, rel=1e-9)
    assert percent[3] == pytest.approx(100 * (without / full - 1), rel=1e-9)
    assert differences[0].shape == (6,)


def test_extreme_cases_are_solved_or_refused() -> None:
    draw = np.random.default_rng(8)
    a, b, noise = draw.normal(size=(3, 2000))
    near = np.column_stack([a, a + 1e-12 * b, b])
    found = select(reduce_rows(tuple("abc"), near, 2 * a + b + noise))
    assert violation(near, 2 * a + b + noise, found) < 1e-8
    assert found.rmse[7] == pytest.approx(found.rmse[5], rel=1e-9)  # one of two that say the same
    zero = select(reduce_rows(tuple("abc"), near, np.zeros(2000)))
    assert not zero.weights.any()
    assert [zero.choose(rule) for rule in RULES] == [0, 0, 0]
    still = select(reduce_rows(("a",), np.full((50, 1), 3.0), noise[:50]))
    assert not still.weights.any()  # nothing but the constant
    with pytest.raises(BadInput, match="3 samples for 4 weights"):
        reduce_rows(tuple("abc"), near[:3], a[:3])
    with pytest.raises(BadInput, match="not finite"):
        reduce_rows(tuple("abc"), near * np.nan, a)
    with pytest.raises(BadInput, match="expected 1 to 16"):
        select(reduce_rows(tuple(map(str, range(17))), draw.normal(size=(90, 17)), a[:90]))
    with pytest.raises(BadInput, match="leave out one"):
        standard_errors(reduce_rows(tuple("abc"), near, a), found, 3)
    with pytest.raises(BadInput, match="did you mean 'a'"):
        zero.mask(("aa",))


def test_a_part_holds_its_own_rows() -> None:
    columns, response = problem(7)
    reduction = reduce_rows(NAMES, columns, response, unit_rows=100)
    part: Reduction = reduction.part(np.arange(30) < 10)
    alone = select(reduce_rows(NAMES, columns[:1000], response[:1000]))
    assert select(part).weights[63] * SCALE == pytest.approx(alone.weights[63] * SCALE, rel=1e-10)
    assert reduction.response_deviation == pytest.approx(response.std(), rel=1e-12)
