"""Frames along curves with known answers, and the refusals of those that have none."""

import numpy as np
import pytest

from catheter.curve import Along
from catheter.frames import double_reflection, frenet, parallel_transport, rotation_minimising, total_twist
from catheter.lab.shape_study import CIRCLE, CURVES, HELIX, SWERVE
from data.errors import BadInput

HELIX_LENGTH = CURVES["helix"][1]


@pytest.mark.parametrize(("way", "order"), [(parallel_transport, 2), (double_reflection, 4)])
def test_orders_of_convergence_against_the_exact_frame_of_a_helix(way, order) -> None:
    counts, errors = np.array([32, 64, 128, 256]), []
    for count in counts:
        w = np.linspace(0, HELIX_LENGTH, count + 1)
        exact = HELIX.minimising(w)
        errors.append(np.linalg.norm(way(HELIX, w, exact[0]).normal - exact, axis=1).max())
    slope = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert slope == pytest.approx(order, abs=0.1)  # the next term shows at 32 stations over 3 turns


@pytest.mark.parametrize(("curve", "length"), CURVES.values(), ids=CURVES)
def test_the_default_frame_is_exact_and_its_derivatives_are_its_own(curve, length) -> None:
    w = np.linspace(0, length, 50)
    exact = curve.minimising(w)
    found = rotation_minimising(curve, w, exact[0])
    assert np.abs(found.normal - exact).max() < 1e-9  # 1,024 steps of fourth order
    assert np.abs((found.normal * found.tangent).sum(axis=1)).max() < 1e-14
    step = 1e-6 * length  # its square, and rounding over it: 1e-10 of a slope of 1/length
    near = [rotation_minimising(curve, w[1:-1] + d, exact[0]).normal for d in (step, -step)]
    along = Along(curve(w[1:-1], 3), found.normal[1:-1])
    assert np.abs((near[0] - near[1]) / (2 * step) - along.normal[1]).max() < 1e-7 * np.abs(along.normal[1]).max()


def test_frenet_is_refused_where_it_is_not_and_names_w() -> None:
    w = np.linspace(0, 0.04, 81)
    with pytest.raises(BadInput, match=r"undefined at w = 0 mm: the curve does not bend"):
        frenet(SWERVE, w)
    with pytest.raises(BadInput, match=r"flips between w = 25\.7 and 26\.2 mm: an inflection"):
        frenet(SWERVE, 0.0132 + 0.0005 * np.arange(53))
    turned = frenet(HELIX, np.linspace(0, HELIX_LENGTH, 9))
    assert np.abs(turned.normal[:, 2]).max() < 1e-12  # towards the helix's axis


def test_stations_a_rounding_apart_do_no_harm() -> None:
    def far(w: np.ndarray, order: int) -> np.ndarray:  # whose points have fewer digits left than its stations
        return HELIX(w, order) + np.eye(1, order + 1)[0][:, None, None]

    w = np.sort(np.concatenate([np.linspace(0, HELIX_LENGTH, 65), np.linspace(0, HELIX_LENGTH, 65) * (1 + 2e-15)]))
    exact = HELIX.minimising(w)
    assert np.linalg.norm(double_reflection(far, w, exact[0]).normal - exact, axis=1).max() < 2e-5


def test_parallel_transport_turns_by_the_angle_between_the_tangents_and_about_both() -> None:
    from scipy.spatial.transform import Rotation

    w = np.array([0.0, HELIX_LENGTH / 5])
    here, there = frenet(HELIX, w).tangent
    axis, seed = np.cross(here, there), frenet(HELIX, w).normal[0]
    turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * np.arccos(here @ there))
    assert parallel_transport(HELIX, w, seed).normal[1] == pytest.approx(turn.apply(seed), abs=1e-14)


def test_a_closed_plane_curve_closes_and_a_helix_lags_by_its_torsion() -> None:
    assert total_twist(rotation_minimising(CIRCLE, np.linspace(0, 6e-3 * np.pi, 9))) == pytest.approx(0, abs=1e-12)
    whole = np.array([0.0, HELIX_LENGTH])  # three turns: first and last tangents are equal
    torsion = HELIX.pitch / (HELIX.radius**2 + HELIX.pitch**2)
    lag = (-torsion * HELIX_LENGTH + np.pi) % (2 * np.pi) - np.pi
    assert total_twist(rotation_minimising(HELIX, whole)) == pytest.approx(lag, abs=1e-9)
