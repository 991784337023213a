"""Finding and fitting: derivatives, optimality, equivariance, the bound, and never a guess."""

import math
from dataclasses import replace

import numpy as np
import pytest

from catheter.lab.vision_shots import STRESSES, plain, qr_shot
from data.errors import BadInput
from vision.centroid import centroid
from vision.fit import MarkerFit, NoMarker
from vision.fit_kernel import BINS, COUNTS, ROW, accumulate
from vision.fit_model import model_at
from vision.marker import find
from vision.pattern import QR, RINGS, SQUARES, Marker, square
from vision.plane import plane_angle_rad, rotation
from vision.render import Shot, angle_bound_rad, exact, render

SHOT = Shot(width_px=320, height_px=240, middle_px=(158.7, 121.2), pitch_px=70.0, angle_rad=0.6, noise_grey=2.0)


def turned(angle: float, other: float) -> float:
    return (angle - other + math.pi) % (2 * math.pi) - math.pi


@pytest.mark.parametrize("pattern", list(RINGS))
def test_the_models_derivatives_are_its_differences(pattern: str) -> None:
    rings, row, unused = RINGS[pattern], np.zeros(11), np.zeros(11)
    draw = np.random.default_rng(0)
    for _ in range(40):
        # u, v, log half, two log blurs, steeper, light: outside, inside, slopes
        at = np.array([*draw.uniform(-0.26, 0.26, 2), *np.log([0.2, 0.02, 0.03]), 3, -2, 200, 40, 9, -5.0])

        def grey(p: np.ndarray, out: np.ndarray) -> float:
            return model_at(p[0], p[1], np.exp(p[2:5]), p[5:7], p[7:11], rings, out)

        value = grey(at, row)
        assert 20 < value < 220
        for k in range(11):
            step = np.zeros(11)
            step[k] = 1e-5
            slope = (grey(at + step, unused) - grey(at - step, unused)) / 2e-5
            # row: u, v, half, blurs, steeper, then out, in, slopes; the table is good to 1e-8 of 180 grey
            assert row[k] == pytest.approx(slope, abs=0.3 if k < 2 else 0.03)


def least_squares(picture: np.ndarray, fit: MarkerFit, step: np.ndarray) -> tuple[float, np.ndarray]:
    """Sum of squares over a fixed set of pixels after a step of the homography, and J'r before blocks."""
    centre, change = np.eye(3), np.eye(3)
    centre[:2, 2] = 1 / 3
    change += np.array([[step[2], step[3], step[0]], [step[4], step[5], step[1]], [step[6], step[7], 0]])
    homography = fit.homography @ centre @ change @ np.linalg.inv(centre)
    normal, right = np.zeros((3, ROW, ROW)), np.zeros((3, ROW))
    counts, bins = np.zeros((3, COUNTS)), np.zeros(BINS, np.int64)
    shape = np.array([fit.size / 2, *fit.blur])
    plane = np.linalg.inv(homography)
    light, sums = (fit.steeper, fit.light), (normal, right, counts, bins)
    accumulate(picture, plane, shape, *light, SQUARES.rings, 0.05, 1e9, *sums, 1.0)
    return float(counts[:, 1].sum()), right.sum(axis=0)


def test_the_fit_is_a_minimum_and_its_gradient_the_differences() -> None:
    picture = exact(SHOT)  # no noise: float64, so that the sum is smooth
    fit = find(render(replace(SHOT, noise_grey=0.5), 1), SQUARES)
    base, _ = least_squares(picture, fit, np.zeros(8))
    for k in range(8):
        for sign in (-1, 1):
            step = np.zeros(8)
            step[k] = sign * 0.01
            assert least_squares(picture, fit, step)[0] > base
    away = np.array([1e-3, -2e-3, 1e-3, 2e-3, -1e-3, 1e-3, 2e-3, -1e-3])
    _, right = least_squares(picture, fit, away)
    for k in range(8):
        step = np.zeros(8)
        step[k] = 1e-6
        ends = [least_squares(picture, fit, away + sign * step)[0] for sign in (1, -1)]
        # steps compose, so that one at `away` is that of `right` to the size of `away`
        assert (ends[0] - ends[1]) / 2e-6 == pytest.approx(-2 * right[k], rel=0.03, abs=0.01 * np.abs(right[:8]).max())


@pytest.mark.parametrize("noise", [2.0, 8.0])
def test_scatter_bound_and_reported_deviation(noise: float) -> None:
    draw = np.random.default_rng(int(noise))
    shots = [replace(SHOT, angle_rad=draw.uniform(-3, 3), noise_grey=noise) for _ in range(100)]
    fits = [find(render(shot, draw), SQUARES) for shot in shots]
    errors = np.array([turned(f.angle_rad, s.angle_rad) for f, s in zip(fits, shots, strict=True)])
    sigma = math.sqrt(np.mean([f.sigma_rad**2 for f in fits]))
    bound = angle_bound_rad(shots[0])
    assert np.abs(errors / [f.sigma_rad for f in fits]).max() < 5
    assert errors.std() == pytest.approx(sigma, rel=0.21)  # 100 errors: 7 %, three of that
    assert 1.0 < sigma / bound < 1.5
    assert np.mean([f.noise_grey for f in fits]) == pytest.approx(math.hypot(noise, 12**-0.5), rel=0.03)


def test_turned_flipped_and_shifted_pictures() -> None:
    picture = render(SHOT, 5)
    fit = find(picture, SQUARES)
    quarter = find(np.ascontiguousarray(np.rot90(picture)), SQUARES)
    assert abs(turned(quarter.angle_rad, fit.angle_rad) - math.pi / 2) < 0.05 * fit.sigma_rad
    light = find(255 - picture, Marker(light=True))
    assert abs(light.angle_rad - fit.angle_rad) < 0.05 * fit.sigma_rad
    principal = SHOT.principal_px - [11, 7]
    shifted = find(np.ascontiguousarray(picture[7:, 11:]), SQUARES, principal)
    assert abs(shifted.angle_rad - fit.angle_rad) < 0.1 * fit.sigma_rad
    assert shifted.blobs_px == pytest.approx(fit.blobs_px - [11, 7], abs=1e-3)
    deep = find((picture.astype(np.uint16) << 8) + 128, SQUARES)
    assert abs(deep.angle_rad - fit.angle_rad) < 0.1 * fit.sigma_rad
    with pytest.raises(NoMarker):  # dark blobs where light ones are asked for
        find(picture, Marker(light=True))


def test_which_blob_is_which() -> None:
    for turn in np.linspace(-3, 3, 7):
        shot = replace(SHOT, angle_rad=turn, tilt_rad=0.3, tilt_axis_rad=turn / 2)
        fit = find(render(shot, 1), SQUARES)
        assert fit.blobs_px == pytest.approx(shot.blobs_px(), abs=0.05)
        assert plane_angle_rad(fit.homography, shot.principal_px) == pytest.approx(fit.angle_rad)


@pytest.mark.parametrize("stress", [s for s in STRESSES if not s.missing], ids=lambda s: s.name)
def test_disturbed_pictures_are_measured(stress) -> None:
    draw = np.random.default_rng(3)
    for _ in range(3):
        shot = stress.disturb(plain(draw), draw, 1.0)
        fit = find(render(shot, draw), SQUARES)
        assert abs(turned(fit.angle_rad, shot.angle_rad)) < max(math.radians(0.1), 5 * fit.sigma_rad)


@pytest.mark.parametrize("stress", [s for s in STRESSES if s.missing], ids=lambda s: s.name)
def test_a_marker_that_is_not_whole_is_missing(stress) -> None:
    draw = np.random.default_rng(4)
    for _ in range(12):
        with pytest.raises(NoMarker):
            find(render(stress.disturb(plain(draw), draw, 1.0), draw), SQUARES)


def test_a_cut_of_a_tenth_is_missed_in_any_direction() -> None:
    for turn in np.linspace(0, 2 * math.pi, 24):
        with pytest.raises(NoMarker):
            find(render(replace(SHOT, cut=(1, turn, 0.1)), 1), SQUARES)


def test_two_markers_are_not_guessed_between() -> None:
    contrast = SHOT.ink_grey - SHOT.card_grey
    other = [(square(np.array(place), 28.0), contrast) for place in ((240, 40), (310 - 0.0, 40), (240, 110))]
    near = replace(SHOT, middle_px=(90.0, 150.0), angle_rad=0.0)
    with pytest.raises(NoMarker, match=r"2 markers|border"):
        find(render(replace(near, patches=tuple((p - [15, 0], g) for p, g in other)), 1), SQUARES)
    fourth = SHOT.homography() @ np.array([1.0, 1.0, 1.0])
    middle, turn = fourth[:2] / fourth[2], SHOT.angle_rad
    corners = square(np.zeros(2), 28.0) @ rotation(turn).T
    with pytest.raises(NoMarker, match="4 markers"):  # four squares: any three are a marker
        find(render(replace(SHOT, patches=((middle + corners, contrast),)), 1), SQUARES)


def test_nothing_is_found_in_nothing() -> None:
    draw = np.random.default_rng(0)
    for picture in (np.zeros((60, 80)), draw.integers(0, 256, (240, 320)), np.full((240, 320), 200)):
        with pytest.raises(NoMarker):
            find(picture.astype(np.uint8), SQUARES)
    with pytest.raises(NoMarker, match="blobs of|unlike|settle|right angle"):
        find(render(replace(SHOT, size=0.6), 1), SQUARES)  # another design


def test_the_finders_of_qr_codes() -> None:
    draw = np.random.default_rng(8)
    for _ in range(8):
        shot = qr_shot(draw)
        fit = find(render(shot, draw), QR)
        assert np.hypot(*(fit.blobs_px - shot.blobs_px()).T).max() < 0.3  # identity and place


def test_a_picture_without_any_blur_is_measured_too() -> None:
    modules = np.zeros((21, 21))
    ring = np.pad(np.pad(np.ones((3, 3)), 1), 1, constant_values=1)
    for row, column in ((0, 0), (0, 14), (14, 0)):
        modules[row : row + 7, column : column + 7] = ring
    drawn = 255 - 200 * np.kron(np.pad(modules, 4), np.ones((8, 8)))
    angles = []
    for seed in range(40):
        noise = np.random.default_rng(seed).normal(0, 2, drawn.shape)
        found = find(np.clip(drawn + noise, 0, 255).astype(np.uint8), QR)
        assert found.blobs_px[0] == pytest.approx([59.5, 59.5], abs=0.05)  # modules 4 to 11, of 8 pixels
        angles.append((found.angle_rad, found.sigma_rad))
    scatter = np.std([angle for angle, _ in angles])
    assert 0.6 < scatter / np.mean([sigma for _, sigma in angles]) < 1.5


def test_what_is_no_grey_picture_is_refused() -> None:
    for picture in (np.zeros((9, 9, 3), np.uint8), np.zeros((9, 9))):
        with pytest.raises(BadInput, match="expected"):
            find(picture, SQUARES)
    for sizes in ((0.5, 0.4), (0.0, 0.4)):
        with pytest.raises(BadInput, match="size"):
            Marker(least_size=sizes[0], most_size=sizes[1])


def test_a_centroid_is_the_blobs_middle() -> None:
    shot = replace(SHOT, angle_rad=0.3, noise_grey=0.0)
    picture = render(shot)
    for x, y in shot.blobs_px():
        found = centroid(picture, x + 2, y - 1, 28.0, 220.0, 40.0)
        assert found[:2] == pytest.approx((x, y), abs=0.02)  # what the cut of faint pixels leaves
        assert found[2] == pytest.approx((0.4 * 70) ** 2, rel=0.01)
    assert math.isnan(centroid(picture, 5.0, 5.0, 4.0, 220.0, 40.0)[0])
