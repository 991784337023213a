"""Rendered pictures for the reports on vision: markers under stress, QR codes, ArUco markers, decoys."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data.signal import Array
from vision.pattern import QR, square
from vision.render import Shot

Polygons = tuple[tuple[Array, float], ...]


def plain(draw: np.random.Generator, *, noise_grey: float = 2.0) -> Shot:
    """Return the marker of the accuracy table: any angle, somewhere near the picture's middle."""
    middle = np.array([319.5, 239.5]) + draw.uniform(-20, 20, 2)
    return Shot(
        angle_rad=draw.uniform(-np.pi, np.pi), middle_px=(float(middle[0]), float(middle[1])), noise_grey=noise_grey
    )


def modules(matrix: NDArray[np.uint8], pitch_modules: float, origin: float) -> Polygons:
    """Return a code's dark modules (0 in the matrix) as rectangles in pitches, runs of a row as one.

    origin: where the plane's origin stands, in modules along and down.
    """
    found = []
    for row, line in enumerate(matrix == 0):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], line, [False]]).astype(int)))
        for start, end in edges.reshape(-1, 2):
            corners = np.array([[start, row], [end, row], [end, row + 1], [start, row + 1]], dtype=np.float64)
            found.append(((corners - origin) / pitch_modules, 1.0))
    return tuple(found)


def aruco(number: int) -> Polygons:
    """Return an ArUco marker (4 x 4 bits, 6 x 6 cells) of the same side as the three-blob marker."""
    import cv2

    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    cells = np.asarray(cv2.aruco.generateImageMarker(dictionary, number, 6), np.uint8)
    return modules(cells, 6 / 1.4, 3 - 0.5 * 6 / 1.4)


def qr(text: str) -> tuple[Polygons, int]:
    """Return a QR code's polygons, its upper left finder's middle at the origin, and its modules along a side."""
    import cv2

    matrix = np.asarray(cv2.QRCodeEncoder.create().encode(text), np.uint8)
    used = np.flatnonzero((matrix == 0).any(axis=0))
    matrix = matrix[used[0] : used[-1] + 1, used[0] : used[-1] + 1]
    return modules(matrix, len(matrix) - 7, 3.5), len(matrix)


def qr_shot(draw: np.random.Generator) -> Shot:
    """Return a QR code in a random pose: perspective, blur, noise and uneven light."""
    polygons, count = qr("catheter " + "robot " * int(draw.integers(0, 12)))
    module_px = draw.uniform(5, 9) * min(1.0, 33 / count)
    side_px = module_px * count
    slack = np.maximum(0, (np.array([640, 480]) - 1.2 * side_px) / 2) * 0.6
    middle = np.array([319.5, 239.5]) + draw.uniform(-1, 1, 2) * slack
    turn = draw.uniform(0, 2 * np.pi)
    return Shot(
        marker=QR,
        layout=polygons,
        angle_rad=draw.uniform(-np.pi, np.pi),
        middle_px=(float(middle[0]), float(middle[1])),
        pitch_px=module_px * (count - 7),
        tilt_rad=draw.uniform(0, np.radians(35)),
        tilt_axis_rad=draw.uniform(-np.pi, np.pi),
        focal_px=700.0,
        blur_px=draw.uniform(0.6, 1.6),
        card_grey=draw.uniform(140, 190),
        ink_grey=draw.uniform(20, 60),
        ramp=(0.6 * np.cos(turn), 0.6 * np.sin(turn)),
        noise_grey=draw.uniform(1, 10),
    )


@dataclass(frozen=True)
class Stress:
    """One disturbance: its name, how it changes a shot at a strength from 0 to 1, whether the marker must be missed."""

    name: str
    disturb: Callable[[Shot, np.random.Generator, float], Shot]
    missing: bool = False


def _motion(shot: Shot, draw: np.random.Generator, strength: float) -> Shot:
    turn = draw.uniform(0, 2 * np.pi)
    return replace(shot, motion_px=(10 * strength * np.cos(turn), 10 * strength * np.sin(turn)))


def _ramp(shot: Shot, draw: np.random.Generator, strength: float) -> Shot:
    turn = draw.uniform(0, 2 * np.pi)
    return replace(shot, ramp=(strength * np.cos(turn), strength * np.sin(turn)))


def _glare(shot: Shot, draw: np.random.Generator, strength: float) -> Shot:
    x, y = np.asarray(shot.middle_px) + draw.uniform(-100, 100, 2)
    return replace(shot, glare=(float(x), float(y), 40.0, 100.0 * strength))


def _tilt(shot: Shot, draw: np.random.Generator, strength: float) -> Shot:
    return replace(shot, tilt_rad=np.radians(20) * strength, tilt_axis_rad=draw.uniform(-np.pi, np.pi))


def _contrast(shot: Shot, _: np.random.Generator, strength: float) -> Shot:
    half = (180 - 160 * strength) / 2
    return replace(shot, card_grey=130 + half, ink_grey=130 - half)


def _noise(shot: Shot, _: np.random.Generator, strength: float) -> Shot:
    return replace(shot, noise_grey=25 * strength)


def _upside_down(shot: Shot, draw: np.random.Generator, _: float) -> Shot:
    return replace(shot, angle_rad=np.pi + draw.uniform(-0.05, 0.05))


def _second(shot: Shot, draw: np.random.Generator, strength: float) -> Shot:
    """Add three discs in a right angle, or squares of another size to pitch, or one square of the same size."""
    kind = int(draw.integers(3))
    corner = draw.choice([60.0, 520.0]), draw.choice([50.0, 370.0])
    pitch, side = (65.0, 26.0 * np.sqrt(4 / np.pi)) if kind == 0 else (65.0, 40.0)
    if kind == 2:
        pitch, side = 0.0, 0.4 * shot.pitch_px
    places = np.array(corner) + pitch * np.array([[0, 0], [1, 0], [0, 1]])
    ring = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    disc = side / 2 * np.stack([np.cos(ring), np.sin(ring)], axis=-1)
    grey = (shot.ink_grey - shot.card_grey) * strength
    shapes = [place + disc if kind == 0 else square(place, side) for place in places[: 1 if kind == 2 else 3]]
    return replace(shot, patches=tuple((shape, grey) for shape in shapes))


def _all(shot: Shot, draw: np.random.Generator, _: float) -> Shot:
    for disturb in (_contrast, _motion, _ramp, _glare, _tilt, _noise, _second):
        shot = disturb(shot, draw, 0.5)
    return replace(shot, angle_rad=np.pi + draw.uniform(-np.pi / 2, np.pi / 2))


def _cut(shot: Shot, draw: np.random.Generator, _: float) -> Shot:
    return replace(shot, cut=(int(draw.integers(3)), draw.uniform(0, 2 * np.pi), draw.uniform(0.1, 0.6)))


def _border(shot: Shot, draw: np.random.Generator, _: float) -> Shot:
    """Shift the marker until the left border cuts a blob by a tenth to the whole of its side's projection."""
    blobs = shot.blobs_px()
    half = 0.2 * shot.pitch_px * (abs(np.cos(shot.angle_rad)) + abs(np.sin(shot.angle_rad)))
    past = draw.uniform(0.4, 1.0) * half
    shift = -0.5 - (blobs[:, 0].min() - half) - past
    return replace(shot, middle_px=(shot.middle_px[0] + float(shift), shot.middle_px[1]))


def _absent(shot: Shot, draw: np.random.Generator, _: float) -> Shot:
    lost = int(draw.integers(3))
    keep = tuple((square(np.array(place), 0.4), 1.0) for i, place in enumerate(((0, 0), (1, 0), (0, 1))) if i != lost)
    return replace(_second(shot, draw, 1.0), layout=keep)


STRESSES = (
    Stress("motion blur of 10 px", _motion),
    Stress("light ramp, +-50 % across the picture", _ramp),
    Stress("glare of 100 grey, radius 40 px", _glare),
    Stress("tilt of 20 deg", _tilt),
    Stress("contrast of 20 grey", _contrast),
    Stress("noise of 25 grey", _noise),
    Stress("a second marker-like object", _second),
    Stress("upside down", _upside_down),
    Stress("all at half strength", _all),
    Stress("a blob cut by a tenth or more", _cut, missing=True),
    Stress("cut by the picture's border", _border, missing=True),
    Stress("a blob absent, decoys in view", _absent, missing=True),
)
