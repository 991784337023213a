"""The synthetic camera is exact: against closed forms, conserved ink, independent quadrature, and its own limits."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from vision.pattern import BLOBS, area, cut, square
from vision.plane import angle_slope, plane_angle_rad, to_picture
from vision.render import NUISANCES, Shot, angle_bound_rad, exact, render, slope

SMALL = Shot(width_px=120, height_px=100, middle_px=(59.3, 49.8), pitch_px=40.0, angle_rad=0.37)


def rise(x: np.ndarray, blur: float) -> np.ndarray:
    """The antiderivative of a unit box blurred by a Gaussian."""

    def psi(z: np.ndarray) -> np.ndarray:
        return z * ndtr(z) + np.exp(-(z**2) / 2) / math.sqrt(2 * math.pi)

    return blur * (psi((x + 0.5) / blur) - psi((x - 0.5) / blur))


@pytest.mark.parametrize("blur", [0.3, 0.7, 3.0])
def test_an_upright_marker_is_its_closed_form(blur: float) -> None:
    shot = replace(SMALL, angle_rad=0.0, blur_px=blur)
    ink = np.zeros((100, 120))
    for x, y in shot.blobs_px():
        across, down = (
            rise(c + 8 - np.arange(n), blur) - rise(c - 8 - np.arange(n), blur) for c, n in ((x, 120), (y, 100))
        )
        ink += np.outer(down, across)
    assert exact(shot) == pytest.approx(220 - 180 * ink, abs=2e-5)  # 1e-7 of the contrast


@pytest.mark.parametrize("angle", [0.1, math.pi / 4, 2.0, -1.3])
def test_a_turned_marker_agrees_with_independent_quadrature(angle: float) -> None:
    shot = replace(SMALL, angle_rad=angle)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    x = (np.arange(120)[:, None] + nodes / 2).ravel()
    y = (np.arange(100)[:, None] + nodes / 2).ravel()
    seen = np.stack(np.meshgrid(x, y), axis=-1) - np.array(shot.middle_px)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    plane = seen @ turn.T + 20.0  # in pixels from the corner blob, along the marker's axes
    ink = np.zeros(plane.shape[:2])
    for u, v in 40.0 * BLOBS:
        a, b = (ndtr((p + 8) / 0.7) - ndtr((p - 8) / 0.7) for p in (plane[..., 0] - u, plane[..., 1] - v))
        ink += a * b
    pixel = np.einsum("ykxl,k,l->yx", ink.reshape(100, 8, 120, 8), weights / 2, weights / 2)
    assert exact(shot) == pytest.approx(220 - 180 * pixel, abs=1e-4)


@pytest.mark.parametrize("tilt", [0.0, 0.35])
def test_ink_is_the_area_of_what_is_seen(tilt: float) -> None:
    shot = replace(SMALL, tilt_rad=tilt, tilt_axis_rad=0.8, cut=(1, 0.4, 0.25))
    squares = [square(blob, 0.4) for blob in BLOBS]
    squares[1] = cut(squares[1], np.array([math.cos(0.4), math.sin(0.4)]), 0.25)
    assert area(squares[1]) == pytest.approx(0.75 * 0.16, abs=1e-12)
    seen = sum(area(to_picture(shot.homography(), polygon)) for polygon in squares)
    assert (220 - exact(shot)).sum() / 180 == pytest.approx(seen, rel=1e-6)


def test_a_marker_beyond_the_border_is_the_part_that_is_seen() -> None:
    wide = exact(replace(SMALL, width_px=200, middle_px=(99.3, 49.8)))
    narrow = exact(replace(SMALL, width_px=120, middle_px=(19.3, 49.8)))
    assert narrow == pytest.approx(wide[:, 80:], abs=1e-9)


def test_motion_blur_is_the_mean_over_the_exposure() -> None:
    moved = exact(replace(SMALL, motion_px=(6.0, -4.0), spin_rad=0.1))
    shares = (np.arange(200) + 0.5) / 200 - 0.5  # midpoint rule: its error falls with the square, to 1e-3 grey
    mean = sum(exact(replace(SMALL, middle_px=(59.3 + 6 * s, 49.8 - 4 * s), angle_rad=0.37 + 0.1 * s)) for s in shares)
    assert moved == pytest.approx(mean / 200, abs=5e-3)


def test_derivatives_are_of_second_order() -> None:
    for name in ("angle_rad", "x", "blur_px", "size"):
        fine = slope(SMALL, name, 1e-4)
        errors = [np.abs(slope(SMALL, name, step) - fine).max() for step in (4e-3, 2e-3)]
        assert errors[0] / errors[1] == pytest.approx(4, abs=0.4)


def test_the_bound_scales_with_noise_and_grows_with_what_is_unknown() -> None:
    few, many = (angle_bound_rad(SMALL, names, 2.0) for names in (("x", "y"), (*NUISANCES, "tilt_rad")))
    assert few <= many
    ratio = angle_bound_rad(SMALL, noise_grey=20.0) / angle_bound_rad(SMALL, noise_grey=2.0)
    assert ratio == pytest.approx(math.hypot(20, 12**-0.5) / math.hypot(2, 12**-0.5), rel=1e-9)


@pytest.mark.parametrize("focal", [300.0, 900.0])
def test_the_angle_in_its_own_plane_is_read_back_whatever_the_tilt(focal: float) -> None:
    draw = np.random.default_rng(1)
    for _ in range(50):
        angle, axis = draw.uniform(-3, 3, 2)
        shot = replace(SMALL, angle_rad=angle, tilt_rad=draw.uniform(0, 0.7), tilt_axis_rad=axis, focal_px=focal)
        found = plane_angle_rad(shot.homography(), shot.principal_px)
        assert found == pytest.approx(angle, abs=1e-12)


def test_the_angles_slope_is_its_difference() -> None:
    shot = replace(SMALL, tilt_rad=0.4, tilt_axis_rad=1.0)
    homography, step = shot.homography(), 1e-6
    for i, j in ((0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1)):
        change = np.zeros((3, 3))
        change[i, j] = step * (1e-2 if i == 2 else 1)
        ends = [plane_angle_rad(homography + sign * change, shot.principal_px) for sign in (1, -1)]
        expected = angle_slope(homography, shot.principal_px)[i, j]
        assert (ends[0] - ends[1]) / (2 * change[i, j]) == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_noise_is_what_was_asked_for() -> None:
    shot = replace(SMALL, noise_grey=3.0, card_grey=150.0)
    residual = render(shot, 1) - exact(shot)
    assert residual.std() == pytest.approx(math.hypot(3, 12**-0.5), rel=0.03)  # 12,000 pixels: 0.6 %
    assert (render(shot, 1) == render(shot, 1)).all()
