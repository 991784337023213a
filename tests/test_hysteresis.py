"""The operators obey their laws, and loops have the areas geometry gives them."""

import numpy as np
import pytest
from scipy.integrate import quad

from data.errors import BadInput
from sysid.hysteresis import loops, play, stop, turning_points

T = np.linspace(0, 6 * np.pi, 6001)
DRAW = np.random.default_rng(3)
WALK = np.cumsum(DRAW.normal(size=3000))


def test_play_is_what_its_recursion_says() -> None:
    radii, state, expected = [0.5, 2.0, 9.0], np.full(3, WALK[0]), []
    for x in WALK:
        state = np.clip(state, x - np.array(radii), x + np.array(radii))
        expected.append(state)
    assert play(WALK, radii).tolist() == np.array(expected).tolist()


def test_stop_never_leaves_its_limits_and_play_stays_within_its_radius() -> None:
    radii = np.array([0.1, 1.0, 5.0])
    assert (np.abs(stop(WALK, radii)) <= radii + 1e-13).all()  # rounding of x - p, |x| up to 100
    assert stop(WALK, radii) + play(WALK, radii) == pytest.approx(np.repeat(WALK[:, None], 3, axis=1), abs=1e-12)


def test_memory_depends_on_the_path_and_not_on_the_speed_along_it() -> None:
    slow = np.repeat(WALK, 3)  # the same path, walked with rests
    assert play(slow, [1.0])[::3].tolist() == play(WALK, [1.0]).tolist()


def test_play_is_odd_and_scales_with_its_input() -> None:
    assert play(-WALK, [1.0]).tolist() == (-play(WALK, [1.0])).tolist()
    assert play(4 * WALK, [4.0]).tolist() == (4 * play(WALK, [1.0])).tolist()


@pytest.mark.parametrize("radius", [0.1, 0.4, 0.9])
def test_the_loop_of_a_stop_has_the_area_of_its_parallelogram(radius: float) -> None:
    # x swings between -1 and 1; the spring slips over 2 (1 - r), so 4 r (1 - r) is lost a cycle.
    x = -np.cos(T)
    found = loops(x, stop(x, [radius])[:, 0])
    assert len(found) == 3
    for loop in found[1:]:
        assert loop.area == pytest.approx(4 * radius * (1 - radius), abs=1e-5)
        assert loop.area == pytest.approx(loop.stored - loop.returned, abs=1e-9)


def test_loop_areas_converge_with_second_order_to_the_ellipse() -> None:
    errors = []
    for n in (500, 1000, 2000):
        t = np.linspace(0, 2 * np.pi, n + 1)
        loop = loops(-np.cos(t), np.sin(t + 0.3))[0]  # y = sin(t + 0.3) over x = -cos t: area pi cos 0.3
        errors.append(abs(loop.area - np.pi * np.cos(0.3)))
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.02)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.02)


def test_stored_and_returned_energy_of_a_lossless_spring_are_equal() -> None:
    x = 1 - np.cos(T)
    for loop in loops(x, x**3):
        assert loop.area == pytest.approx(0, abs=1e-12)
        assert loop.stored == pytest.approx(quad(lambda v: v**3, 0, 2)[0], rel=1e-5)


def test_an_open_cycle_is_closed_by_its_chord() -> None:
    x = np.concatenate([np.linspace(0, 1, 11), np.linspace(0.9, 0.5, 5)])  # up and half way down a line: no loss
    loop = loops(x, x)[0]
    assert (loop.stored, loop.returned) == (pytest.approx(0.5), pytest.approx(0.375))
    assert loop.area == pytest.approx(0, abs=1e-15)


def test_turning_points_of_a_noisy_sine_are_the_sines() -> None:
    x = np.sin(T) + 0.02 * DRAW.normal(size=len(T))
    turns = turning_points(x, 0.5)[1:-1]
    assert np.abs(T[turns] - (np.pi / 2 + np.pi * np.arange(6))).max() < 0.25  # noise over curvature: 2 sqrt(0.03)
    assert len(turns) == 6


def test_constant_short_and_bad_inputs() -> None:
    assert loops(np.ones(5), np.ones(5)) == []
    assert loops(np.empty(0), np.empty(0)) == []
    assert turning_points(np.array([1.0]), 0.1).tolist() == [0]
    assert turning_points(np.arange(5.0), 0.1).tolist() == [0, 4]
    with pytest.raises(BadInput, match="radii must be positive"):
        play(WALK, [0.0])
    with pytest.raises(BadInput, match="sample 1 is not finite"):
        play(np.array([0.0, np.nan]), [1.0])
    with pytest.raises(BadInput, match="expected two"):
        loops(np.ones(3), np.ones(4))
