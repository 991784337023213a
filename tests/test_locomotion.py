"""The robot in its cannula and its stride, against the published numbers and by hand."""

import numpy as np
import pytest

from catheter.free import Infeasible, inflate, lock
from catheter.helix import design
from catheter.locomotion import Events, at_events, events, stroke
from catheter.robot import MAGIC, Extender, Rubber, contact, extender_sweep, layout, pressure, published
from catheter.task import DEGREE, Task
from catheter.tuning import Marks
from data.errors import BadInput, CatheterError

DEG = np.pi / 180
# The reference cycle (simulated): t, V1, V2, V3 (two decimals of t).
CYCLE = np.array(
    [
        [0.0, 1.000027, 1.002783, 1.092491],
        [0.03, 1.296938, 1.082758, 1.090385],
        [0.17, 1.319240, 1.375926, 1.136656],
        [1.00, 1.320527, 1.416862, 1.370979],
        [1.02, 1.085127, 1.372172, 1.369153],
        [1.16, 1.002534, 1.109440, 1.319045],
    ]
)
PUBLISHED = Events(rear_grips_s=0.03, front_touches_s=0.17, rear_lets_go_s=1.02, front_slips_s=1.16)


def test_stroke_at_the_published_times() -> None:
    long = stroke(at_events(CYCLE[:, 0], CYCLE[:, 2], PUBLISHED), Extender(length=0.3))
    assert 1e3 * long.stroke_m == pytest.approx(99.6, abs=0.06)
    assert 1e3 * long.pull_m == pytest.approx(89.5, abs=0.06)
    assert long.inferred == ""
    default = stroke(at_events(CYCLE[:, 0], CYCLE[:, 2], PUBLISHED))
    assert default.stroke_m == pytest.approx(long.stroke_m / 3, rel=1e-12)  # proportional to the length
    assert "inferred" in default.inferred


def test_events_are_the_crossings() -> None:
    time = np.linspace(0, 2, 20_001)
    wave = 1.2 + 0.15 * np.sin(np.pi * (time - 0.25))  # 1.05 to 1.35
    later = 1.2 + 0.15 * np.sin(np.pi * (time - 0.45))
    found = events(time, np.stack([wave, wave, later], axis=1), Marks(anchored=1.3, contact=1.12))

    def rises(level: float, lag: float) -> float:
        return lag + np.arcsin((level - 1.2) / 0.15) / np.pi

    assert found.rear_grips_s == pytest.approx(rises(1.3, 0.25), abs=1e-8)  # the line between samples: h^2 V'' / 8 V'
    assert found.front_touches_s == pytest.approx(rises(1.12, 0.45), abs=1e-8)
    assert found.rear_lets_go_s == pytest.approx(0.25 + 1 - (rises(1.12, 0.0)), abs=1e-8)
    assert found.front_slips_s == pytest.approx(0.45 + 1 - (rises(1.3, 0.0)), abs=1e-8)
    with pytest.raises(CatheterError, match=r"C: Act 3 never fills up to V = 1.4 \(it spans 1.0500 to 1.3500\)"):
        events(time, np.stack([wave, wave, later], axis=1), Marks(anchored=1.3, contact=1.4))


def test_bad_cycles_are_refused() -> None:
    time, volumes = CYCLE[:, 0], CYCLE[:, 1:]
    for bad_time, bad_volumes in ((time[::-1], volumes), (time, volumes[:, :2]), (time, volumes * np.nan)):
        with pytest.raises(BadInput):
            events(bad_time, bad_volumes)
    with pytest.raises(BadInput, match="lie from 0.03 to 5 s"):
        at_events(time, volumes[:, 1], Events(**vars(PUBLISHED) | {"front_slips_s": 5.0}))
    with pytest.raises(BadInput, match="lie from -1 to"):
        at_events(time, volumes[:, 1], Events(**vars(PUBLISHED) | {"rear_grips_s": -1.0}))
    with pytest.raises(Infeasible, match="they lock at"):
        stroke(at_events(time, volumes[:, 1], PUBLISHED), Extender(angle=71 * DEG))
    with pytest.raises(BadInput):
        at_events(time, volumes, PUBLISHED)
    with pytest.raises(BadInput, match="expected those at B, C, E and F"):
        stroke([1.1, 1.2])


def test_contact_is_where_the_tube_first_touches() -> None:
    task = Task()
    spiral = task.design(*published())
    found = contact(task, spiral)
    assert found.centre_line == pytest.approx(1.153, abs=6e-4)
    wide = Task(wall=0.0)
    assert contact(wide, spiral).wall == pytest.approx(1.049, abs=6e-4)  # of the inner wall
    assert found.wall < contact(wide, spiral).wall < found.centre_line
    at = design(*published(), volume_ratio=found.wall, radius=task.radius, length=task.length)
    outer = np.sqrt((5e-3 * at.radial) ** 2 + (5.8e-3**2 - 5e-3**2) / at.axial)
    assert at.radius_m + outer == pytest.approx(9.5e-3, rel=1e-6)
    assert np.isnan(contact(Task(diameter=0.2), spiral).wall)


def test_extenders_extend_and_longer_ones_buckle_sooner() -> None:
    task, angles = Task(), np.arange(56, 90, 2) * DEGREE
    found = extender_sweep(task, angles, length=0.1)
    assert [round(np.degrees(s.angle_rad)) for s in found] == list(
        range(72, 90, 2)
    )  # flatter ones lock before V = 1.30
    for s in found:
        pair = inflate(s.angle_rad, -s.angle_rad, 1.3)
        assert s.axial == pytest.approx(float(pair.axial), rel=1e-10)
        assert s.extension_m == pytest.approx(0.1 * (float(pair.axial) - 1), rel=1e-9)
        assert s.lock_volume_ratio > 1.3
    assert (np.diff([s.extension_m for s in found]) < 0).all()  # the flatter, the longer, up to the lock
    twice = extender_sweep(task, angles, length=0.2)
    assert [a.buckling_force_n / b.buckling_force_n for a, b in zip(found, twice, strict=True)] == pytest.approx(
        [4] * 9
    )
    eighty = next(s for s in found if round(np.degrees(s.angle_rad)) == 80)
    inner, outer = 5e-3 * 0.9878878, np.sqrt((5e-3 * 0.9878878) ** 2 + 8.64e-6 / 1.3320731)
    by_hand = np.pi**3 / 4 * 3 * 0.4e6 * (outer**4 - inner**4) / 0.13320731**2
    assert eighty.buckling_force_n == pytest.approx(by_hand, rel=1e-6)
    for angle in (MAGIC, 40 * DEG, 90 * DEG):
        with pytest.raises(BadInput, match="flatter fibres contract"):
            extender_sweep(task, [angle], length=0.1)


def test_pressure_is_the_work_of_the_wall_over_the_volume() -> None:
    tube = {"radius": 5e-3, "wall": 0.8e-3}
    for alpha, beta in ((80, -80), (72, -60), (50, 85), (30, -30)):
        a, b = alpha * DEG, beta * DEG
        most = min(1.35, lock(a, b).volume_ratio.item())
        volume = np.linspace(1.0, 1 + 0.95 * (most - 1), 4001)
        pair = inflate(a, b, volume)
        first = pair.axial**2 + pair.radial**2 * (1 + pair.twist**2) + 1 / (pair.axial * pair.radial) ** 2
        energy = 0.4e6 / 2 * (first - 3) * ((5.8e-3 / 5e-3) ** 2 - 1)  # per volume of the lumen at rest
        found = pressure(a, b, volume, **tube)
        assert found[0] == pytest.approx(0, abs=1e-6)
        assert (found[1:] > 0).all()
        assert np.trapezoid(found, volume) == pytest.approx(energy[-1], rel=1e-4)  # the rule's own error
        assert pressure(a, b, 1.02, **tube, rubber=Rubber(shear_modulus=0.8e6)) == pytest.approx(
            2 * pressure(a, b, 1.02, **tube), rel=1e-12
        )
    at_lock = lock(72 * DEG, -72 * DEG).volume_ratio.item()
    assert pressure(72 * DEG, -72 * DEG, at_lock, **tube) > 1e9
    with pytest.raises(Infeasible, match="beyond the lock"):
        pressure(72 * DEG, -72 * DEG, [1.1, 1.38], **tube)


def test_the_robot_is_spiral_extender_spiral() -> None:
    task = Task()
    rear, middle, front = layout(task, task.design(*published()), Extender())
    assert (rear.alpha, rear.beta, rear.gamma) == (front.alpha, front.beta, front.gamma) == published()
    assert (middle.alpha, middle.beta, middle.gamma) == (80 * DEGREE, -80 * DEGREE, None)
    assert (rear.length, middle.length, front.length) == (0.3, 0.1, 0.3)
    assert "inferred" in middle.note
