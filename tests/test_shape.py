"""Walls keep their volume exactly, folds are refused, and targets lie on fem's own lattice."""

import re
import time
from dataclasses import replace

import numpy as np
import pytest

from catheter.centreline import Source, load, straight
from catheter.equal_volume import distance, moment, smallest_bend
from catheter.lab.scene import Scene, names
from catheter.lab.shape_study import difference_gradient, linear_wall_error
from catheter.lab.shape_view import shaped, volume_error
from catheter.motions import Actuator, Balloon, Bend, Motions, Spiral, Twist, build, coarse_wall
from catheter.occlusion import occlusion
from catheter.target import query, stretches, target
from data.errors import BadInput
from fem.tube_grid import tube_lattice

SHAPES = [name for name in names() if Scene.load(name).heading.kind == "shape"]
THICK = Actuator(inner_radius=0.7e-3, initial="straight")
MIX = Motions(
    spiral=Spiral(turns=1.5, share=0.3),
    bend=Bend(angle=0.5, sway=2e-3, direction=0.7),
    twist=Twist(angle=2.0, wave=0.1, waves=3),
    balloon=Balloon(grow=1.1, lobe=0.1, lobes=3),
)


@pytest.fixture(scope="module")
def renal():
    return load(Source(length=20.63e-3))


def test_the_cubic_is_solved_to_rounding_over_its_whole_range() -> None:
    draw = np.random.default_rng(0)
    s = draw.uniform(0.5, 2, 4000)
    h = draw.uniform(0.01, 3, 4000)
    b = (
        s
        / h
        * np.concatenate(
            [draw.uniform(-40, 0.999, 3000), draw.choice([-1, 1], 1000) * 10 ** draw.uniform(-17, -1, 1000)]
        )
    )
    # near the fold the volume no longer depends on h: half the digits of the last thousandth are lost
    assert np.abs(distance(moment(h, s, b), s, b) / h - 1).max() < 1e-12 / (1 - 0.999)
    assert distance(h**2 / 2, np.ones(4000), 0 * h) == pytest.approx(h, rel=1e-15)
    assert np.isnan(distance(np.array(1 / 6 + 1e-9), np.array(1.0), np.array(1.0)))


@pytest.mark.parametrize("name", SHAPES)
def test_det_f_is_one_at_a_hundred_thousand_places_of_every_shipped_shape(name) -> None:
    shape = shaped(name).shape
    started = time.process_time()  # work: other tests run at the same time
    errors = [np.abs(volume_error(shape, q)).max() for q in (0.25, 0.5, 0.75, 1.0)]
    assert max(errors) < 1e-10
    assert time.process_time() - started < 4.0  # 1 s when nothing else runs


def test_any_mix_keeps_its_volume_and_a_line_across_the_wall_does_not(renal) -> None:
    mixed = build(renal, THICK, MIX)
    assert np.abs(volume_error(mixed, 0.6, (40, 40, 5))).max() < 1e-12
    found = replace(shaped("twisting"), shape=mixed)
    assert np.abs(linear_wall_error(found, 1.0)).max() > 1e-3
    exact, difference = difference_gradient(found, 0.8)
    assert np.abs(exact - difference).max() < 1e-6  # steps of 1e-5: their square, times derivatives of order 100


def test_where_shear_varies_through_the_wall_det_f_is_told_and_not_claimed(renal) -> None:
    shape = build(renal, Actuator(inner_radius=0.5e-3), Motions(balloon=Balloon(lobe=0.2), twist=Twist(through=0.3)))
    found = replace(shaped("twisting"), shape=shape)
    exact, difference = difference_gradient(found, 1.0)
    assert np.abs(exact - 1).max() > 1e-2
    assert np.abs(exact - difference).max() < 1e-6


def test_the_whole_gradient_is_that_of_the_positions(renal) -> None:
    shape = build(renal, THICK, MIX)
    u, v, w = np.array([0.8e-3]), np.array([0.4, 3.0]), 20.63e-3 * np.array([0.2, 0.71])

    def differences(q: float) -> np.ndarray:
        steps = (1e-8, 1e-4, 1e-7)
        columns = []
        for k, step in enumerate(steps):
            du, dv, dw = step * np.eye(3)[k]
            after, before = (shape.wall(q, u + x * du, v + x * dv, w + x * dw).positions for x in (1, -1))
            columns.append((after - before) / (2 * step))
        return np.stack(columns, axis=-1)

    F = differences(1.0) @ np.linalg.inv(differences(0.0))
    strain = (np.swapaxes(F, -1, -2) @ F - np.eye(3)) / 2
    found = shape.wall(1.0, u, v, w)
    assert np.linalg.eigvalsh(strain) == pytest.approx(np.linalg.eigvalsh(found.strain), abs=1e-6)


def test_a_straight_tube_bends_to_an_arc_and_balloons_as_the_exact_ring() -> None:
    vessel = straight(0.03, 5e-3)
    actuator = Actuator(inner_radius=1e-3, outer_radius=1.5e-3)
    arc = build(vessel, actuator, Motions(bend=Bend(angle=np.pi / 2))).final(np.array([0.03]), 1)
    radius = 0.03 / (np.pi / 2)
    assert arc[0, 0] == pytest.approx([radius, 0, radius], abs=1e-15)
    assert arc[1, 0] == pytest.approx([1, 0, 0], abs=1e-14)
    ring = build(vessel, actuator, Motions(balloon=Balloon(grow=2.0))).wall(
        1.0, np.array([1.5e-3]), np.zeros(1), np.linspace(0, 0.03, 5)
    )
    assert ring.h == pytest.approx(np.sqrt(4 + 1.5**2 - 1) * 1e-3, rel=1e-14)


def test_folds_are_refused_with_the_smallest_radius_that_is_allowed() -> None:
    vessel, short = straight(0.03, 5e-3), straight(0.008, 5e-3)
    actuator = Actuator(inner_radius=2e-3, outer_radius=3e-3)
    with pytest.raises(BadInput, match=r"q = 1, v = 0 deg, w = .* the shape folds: its bend radius is 3 mm") as refused:
        build(short, actuator, Motions(bend=Bend(angle=0.008 / 3e-3)))
    found = re.search(r"smallest allowed is ([\d.]+) mm", str(refused.value))
    assert found is not None
    allowed = float(found[1]) * 1e-3
    assert allowed == pytest.approx(smallest_bend(np.array(2e-3), np.array(2.5e-6)), rel=1e-3)
    wall = coarse_wall(build(short, actuator, Motions(bend=Bend(angle=0.008 / (1.001 * allowed)))), 1.0)
    assert wall.h.max() == pytest.approx(allowed, rel=0.05)  # the outer wall all but reaches the centre of the bend
    with pytest.raises(BadInput, match="the shape folds"):
        build(short, actuator, Motions(bend=Bend(angle=0.008 / (0.999 * allowed))))
    thin = replace(actuator, inner_radius=0.5e-3, outer_radius=0.8e-3)
    build(vessel, thin, Motions(bend=Bend(angle=0.8 * 2 * np.pi)))
    with pytest.raises(BadInput, match=r"passes through itself at w = [\d.]+ and [\d.]+ mm"):
        build(vessel, thin, Motions(bend=Bend(angle=1.2 * 2 * np.pi)))
    with pytest.raises(BadInput, match="the shear turns faster"):
        build(vessel, actuator, Motions(twist=Twist(wave=0.6, waves=2)))
    with pytest.raises(BadInput, match="the bore has no width"):
        build(vessel, actuator, Motions(balloon=Balloon(bulge=-1.1)))
    with pytest.raises(BadInput, match="leaves no bore"):
        build(vessel, actuator, Motions(balloon=Balloon(fit=0.3)))


def test_a_balloon_fits_its_vessel_and_a_straight_rod_fills_what_it_must(renal) -> None:
    full = occlusion(build(renal, Actuator(), Motions(balloon=Balloon(fit=1.0))), renal, 1.0)
    assert full.share == pytest.approx(1, abs=1e-3)  # outlines of 240 sides
    assert full.contact == pytest.approx(2 * np.pi)
    assert np.abs(full.beyond).max() < 1e-6
    vessel = straight(0.03, 5e-3)
    rod = build(vessel, Actuator(inner_radius=1e-3, outer_radius=2e-3), Motions(bend=Bend(sway=4e-3)))
    aside = occlusion(rod, vessel, 1.0)
    assert aside.share[0] == pytest.approx(0.16, rel=1e-2)
    assert aside.beyond[-1] == pytest.approx(1e-3, rel=0.05)
    # a circle of radius 2 at 4 from the middle of one of radius 5 reaches past 97 % of it within this arc
    reach = 4.85
    arc = 2 * np.arccos((4**2 + reach**2 - 2**2) / (2 * 4 * reach))
    assert aside.contact[-1] == pytest.approx(arc, abs=np.radians(1.5))  # sectors of a degree


@pytest.mark.parametrize(("nodes", "order"), [("8", 1), ("20", 2)])
def test_targets_lie_on_fem_s_lattice_node_for_node(nodes, order) -> None:
    actuator = Actuator(inner_radius=4e-3, outer_radius=5e-3, initial="straight", nodes=nodes, divisions=(16, 8, 2))
    shape = build(straight(0.032, 8e-3), actuator, Motions(twist=Twist(angle=1.0)))
    made = target(shape, actuator, 1.0)
    tube = tube_lattice(0.032, 5e-3, 1e-3, (16, 8, 2), order)
    assert np.abs(made.undeformed.nodes - tube.nodes).max() < 1e-17
    assert np.array_equal(made.undeformed.hexes, tube.hexes)
    turn = made.undeformed.nodes[:, 2] / 0.032
    x, y, z = made.undeformed.nodes.T
    turned = np.stack([x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn), z], axis=1)
    assert np.abs(made.deformed - turned).max() < 1e-16
    assert made.base < 1e-17


def test_a_voxel_of_a_twisted_tube_has_the_strain_of_simple_shear() -> None:
    actuator = Actuator(inner_radius=4e-3, outer_radius=5e-3, initial="straight")
    shape = build(straight(0.032, 8e-3), actuator, Motions(twist=Twist(angle=1.0)))
    asked = query(shape, actuator, (3, 5), 1.0)
    slope = 4.5e-3 / 0.032
    assert asked.gradient == pytest.approx(np.array([[1, 0, 0], [0, 1, slope], [0, 0, 1]]), abs=1e-12)
    assert asked.strain[2] == pytest.approx([0, slope / 2, slope**2 / 2], abs=1e-12)
    assert np.linalg.norm(asked.rest[0, 0, 0] - asked.rest[0, 0, 1]) == pytest.approx(1e-3)
    largest = 5e-3 / 0.032 / 2 + np.hypot(1, 5e-3 / 0.032 / 2)
    assert stretches(shape, actuator, 1.0) == pytest.approx(largest, rel=1e-12)
    with pytest.raises(BadInput, match="is not there"):
        query(shape, actuator, (32, 0), 1.0)
