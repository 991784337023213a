"""The whole robot: its gait obeys the kinematics and its own rule, its posture fits the cannula."""

from dataclasses import replace

import numpy as np
import pytest

from catheter.drive import SquareWave
from catheter.end_effector import End, Line, answer
from catheter.free import extension, inflate
from catheter.gait import Gait, Walk, advanced, phases, walk
from catheter.inflatable import Path, Pattern, Shape, inflated
from catheter.lab.scene import Scene
from catheter.posture import arc, spiral, swept
from catheter.robot import Extender, layout, published
from catheter.task import Task
from data.errors import BadInput

TABLES = Scene.load("robot").tables
NOTHING = 1e-7  # m: places at events come from samples of the cycle, good to 10 nm
TASK, CIRCUIT = Task(), TABLES["circuit"]


@pytest.fixture(scope="module")
def gait() -> Gait:
    return walk(CIRCUIT, TABLES["source"], TABLES["marks"], TABLES["extender"], Walk(cycles=3))


def test_the_extender_is_as_long_as_its_fibres_make_it(gait: Gait) -> None:
    length = 0.1 * extension(TABLES["extender"].angle, gait.volume[:, 1])
    assert gait.front_m - gait.rear_m == pytest.approx(length, abs=1e-15)


def test_each_cycle_gains_the_stroke_and_only_the_push_moves_the_front(gait: Gait) -> None:
    starts = np.flatnonzero(gait.within_s == 0)
    expected = 92.8e-3 / 3  # an independent calculation, of an extender of 300 mm
    assert np.diff(gait.front_m[starts]) == pytest.approx(expected, abs=1e-4)
    assert np.diff(gait.rear_m[starts]) == pytest.approx(gait.advance_m, abs=1e-9)
    moved = np.diff(gait.front_m) > NOTHING
    pushes = phases(gait, np.array(list(vars(gait.happened).values())))[:-1] == 1
    assert (moved == pushes).all()
    alone = gait.holds[:-1, 0] & ~gait.holds[:-1, 1]
    assert np.diff(gait.rear_m)[alone] == pytest.approx(0, abs=NOTHING)
    assert advanced(gait, np.array([0.03, 0.17]), 0.028)[-1] == pytest.approx(3 * 0.028)


def test_where_the_pull_is_smaller_the_rear_moves_only_by_it() -> None:
    open_front = CIRCUIT.with_coefficients(1.64e-6, 3.05e-7, 8e-8)  # the front lets go early
    found = walk(open_front, TABLES["source"], TABLES["marks"], Extender(), Walk(cycles=2))
    assert found.made.pull_m < found.made.stroke_m
    moved = np.diff(found.rear_m) > NOTHING
    pulls = phases(found, np.array(list(vars(found.happened).values())))[:-1] == -1
    assert (moved == pulls).all()
    starts = np.flatnonzero(found.within_s == 0)
    assert np.diff(found.front_m[starts]) == pytest.approx(found.made.pull_m, abs=1e-9)


def test_a_cycle_whose_events_come_in_another_order_is_refused() -> None:
    wide = CIRCUIT.with_coefficients(1.64e-7, 3e-6, 3e-6)  # the front fills as fast as the rear
    with pytest.raises(BadInput, match=r"B, C, E, F in turn \(thesis Fig 3.3\); tune the valves"):
        walk(wide, SquareWave(), TABLES["marks"], Extender())


SPIRAL = layout(TASK, TASK.design(*published()), Extender())[0]


@pytest.mark.parametrize("volume", [0.99, 1.0, 1.003, 1.13, 1.30, 1.37])
def test_a_drawn_spiral_stays_in_the_cannula_and_as_long_as_its_fibres_say(volume: float) -> None:
    found = spiral(TASK, SPIRAL, volume)
    assert np.hypot(*found.line[:, 1:].T).max() + found.outer_m <= TASK.diameter / 2 + 1e-12
    assert np.linalg.norm(found.limiter - found.line, axis=1) == pytest.approx(found.outer_m)
    assert found.line[[0, -1], 1:] == pytest.approx(0, abs=1e-12)
    if volume > 1:
        known = TASK.helix(inflate(SPIRAL.alpha, SPIRAL.beta, volume), np.asarray(SPIRAL.gamma))
        assert found.reach_m == pytest.approx(float(known.length_ratio) * SPIRAL.length)
        assert found.free_m == pytest.approx(float(known.radius_m))


def test_in_a_wide_cannula_the_spiral_is_the_free_helix() -> None:
    wide = replace(TASK, diameter=60e-3)
    found = spiral(wide, SPIRAL, 1.30, points=40_001)
    assert found.drawn_m == found.free_m
    middle = found.line[14_000:26_000]  # beyond the ends, which are led to the axis
    length = np.linalg.norm(np.diff(middle, axis=0), axis=1).sum()
    l1 = float(inflate(SPIRAL.alpha, SPIRAL.beta, 1.30).axial)
    assert length == pytest.approx(l1 * SPIRAL.length * (len(middle) - 1) / 40_000, rel=1e-6)  # no arc is lost


def test_arcs_and_tubes() -> None:
    line = arc(32e-3, 0.4, 2001)
    assert np.linalg.norm(np.diff(line, axis=0), axis=1).sum() == pytest.approx(32e-3, rel=1e-6)
    end = line[-1] - line[-2]
    assert np.arctan2(end[1], end[0]) == pytest.approx(0.4, abs=2e-4)
    turn = 0.7 * np.linspace(0, 1, 2001)
    tube = swept(line, 5e-3, sides=4, turn=turn)
    out = tube - line
    assert np.linalg.norm(out, axis=-1) == pytest.approx(5e-3)
    side = np.cross(end / np.linalg.norm(end), [0, 0, 1.0])
    angle = np.arctan2(out[0, -1, 2], -out[0, -1] @ side)
    assert angle == pytest.approx(0.7, abs=1e-3)  # of the last ring about the line, from the first one's side
    assert arc(1.0, 0.0)[-1] == pytest.approx([1, 0, 0])


def test_the_twister_turns_as_its_inflation_says() -> None:
    shape, helix = Shape(divisions=(16, 16, 1), voxels=(16, 16)), Pattern(pattern="helix", period=8, width=2)
    line, time_s = Line(most=40e3, start=1.0, period=2.0), np.linspace(0, 3, 13)
    assert line.at(np.array([0.0, 1.0, 2.0, 3.0])) == pytest.approx([0, 0, 40e3, 0], abs=1e-9)
    found = answer(End(shape=shape, pattern=helix, line=line, what="twist"), time_s)
    exact = inflated(shape, helix, Path(pressures=(20e3, 40e3)))
    assert found.angle_rad[[6, 8]] == pytest.approx(exact.twist, abs=3e-3)
    assert found.length_m[8] == pytest.approx(shape.length + exact.extension[-1], abs=1e-6)
    with pytest.raises(BadInput, match="begin earlier"):
        answer(End(shape=shape, pattern=helix, line=replace(line, start=9.0), what="twist"), time_s)
