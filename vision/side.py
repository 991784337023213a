"""The second camera, from the side: the actuator's outline and tip, and a robot's stroke past a scale.

The actuator is darker (or, with light=True, lighter) than what is behind it and enters from one
border of the picture. Edges are places where the grey passes half way between the two, found
between pixels by a straight line.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput
from data.signal import Array
from vision.fit import NoMarker, Picture
from vision.marker import check_picture

TURNS = {"top": 0, "left": 3, "bottom": 2, "right": 1}  # quarter turns that bring the base to the top
LEAST_CONTRAST = 10.0


@dataclass(frozen=True)
class Side:
    """An actuator seen from the side, in pixels from the border that it enters by.

    extension_px: to its tip, with standard deviation sigma_px. along_px (n,): rows of the outline,
    edges_px (n, 2): where it begins and ends across, in the picture's own x (or y) direction.
    """

    extension_px: float
    sigma_px: float
    along_px: Array
    edges_px: Array


def side(picture: Picture, base: str = "top", *, light: bool = False) -> Side:
    """Return the outline and the tip of an actuator that enters at `base` (top, bottom, left, right).

    The tip is the mean of where the middle third of the actuator's columns end. Raises NoMarker
    when nothing enters there or it runs through the whole picture, BadInput for no grey picture.
    """
    check_picture(picture)
    if base not in TURNS:
        raise BadInput("base", f"is {base!r}", f"expected one of {', '.join(TURNS)}")
    turned = np.rot90(picture, TURNS[base]).astype(np.float64)
    grey = -turned if not light else turned
    body, level, noise = _body(grey)
    rows = np.flatnonzero(body.any(axis=1))
    edges = np.array([_crossings(grey[row], body[row], level) for row in rows])
    tips = _tips(grey, body, level)
    if base in ("left", "bottom"):  # the turn reversed the direction across
        edges = (grey.shape[1] - 1) - edges[:, ::-1]
    slope = max(1.0, float(np.abs(np.diff(grey, axis=0)).max()))
    sigma = float(np.hypot(noise / slope, tips.std()) / np.sqrt(len(tips)))
    return Side(float(tips.mean()), sigma, rows.astype(np.float64), edges)


def stroke_m(picture: Picture, scale_row: int, edge_row: int, spacing_m: float, *, band_px: int = 5) -> float:
    """Return where a robot's leading edge stands on a scale, in metres from the scale's first line in view.

    scale_row, edge_row: rows through the scale's dark lines, which stand spacing_m apart, and
    through the robot, which is darker than the ground and enters from the left; band_px rows are
    averaged. Between lines the place is interpolated, so that a lens's distortion cancels. Raises
    NoMarker when there are fewer than two lines, no edge, or the edge lies beyond the lines.
    """
    check_picture(picture)
    if not spacing_m > 0:
        raise BadInput("spacing", f"is {spacing_m} m", "expected more than 0")
    scale, robot = (_profile(picture, row, band_px) for row in (scale_row, edge_row))
    lines = _lines(scale)
    if len(lines) < 2:
        raise NoMarker(f"{len(lines)} lines of the scale in row {scale_row}")
    level = _half(robot)
    falls = np.flatnonzero((robot[:-1] <= level) & (robot[1:] > level))
    if not falls.size:
        raise NoMarker(f"no edge of the robot in row {edge_row}")
    at = int(falls[-1])
    edge = at + (level - robot[at]) / (robot[at + 1] - robot[at])
    if not lines[0] <= edge <= lines[-1]:
        raise NoMarker(f"the robot's edge at {edge:.1f} px lies beyond the scale's lines")
    return float(np.interp(edge, lines, spacing_m * np.arange(len(lines))))


def _body(grey: Array) -> tuple[NDArray[np.bool_], float, float]:
    """Return the pixels of the actuator, base at the top, the grey of its edge, and the noise."""
    import cv2

    shown = np.interp(grey, [grey.min(), grey.max()], [0, 255]).astype(np.uint8)
    mask = cv2.threshold(cv2.GaussianBlur(shown, (5, 5), 0), 0, 1, cv2.THRESH_BINARY + cv2.THRESH_OTSU)[1]
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    enters = [k for k in range(1, len(stats)) if stats[k, cv2.CC_STAT_TOP] == 0 and stats[k, cv2.CC_STAT_HEIGHT] > 3]
    if not enters or np.ptp(grey) < LEAST_CONTRAST:
        raise NoMarker("nothing enters the picture at the base")
    body = labels == max(enters, key=lambda k: int(stats[k, cv2.CC_STAT_AREA]))
    if body[-1].any():
        raise NoMarker("the actuator runs through the whole picture")
    level = float(np.median(grey[body]) + np.median(grey[~body])) / 2
    noise = 1.4826 * float(np.median(np.abs(grey[~body] - np.median(grey[~body]))))
    return body, level, max(noise, 0.3)


def _crossings(line: Array, inside: NDArray[np.bool_], level: float) -> tuple[float, float]:
    """Return where a row rises through the level into the actuator and falls out of it."""
    columns = np.flatnonzero(inside)
    return _cross(line, int(columns[0]), -1, level), _cross(line, int(columns[-1]), 1, level)


def _cross(line: Array, start: int, step: int, level: float) -> float:
    """Return where a line passes a level nearest to `start`, going outwards by `step`."""
    at = start
    while line[at] < level and 0 <= at - step < len(line):  # the threshold lay outside: step in first
        at -= step
    if line[at] < level:  # nowhere in this line: the threshold's own edge is all there is
        return float(start)
    while 0 <= at + step < len(line) and line[at + step] >= level:
        at += step
    if not 0 <= at + step < len(line):
        return float(at)
    return at + step * float((line[at] - level) / (line[at] - line[at + step]))


def _tips(grey: Array, body: NDArray[np.bool_], level: float) -> Array:
    columns = np.flatnonzero(body.any(axis=0))
    third = len(columns) // 3
    chosen = columns[third : len(columns) - third]
    return np.array(
        [_cross(grey[:, c], int(np.flatnonzero(body[:, c])[-1]), 1, level) for c in chosen if body[:, c].any()]
    )


def _profile(picture: Picture, row: int, band_px: int) -> Array:
    first = row - band_px // 2
    if first < 0 or first + band_px > picture.shape[0] or band_px < 1:
        raise BadInput("row", f"{row} with {band_px} rows", f"expected it inside the picture's {picture.shape[0]}")
    return np.asarray(picture[first : first + band_px].mean(axis=0), np.float64)


def _half(profile: Array) -> float:
    low, high = float(profile.min()), float(profile.max())
    if high - low < LEAST_CONTRAST:
        raise NoMarker(f"the row's contrast is {high - low:.1f} grey")
    return (low + high) / 2


def _lines(profile: Array) -> Array:
    """Return the grey-weighted middles of a scale's dark lines, left to right; cut ones left out."""
    dark = profile < _half(profile)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], dark, [False]]).astype(int)))
    paper, found = float(np.median(profile[~dark])), []
    for start, end in edges.reshape(-1, 2):
        low, high = max(0, start - 2), min(len(profile), end + 2)
        if start > 0 and end < len(profile):
            weight = np.maximum(0.0, paper - profile[low:high])
            found.append(float(weight @ np.arange(low, high) / weight.sum()))
    return np.array(found)
