"""Finding a marker without knowing where it is: blobs, triangles of like blobs, identity, then the fit.

Candidates are proposed generously, from two thresholds; the fit and its checks decide. Two that
pass are two markers, and which is meant is not guessed.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput
from data.signal import Array
from vision.centroid import centroids
from vision.fit import MarkerFit, NoMarker, Picture, Start, TooSharp, fit
from vision.pattern import BLOBS, Marker
from vision.plane import affine, to_picture

LEAST_AREA_PX = 16
MOST_AREA = 0.15  # of the picture
MOST_BLOBS = 60
MOST_TRIES = 12
WORSE = 3.0  # times the last frame's residuals: then the fit is in a wrong place, and the whole frame is searched
LIKE = 0.6  # smaller over larger side among a marker's blobs
SOFT_PX = 0.7  # as a camera blurs
SQUARE_TO = 0.5  # most cosine between the legs of a tilted right angle
RIM = {"squares": 1.4, "qr": 8 / 7}  # half sides from a blob's middle at which its paper is looked at


@dataclass(frozen=True)
class Blobs:
    """Connected blobs: middles (n, 2) and sides (n,) in pixels."""

    middles_px: Array
    sides_px: Array


def find(picture: Picture, marker: Marker, principal_px: Array | None = None) -> MarkerFit:
    """Return the one marker in a grey picture, (height, width) of uint8 or uint16.

    Raises NoMarker with the reason when there is none, or more than one; BadInput for what is no
    grey picture.
    """
    check_picture(picture)
    found: list[MarkerFit] = []
    reasons: list[str] = []
    for start in _starts(picture, marker):
        try:
            one = _fit(picture, start, marker, principal_px)
        except NoMarker as error:
            reasons.append(str(error))
            continue
        if not any(_same(one, other) for other in found):
            found.append(one)
    if len(found) > 1:
        raise NoMarker(f"{len(found)} markers in view")
    if not found:
        raise NoMarker(reasons[0] if reasons else "no three like blobs stand in a right angle")
    return found[0]


def _fit(picture: Picture, start: Start, marker: Marker, principal_px: Array | None) -> MarkerFit:
    """Fit; a picture without any blur, as a program draws it, is blurred as by a camera first."""
    try:
        return fit(picture, start, marker, principal_px)
    except TooSharp:
        import cv2

        kept = float(
            np.sum(cv2.getGaussianKernel(9, SOFT_PX) ** 2)
        )  # of the noise; its neighbours now share it, so that it counts for more
        blurred: Any = cv2.GaussianBlur(picture, (9, 9), SOFT_PX)
        soft = fit(blurred, start, marker, principal_px)
        return replace(soft, sigma_rad=soft.sigma_rad / kept)


def follow(picture: Picture, last: MarkerFit, places_px: Array, marker: Marker, principal_px: Array) -> MarkerFit:
    """Return the marker near where its blobs are expected, (3, 2). Raises NoMarker when it is not there."""
    reach = (last.size / 2 * 1.42 + 0.1) * last.pitch_px
    near = centroids(picture, places_px, reach, last.light[:, :2])
    if not np.isfinite(near).all():
        raise NoMarker("a blob is not where it was expected")
    moved = affine(last.blobs_px, near) @ last.homography
    before = last.start
    start = Start(homography=moved / moved[2, 2], shape=before.shape, steeper=before.steeper, light=before.light)
    found = fit(picture, start, marker, principal_px)
    if found.noise_grey > WORSE * max(last.noise_grey, 0.5):
        raise NoMarker(f"residuals of {found.noise_grey:.1f} grey after {last.noise_grey:.1f}: another minimum")
    return found


def check_picture(picture: NDArray[Any]) -> None:
    """Raise BadInput unless this is a grey picture of 8 or 16 bits."""
    if picture.ndim != 2 or picture.dtype not in (np.uint8, np.uint16):
        found = f"is {picture.dtype} of shape {picture.shape}"
        raise BadInput("picture", found, "expected (height, width) of uint8 or uint16; frames.grey converts")


def triangles(blobs: Blobs, marker: Marker) -> list[tuple[int, int, int]]:
    """Return the triples that could be a marker, the likeliest first: corner, second, third.

    The corner is where the right angle stands, the second lies clockwise of the third as seen
    (y is down): so a marker is told from its mirror image and from itself upside down.
    """
    n = len(blobs.sides_px)
    legs = blobs.middles_px[None] - blobs.middles_px[:, None]  # [from, to]
    length = np.hypot(legs[..., 0], legs[..., 1])
    one, two = legs[:, :, None], legs[:, None, :]
    product = np.maximum(length[:, :, None] * length[:, None, :], 1e-9)
    cosine = (one * two).sum(axis=-1) / product
    turn = (one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0]) / product
    ratio = length[:, :, None] / np.maximum(length[:, None, :], 1e-9)
    sides = blobs.sides_px
    least = np.minimum(np.minimum(sides[:, None, None], sides[None, :, None]), sides[None, None, :])
    most = np.maximum(np.maximum(sides[:, None, None], sides[None, :, None]), sides[None, None, :])
    size = np.cbrt(sides[:, None, None] * sides[None, :, None] * sides[None, None, :]) / np.sqrt(product)
    slack = 1.3 if marker.pattern == "squares" else 1.5
    right = (turn > 0) & (np.abs(cosine) < SQUARE_TO) & (ratio > 0.6) & (ratio < 1 / 0.6) & (least > LIKE * most)
    right &= (size > marker.least_size / slack) & (size < marker.most_size * slack)
    cost = np.abs(cosine) + np.abs(np.log(np.where(right, ratio, 1.0))) + np.abs(np.log(least / most))
    places = np.argwhere(right)
    order = np.argsort(cost[right], kind="stable")
    assert n == len(blobs.middles_px)
    return [(int(i), int(j), int(k)) for i, j, k in places[order]]


def blobs(picture: Picture, marker: Marker) -> list[Blobs]:
    """Return the blobs that a global and a local threshold each show, ready for `triangles`."""
    import cv2

    grey = picture if picture.dtype == np.uint8 else cv2.convertScaleAbs(picture, alpha=1 / 257)
    grey = 255 - grey if marker.light else grey
    smooth = cv2.GaussianBlur(grey, (5, 5), 0)
    window = max(15, min(picture.shape) // 3) | 1
    kind = cv2.THRESH_BINARY_INV
    masks = [cv2.threshold(smooth, 0, 255, kind | cv2.THRESH_OTSU)[1]]
    wide = cv2.GaussianBlur(grey, (9, 9), 0)
    masks.append(cv2.adaptiveThreshold(wide, 255, cv2.ADAPTIVE_THRESH_MEAN_C, kind, window, 3))
    if marker.pattern == "qr":
        masks.append(cv2.adaptiveThreshold(grey, 255, cv2.ADAPTIVE_THRESH_MEAN_C, kind, window // 3 | 1, 5))
    return [_components(np.asarray(mask, np.uint8), marker) for mask in masks]


def _components(mask: NDArray[np.uint8], marker: Marker) -> Blobs:
    import cv2

    _, _, stats, found = cv2.connectedComponentsWithStats(mask, connectivity=4)
    area: Array = stats[1:, cv2.CC_STAT_AREA].astype(np.float64)
    boxes: Array = stats[1:, :4].astype(np.float64)
    middles = np.asarray(found[1:], np.float64)
    width, height = boxes[:, 2], boxes[:, 3]
    least = LEAST_AREA_PX if marker.pattern == "squares" else 4
    like = (area >= least) & (area < MOST_AREA * mask.size) & (width < 3 * height) & (height < 3 * width)
    if marker.pattern == "qr":
        return _nested(area[like], boxes[like], middles[like])
    like &= area > 0.35 * width * height
    chosen = np.flatnonzero(like)
    chosen = chosen[np.argsort(area[chosen])[::-1][:MOST_BLOBS]]
    return Blobs(middles[chosen], np.sqrt(area[chosen]))


def _nested(area: Array, boxes: Array, middles: Array) -> Blobs:
    """Return rings of 7 x 7 modules that hold a block of 3 x 3 in their middle, as blobs."""
    if not len(area):
        return Blobs(np.empty((0, 2)), np.empty(0))
    box_middle, size = boxes[:, :2] + boxes[:, 2:] / 2, np.sqrt(boxes[:, 2] * boxes[:, 3])
    apart = np.hypot(*(box_middle[:, None] - box_middle[None]).transpose(2, 0, 1))
    scale, share = size[:, None] / size[None], area[:, None] / area[None]  # [ring, block]
    pair = (apart < 0.15 * size[:, None]) & (scale > 1.6) & (scale < 3.4) & (share > 1.3) & (share < 5)
    pair &= (area > 0.3 * boxes[:, 2] * boxes[:, 3])[None]
    rings, blocks = np.nonzero(pair)
    side = np.sqrt(area[blocks]) * 7 / 3
    order = np.argsort(side)[::-1][:MOST_BLOBS]
    return Blobs((middles[blocks][order] + middles[rings][order]) / 2, side[order])


def _starts(picture: Picture, marker: Marker) -> list[Start]:
    """Return where fits should begin, each place once, those of either threshold in turn."""
    found: list[Start] = []
    seen: list[Array] = []
    for some in blobs(picture, marker):
        for triple in triangles(some, marker)[:MOST_TRIES]:
            places = some.middles_px[list(triple)]
            side = float(some.sides_px[list(triple)].mean())
            if any(np.abs(places - other).max() < 0.05 * side for other in seen):
                continue
            seen.append(places)
            found.append(_start(picture, places, side, marker))
    return found


def _start(picture: Picture, places_px: Array, side_px: float, marker: Marker) -> Start:
    """Return a fit's beginning from three rough middles: grey levels looked up, centroids weighed."""
    pitch = float(np.hypot(*(places_px[1:] - places_px[0]).T).mean())
    half = np.clip(side_px / pitch, marker.least_size, marker.most_size) / 2
    rim = half * RIM[marker.pattern]
    around = rim * np.array([[-1, -1], [0, -1], [1, -1], [1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0]])
    homography = affine(BLOBS, places_px)
    light = np.zeros((3, 4))
    for b in range(3):
        light[b, 0] = np.median(_look(picture, to_picture(homography, BLOBS[b] + around)))
        light[b, 1] = np.median(_look(picture, places_px[b] + np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])))
    if marker.pattern == "squares" and (np.abs(light[:, 0] - light[:, 1]) > 3).all():
        near = centroids(picture, places_px, 1.42 * rim * pitch, light[:, :2])
        homography = affine(BLOBS, near if np.isfinite(near).all() else places_px)
    blur = 1.5 / pitch
    return Start(homography=homography, shape=np.array([half, blur, blur]), steeper=np.zeros(2), light=light)


def _look(picture: Picture, places_px: Array) -> Array:
    height, width = picture.shape
    x, y = np.rint(places_px).astype(int).T
    return np.asarray(picture[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)], np.float64)


def _same(one: MarkerFit, other: MarkerFit) -> bool:
    return bool(np.abs(one.blobs_px - other.blobs_px).max() < 0.1 * one.pitch_px)
