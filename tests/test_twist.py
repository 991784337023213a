"""Twist against time: turns counted, gaps kept as gaps, smoothing that is the batch least-squares answer."""

import math
from dataclasses import replace

import numpy as np
import pytest

from data.errors import BadInput
from vision.frames import Frame
from vision.marker import find
from vision.pattern import SQUARES
from vision.render import Shot, render
from vision.twist import MISSING, SMOOTHED, Row, Tracker, Twist, assemble, region_px, rows, smooth

SHOT = Shot(width_px=240, height_px=200, middle_px=(120.3, 99.6), pitch_px=60.0, noise_grey=2.0)


def film(angles: np.ndarray) -> list[Frame]:
    return [Frame(k, k / 30, render(replace(SHOT, angle_rad=angle), k)) for k, angle in enumerate(angles)]


def made(angle: np.ndarray, sigma: float = 0.01) -> Twist:
    return assemble([Row(k, k / 30, float(a), math.nan if np.isnan(a) else sigma) for k, a in enumerate(angle)])


def test_a_marker_is_followed_and_its_turns_are_counted() -> None:
    angles = np.concatenate([np.linspace(0.5, 8.0, 60), np.linspace(8.0, -1.0, 60)])
    found = list(rows(film(angles), Tracker()))
    assert sum(row.followed for row in found) >= 117
    twist = assemble(found)
    assert np.abs(twist.angle_rad - (angles - 0.5)).max() < 6 * twist.sigma_rad.max()  # two errors in each
    assert twist.doubtful == ()
    for row in found[5::40]:  # followed or searched for, the answer is the same least-squares minimum
        assert row.fit is not None
        picture = render(replace(SHOT, angle_rad=angles[row.number]), row.number)
        assert abs(find(picture, SQUARES).angle_rad - row.angle_rad) < 0.05 * row.sigma_rad
        x, y, width, height = region_px(row.fit)
        inside = (row.fit.blobs_px > (x, y)) & (row.fit.blobs_px < (x + width, y + height))
        assert inside.all()


def test_a_frame_without_a_marker_is_missing_and_the_marker_is_found_again() -> None:
    frames = film(np.linspace(0, 1, 12))
    frames[4] = Frame(4, 4 / 30, np.full((200, 240), 220, np.uint8))
    frames[5] = Frame(5, 5 / 30, None, "is a JPEG that was cut off")
    frames[6] = Frame(6, 6 / 30, render(replace(SHOT, cut=(0, 0.3, 0.15)), 6))
    twist = assemble(found := list(rows(frames, Tracker())))
    assert [k for k, status in enumerate(twist.status) if status == MISSING] == [4, 5, 6]
    assert np.isnan(twist.angle_rad[4:7]).all()
    assert np.isnan(twist.sigma_rad[4:7]).all()
    assert found[5].reason == "is a JPEG that was cut off"
    assert all(row.reason for row in found[4:7])
    assert twist.angle_rad[7:] == pytest.approx(np.linspace(0, 1, 12)[7:], abs=1e-3)


def test_the_reference_frame() -> None:
    angle = np.array([np.nan, 0.3, 0.5, np.nan, 0.9])
    assert made(angle).angle_rad[2] == pytest.approx(0.2)
    found = [Row(k, k / 30, float(a), 0.01) for k, a in enumerate(angle)]
    assert assemble(found, 4).angle_rad[1] == pytest.approx(-0.6)
    for number in (3, 77):
        with pytest.raises(BadInput, match="no marker"):
            assemble(found, number)
    empty = made(np.full(3, np.nan))
    assert empty.status == (MISSING,) * 3
    assert assemble([]).status == ()


def test_turns_that_may_have_been_missed_are_said() -> None:
    fast = np.cumsum(np.concatenate([np.full(10, 0.1), [2.0], np.full(10, 0.1)]))
    assert made(fast).doubtful == (10,)
    gap = 0.3 * np.arange(30.0)
    gap[12:17] = np.nan
    assert made(gap).doubtful == (17,)


def test_smoothing_is_the_batch_least_squares_answer() -> None:
    draw = np.random.default_rng(1)
    angle = np.sin(np.arange(30) / 8) + draw.normal(0, 0.01, 30)
    angle[[11, 12, 20]] = np.nan
    twist, power = made(angle), 4.0
    found = smooth(twist, power)
    step, angles, rates = 1 / 30, np.eye(2, 31)[0], np.eye(2, 31)[1]
    lines = [angles]  # of the first state and the 29 accelerations
    for k in range(29):
        push = np.eye(31)[2 + k]
        angles, rates = angles + step * rates + step**2 / 2 * push, rates + step * push
        lines.append(angles)
    known, lines = ~np.isnan(angle), np.array(lines)
    columns = np.concatenate([100 * lines[known], np.eye(31)[2:] / power])
    answers = np.concatenate([100 * twist.angle_rad[known], np.zeros(29)])
    batch = lines @ np.linalg.lstsq(columns, answers, rcond=None)[0]
    deviation = np.sqrt(np.diag(lines @ np.linalg.inv(columns.T @ columns) @ lines.T))
    # the filter begins with a wide belief, not with none: 1e4 sigma, 100 times the acceleration
    assert found.angle_rad == pytest.approx(batch, abs=1e-5)
    assert found.sigma_rad == pytest.approx(deviation, rel=1e-3)
    assert [k for k, status in enumerate(found.status) if status == SMOOTHED] == [11, 12, 20]
    assert found.sigma_rad[11] > 1.2 * found.sigma_rad[9]


def test_smoothing_fills_no_end_and_refuses_nonsense() -> None:
    angle = np.array([np.nan, 0.1, 0.2, np.nan, 0.4, np.nan])
    found = smooth(made(angle), 10.0)
    assert np.isnan(found.angle_rad).tolist() == [True, False, False, False, False, True]
    with pytest.raises(BadInput, match="acceleration"):
        smooth(made(angle), 0.0)
