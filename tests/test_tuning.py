"""Events and objective as published and recomputed; slopes against differences; the map against tight solves."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from catheter.hydraulics import Circuit, Solver, SquareWave, thesis_circuit
from catheter.optimum import Search, optimum, stiffened
from catheter.sweep import Scatter, Variations, built, coefficient_map, grid_coefficients, sweep
from catheter.tuning import Marks, Score, evaluate, slope
from data.errors import BadInput, DidNotConverge

TIGHT = Solver(tolerance=1e-12)
SOURCE = SquareWave()


def coefficients(circuit: Circuit) -> np.ndarray:
    return np.array([segment.valve.coefficient for segment in circuit.segments])


@pytest.fixture(scope="module")
def whole() -> Score:
    return coefficient_map(thesis_circuit(), SOURCE, Marks())


def test_events_and_objective_are_the_reproduced_ones() -> None:
    score = evaluate(thesis_circuit(0.01), SOURCE, Marks())
    assert score.events_s[0] == pytest.approx([0.03140, 0.15486, 1.01400, 1.20574], abs=1e-5)
    assert (score.forward[0], score.reverse[0]) == pytest.approx((0.27357, 0.31471), abs=1e-5)
    assert score.objective[0] == pytest.approx(0.17219, abs=1e-5)
    a, b = score.forward[0], score.reverse[0]
    assert a**2 + b**2 - (a - b) ** 2 == pytest.approx(score.objective[0], rel=1e-14)  # thesis eq. 3.24
    assert np.abs(score.events_s[0] - [0.03, 0.17, 1.02, 1.16]).tolist() <= [0.005, 0.02, 0.007, 0.05]
    early = evaluate(thesis_circuit(0.01), SOURCE, Marks(contact=1.12))
    assert early.events_s[0, 1:3] == pytest.approx([0.1312, 1.0152], abs=5e-5)


@pytest.mark.parametrize("objective", ["product", "equal"])
def test_the_slope_is_the_central_difference(objective: str) -> None:
    circuit, marks = thesis_circuit().with_coefficients(1.64e-6, 2.6e-7, 5.2e-8), Marks(objective=objective)
    found = slope(circuit, SOURCE, marks, TIGHT)

    def at(coefficient: float = 0.0, stiffness: float = 0.0, period: float = 0.0, k: int = 0) -> float:
        one = np.eye(3)[k]
        moved = stiffened(
            circuit.with_coefficients(*coefficients(circuit) * (1 + coefficient * one)), 1 + stiffness * one
        )
        return float(evaluate(moved, replace(SOURCE, period=2 * (1 + period)), marks, TIGHT).objective[0])

    def difference(**by: float) -> float:  # fourth order; 1e-12 of noise over 1e-3 is 1e-9
        name, h = next(iter(by)), 1e-3
        steps = {s: at(**{name: s * h}, k=int(by[name])) for s in (-2, -1, 1, 2)}
        return (8 * (steps[1] - steps[-1]) - (steps[2] - steps[-2])) / (12 * h)

    for k in range(3):
        assert difference(coefficient=k) == pytest.approx(found.coefficient[k] * coefficients(circuit)[k], rel=1e-6)
        assert difference(stiffness=k) == pytest.approx(found.stiffness[k], rel=1e-6, abs=1e-8)
    assert difference(period=0) == pytest.approx(found.period * 2, rel=1e-6)


def test_the_map_has_the_reproduced_summit(whole: Score) -> None:
    objective = whole.objective.reshape(118, 118)
    assert np.unravel_index(objective.argmax(), objective.shape) == (26 - 1, 3 - 1)
    assert objective.max() == pytest.approx(0.1760, abs=5e-5)
    assert objective[22 - 1, 3 - 1] == pytest.approx(0.1707, abs=5e-5)
    assert whole.cycles.max() <= 12
    contact = coefficient_map(thesis_circuit(), SOURCE, Marks(contact=1.12)).objective.reshape(118, 118)
    assert np.unravel_index(contact.argmax(), contact.shape) == (26 - 1, 4 - 1)


def test_cells_are_those_of_a_tight_solve_each_by_itself(whole: Score) -> None:
    grid, chosen = grid_coefficients(), np.random.default_rng(5).choice(118 * 118, 40, replace=False)
    chosen[:4] = 7 * 118 + 63, 7 * 118 + 64, 0, 25 * 118 + 2
    for cell in chosen:
        circuit = thesis_circuit().with_coefficients(1.64e-6, grid[cell // 118], grid[cell % 118])
        alone = evaluate(circuit, SOURCE, Marks(), Solver(tolerance=1e-10))
        assert whole.objective[cell] == pytest.approx(alone.objective[0], abs=2e-5)
        assert whole.events_s[cell] == pytest.approx(alone.events_s[0], abs=2e-4, nan_ok=True)


def test_the_optimum_is_flat_and_where_it_was_found_before() -> None:
    best = optimum(thesis_circuit(), SOURCE, Marks())
    assert coefficients(best.circuit)[1:] == pytest.approx([3.59e-7, 4.55e-8], rel=3e-3)  # printed with 3 digits
    flat = slope(best.circuit, SOURCE, Marks())
    assert np.abs(flat.coefficient * coefficients(best.circuit))[1:].max() < 1e-4 * best.objective
    published = evaluate(thesis_circuit(), SOURCE, Marks()).objective[0]
    assert published / best.objective == pytest.approx(0.966, abs=2e-3)
    equal = optimum(best.circuit, SOURCE, Marks(objective="equal"))
    assert coefficients(equal.circuit)[1:] == pytest.approx([3.13e-7, 5.56e-8], rel=3e-3)


def test_period_and_stiffness_are_searched_too() -> None:
    faster = optimum(thesis_circuit(), SOURCE, Marks(), Search(free=("K2", "K3", "T"), per_second=True, range=4))
    assert faster.source.period < 2
    rate = np.sqrt(faster.objective) / faster.source.period
    assert rate > np.sqrt(optimum(thesis_circuit(), SOURCE, Marks()).objective) / 2
    for factor in (0.98, 1.02):
        other = replace(faster.source, period=faster.source.period * factor)
        assert np.sqrt(evaluate(faster.circuit, other, Marks()).objective[0]) / other.period < rate
    softer = optimum(thesis_circuit(), SOURCE, Marks(), Search(free=("K2", "K3", "S1", "S2", "S3"), range=1.2))
    assert softer.objective > 0.2
    assert "S2" in softer.at_bound


def test_scatter_and_executors_give_the_same_robots() -> None:
    scatter = Scatter(samples=50)
    alone = built(thesis_circuit(), SOURCE, Marks(), scatter)
    with ThreadPoolExecutor(1) as pool:
        pooled = built(thesis_circuit(), SOURCE, Marks(), scatter, executor=pool)
    assert np.array_equal(alone.objective, pooled.objective)
    exact = built(thesis_circuit(), SOURCE, Marks(), Scatter(coefficient=0, stiffness=0, volume=0, samples=3))
    assert exact.objective == pytest.approx(evaluate(thesis_circuit(), SOURCE, Marks()).objective[0], abs=2e-5)


def test_a_missing_event_scores_nothing() -> None:
    score = evaluate(thesis_circuit().with_coefficients(1.64e-6, 3e-7, 1e-10), SOURCE, Marks())
    assert np.isnan(score.events_s[0, 1])
    assert (score.forward[0], score.objective[0]) == (0.0, 0.0)


def test_what_cannot_be_is_refused() -> None:
    two = Circuit(segments=thesis_circuit().segments[:2])
    with pytest.raises(BadInput, match="has 2 segments"):
        evaluate(two, SOURCE, Marks())
    with pytest.raises(BadInput, match="at least one"):
        sweep(thesis_circuit(), SOURCE, Marks(), Variations())
    with pytest.raises(BadInput, match="stiffness"):
        sweep(thesis_circuit(), SOURCE, Marks(), Variations(stiffness=-np.ones((2, 3))))
    with pytest.raises(DidNotConverge, match="variant 0 of 2: no periodic state after 1 cycles"):
        sweep(thesis_circuit(), SOURCE, Marks(), Variations(stiffness=np.ones((2, 3))), solver=Solver(most_steps=5))
    with pytest.raises(BadInput, match="'K9' is unknown; .*K1"):
        optimum(thesis_circuit(), SOURCE, Marks(), Search(free=("K9",)))
    with pytest.raises(BadInput, match="no stroke at the start"):
        optimum(thesis_circuit().with_coefficients(1.64e-6, 3e-7, 1e-10), SOURCE, Marks())
    with pytest.raises(BadInput, match="a valve is closed"):
        slope(thesis_circuit().with_coefficients(1.64e-6, 3e-7, 0.0), SOURCE, Marks())
