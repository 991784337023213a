"""The study of the angle: how near several methods are to the Cramer-Rao bound, and how fast."""

import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from catheter.lab.report import Progress, Report, Row
from catheter.lab.vision_shots import aruco, plain, qr
from catheter.lab.vision_tally import Answer, Pixels, Tally, ours
from data.signal import Array
from vision.centroid import centroids
from vision.fit import NoMarker
from vision.marker import blobs, triangles
from vision.pattern import BLOBS, SQUARES
from vision.plane import affine, plane_angle_rad
from vision.render import Shot, angle_bound_rad, exact, render
from vision.twist import Tracker

TILTED = ("x", "y", "pitch_px", "size", "blur_px", "card_grey", "ink_grey", "tilt_rad", "tilt_axis_rad")


def twist(quick: bool, progress: Progress) -> Report:
    """Angle accuracy of several methods beside the Cramer-Rao bound, speed, and sizes of pictures."""
    count = 15 if quick else 500
    rows, notes = _accuracy(count, progress)
    sized, speed = _sizes(60 if quick else 300)
    progress(1.0)
    return Report(
        name="twist",
        title=f"In-plane angle, marker of 200 px, blur 0.7 px, contrast 180, {count} random angles (simulated)",
        level="picture",
        error="rms error, degrees",
        rows=rows + sized,
        notes=notes + speed,
    )


def _accuracy(count: int, progress: Progress) -> tuple[list[Row], list[str]]:
    fewer = max(20, count // 3)
    code = qr("catheter robot")[0], 1.4 * 14 / 21  # as many pixels across as the marker
    groups: list[tuple[dict[str, Callable[[Pixels], Answer]], Callable[[Shot], Shot], int]] = [
        (_METHODS, lambda shot: shot, count),
        ({"OpenCV ArUco, contour refinement": _aruco}, lambda shot: replace(shot, layout=aruco(7)), fewer),
        (
            {"OpenCV QRCodeDetector": _qr_opencv},
            lambda shot: replace(shot, layout=code[0], pitch_px=shot.pitch_px * code[1]),
            fewer,
        ),
    ]
    tallies: dict[tuple[str, int], Tally] = {}
    for at, (methods, change, number) in enumerate(groups):
        draw = np.random.default_rng(at)
        for k in range(number):
            shot = change(plain(draw))
            clean = exact(shot)
            for noise in (2, 8):
                picture = _noisy(clean, noise, draw)
                for name, method in methods.items():
                    tallies.setdefault((name, noise), Tally()).take(method, picture, shot.angle_rad)
            progress(0.8 * (at + k / number) / len(groups))
    rows, notes = [tally.row(name, f"noise {noise}") for (name, noise), tally in tallies.items()], []
    shot = plain(np.random.default_rng(0))
    for noise in (2, 8):
        mine = tallies["this project", noise]
        bound = math.degrees(angle_bound_rad(shot, noise_grey=noise))
        tilted = math.degrees(angle_bound_rad(replace(shot, tilt_rad=1e-3), TILTED, noise))
        rows.append(Row(method="Cramer-Rao bound", level=f"noise {noise}", error=bound, seconds=math.nan))
        sigma = math.sqrt(float(np.mean(np.square(mine.sigmas))))
        notes.append(
            f"Noise {noise}: ours {mine.rms / bound:.2f} x the bound of {bound:.6f} deg (unknown: place, pitch, size, "
            f"blur, both greys; {tilted:.6f} with tilt); reported sigma / scatter {sigma / mine.rms:.3f}."
        )
    lost = [f"{name} at {noise}: {len(t.missed)} of {t.count}" for (name, noise), t in tallies.items() if t.missed]
    return rows, [
        *notes,
        f"Missed: {'; '.join(lost) or 'none'}. Seconds: one picture, searched as a whole, not followed.",
    ]


def _noisy(clean: Array, noise: float, draw: np.random.Generator) -> Pixels:
    return np.clip(np.rint(clean + noise * draw.standard_normal(clean.shape)), 0, 255).astype(np.uint8)


def _sizes(frames: int) -> tuple[list[Row], list[str]]:
    """Follow a turning marker in pictures and at sizes of several kinds; return rows and the speeds in words."""
    import cv2

    rows, notes = [], []
    for width, height, side in ((320, 240, 100), (640, 480, 100), (640, 480, 200), (1280, 960, 200), (1280, 960, 400)):
        base = Shot(width_px=width, height_px=height, pitch_px=side / 1.4, noise_grey=2.0)
        middle = ((width - 1) / 2, (height - 1) / 2)
        shots = [replace(base, angle_rad=0.6 * math.sin(k / 20), middle_px=middle) for k in range(frames // 2)]
        pictures = [render(shot, k) for k, shot in enumerate(shots)]
        tracker, tally = Tracker(), Tally()
        tracker.locate(pictures[0])
        method = _following(tracker)
        burnt = time.process_time()
        for shot, picture in zip(shots, pictures, strict=True):
            tally.take(method, picture, shot.angle_rad)
        burnt = (time.process_time() - burnt) / len(shots)
        encoded = [cv2.imencode(".jpg", picture)[1] for picture in pictures[:20]]
        started = time.perf_counter()
        for data in encoded:
            cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
        decoding = (time.perf_counter() - started) / len(encoded)
        rows.append(tally.row("this project, followed", f"{width} x {height}, marker {side} px"))
        notes.append(
            f"{width} x {height}, marker {side} px: {len(shots) / tally.seconds:.0f} frames/s from grey frames "
            f"({1 / burnt:.0f} by processor time); decoding a JPEG apart: {1e3 * decoding:.2f} ms."
        )
    return rows, notes


def _following(tracker: Tracker) -> Callable[[Pixels], Answer]:
    def method(picture: Pixels) -> Answer:
        found, _ = tracker.locate(picture)
        return found.angle_rad, found.sigma_rad

    return method


def _binary(picture: Pixels) -> Answer:
    """Measure as the thesis does: blur, threshold, connected blobs, their binary centroids."""
    middles = _three(picture)
    return plane_angle_rad(affine(BLOBS, middles), (0.0, 0.0)), math.nan


def _weighted(picture: Pixels) -> Answer:
    """Weigh the same blobs by their grey."""
    middles = _three(picture)
    radius = 0.36 * float(np.hypot(*(middles[1] - middles[0])))
    levels = np.tile([float(np.median(picture)), float(np.percentile(picture, 0.5))], (3, 1))
    return plane_angle_rad(affine(BLOBS, centroids(picture, middles, radius, levels)), (0.0, 0.0)), math.nan


def _three(picture: Pixels) -> Array:
    some = blobs(picture, SQUARES)[0]
    found = triangles(some, SQUARES)
    if not found:
        raise NoMarker("no triangle")
    return some.middles_px[list(found[0])]


def _aruco(picture: Pixels) -> Answer:
    import cv2

    options = cv2.aruco.DetectorParameters()
    options.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), options)
    corners, numbers, _ = detector.detectMarkers(picture)
    if numbers is None or len(numbers) != 1:
        raise NoMarker("no ArUco marker")
    return _of_corners(np.asarray(corners[0], np.float64).reshape(4, 2))


def _qr_opencv(picture: Pixels) -> Answer:
    import cv2

    found, corners = cv2.QRCodeDetector().detect(picture)
    if not found or corners is None:
        raise NoMarker("no QR code")
    return _of_corners(np.asarray(corners, np.float64).reshape(4, 2))


def _of_corners(c: Array) -> Answer:
    """Return the angle of a square from its four corners, all of its sides weighed alike."""
    along, down = c[1] - c[0] + c[2] - c[3], c[3] - c[0] + c[2] - c[1]
    return math.atan2(down[0] - along[1], along[0] + down[1]), math.nan


_METHODS: dict[str, Callable[[Pixels], Answer]] = {
    "this project": ours,
    "this project, grey-weighted centroids alone": _weighted,
    "thesis: blur, threshold, binary centroids": _binary,
}
