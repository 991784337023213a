"""Twist against time: a marker followed from frame to frame, turns counted, gaps kept as gaps."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput
from data.signal import Array
from vision.fit import MarkerFit, NoMarker, Picture
from vision.frames import Frame
from vision.marker import find, follow
from vision.pattern import SQUARES, Marker
from vision.plane import to_picture

OK, MISSING, SMOOTHED = "ok", "missing", "smoothed"


@dataclass(frozen=True)
class Row:
    """What one frame gave: the marker's angle in (-pi, pi] and its standard deviation, or NaN and the reason.

    fit: all that was found, None in a row read back from a file or without a marker. followed:
    found near the last place rather than by searching the whole frame.
    """

    number: int
    time_s: float
    angle_rad: float
    sigma_rad: float
    reason: str = ""
    name: str = ""
    fit: MarkerFit | None = None
    followed: bool = False

    @property
    def status(self) -> str:
        """'ok' or 'missing'."""
        return MISSING if math.isnan(self.angle_rad) else OK


class Tracker:
    """Finds a marker in frame after frame: near where it moves to first, in the whole frame when that fails."""

    def __init__(self, marker: Marker = SQUARES, principal_px: Array | None = None) -> None:
        self.marker, self._principal_px = marker, principal_px
        self._last: MarkerFit | None = None
        self._step_px: Array = np.zeros((3, 2))
        self._size: tuple[int, ...] = ()

    def locate(self, picture: Picture) -> tuple[MarkerFit, bool]:
        """Return the marker and whether it was followed. Raises NoMarker, and then forgets where it was."""
        if picture.shape != self._size:
            self._last, self._size = None, picture.shape
        principal_px = (np.array(picture.shape[::-1]) - 1) / 2 if self._principal_px is None else self._principal_px
        before, self._last = self._last, None
        if before is not None:
            try:
                found = follow(picture, before, before.blobs_px + self._step_px, self.marker, principal_px)
            except NoMarker:  # it moved otherwise than expected, or is gone: the whole frame decides
                self._step_px = np.zeros((3, 2))
            else:
                self._step_px = found.blobs_px - before.blobs_px
                self._last = found
                return found, True
        found = find(picture, self.marker, principal_px)
        self._last, self._step_px = found, np.zeros((3, 2))
        return found, False


def rows(frames: Iterable[Frame], tracker: Tracker) -> Iterator[Row]:
    """Yield a row for every frame, with a marker or without."""
    for frame in frames:
        if frame.picture is None:
            yield Row(frame.number, frame.time_s, math.nan, math.nan, frame.fault, frame.name)
            continue
        try:
            found, followed = tracker.locate(frame.picture)
        except NoMarker as error:
            yield Row(frame.number, frame.time_s, math.nan, math.nan, str(error), frame.name)
        else:
            angle, sigma = found.angle_rad, found.sigma_rad
            yield Row(frame.number, frame.time_s, angle, sigma, "", frame.name, found, followed)


@dataclass(frozen=True, kw_only=True)
class Twist:
    """Twist against time, (n,) each: seconds, radians relative to a frame, standard deviation, status.

    angle_rad counts turns and is NaN where no marker was found. reference: number of the frame
    whose angle is zero. doubtful: numbers of frames before which the marker may have turned by
    half a turn or more unseen: the step from the last one seen, or twice the step before it for
    as long as it was not seen, is over 90 degrees.
    """

    time_s: Array
    angle_rad: Array
    sigma_rad: Array
    status: tuple[str, ...]
    reference: int
    doubtful: tuple[int, ...]


def assemble(found: Sequence[Row], reference: int | None = None) -> Twist:
    """Return rows as one twist, turns unwrapped across gaps, zero at the first or a named frame.

    Raises BadInput when the named frame has no marker.
    """
    angle = np.array([row.angle_rad for row in found], dtype=np.float64)
    seen = np.flatnonzero(~np.isnan(angle))
    angle[seen] = np.unwrap(angle[seen])
    numbers = [row.number for row in found]
    zero = int(seen[0]) if seen.size else 0
    if reference is not None:
        if reference not in numbers or math.isnan(angle[numbers.index(reference)]):
            raise BadInput("reference frame", f"{reference} has no marker", "name a frame that has one")
        zero = numbers.index(reference)
    if seen.size:
        angle = angle - angle[zero]
    return Twist(
        time_s=np.array([row.time_s for row in found]),
        angle_rad=angle,
        sigma_rad=np.array([row.sigma_rad for row in found]),
        status=tuple(row.status for row in found),
        reference=numbers[zero] if numbers else 0,
        doubtful=tuple(numbers[seen[i + 1]] for i in _doubtful(seen, angle[seen])),
    )


def _doubtful(seen: NDArray[np.intp], angle: Array) -> list[int]:
    steps, gaps = np.abs(np.diff(angle)), np.diff(seen)
    rate = np.concatenate([[0.0], steps[:-1] / np.maximum(1, gaps[:-1])]) if len(steps) else steps
    return [int(i) for i in np.flatnonzero((steps > np.pi / 2) | ((gaps > 1) & (2 * rate * gaps > np.pi / 2)))]


def smooth(twist: Twist, acceleration_rad_s2: float) -> Twist:
    """Return a twist smoothed forwards and backwards by a constant-velocity model (Rauch-Tung-Striebel).

    acceleration_rad_s2: standard deviation of the acceleration that the model allows, white from
    frame to frame. A gap between two frames with a marker is filled, with its larger standard
    deviation and the status "smoothed"; before the first and after the last one stays NaN.
    """
    from filterpy.common import Q_discrete_white_noise
    from filterpy.kalman import KalmanFilter

    if not acceleration_rad_s2 > 0:
        raise BadInput("smoothing", f"acceleration {acceleration_rad_s2}", "expected rad/s^2 above zero")
    seen = np.flatnonzero(~np.isnan(twist.angle_rad))
    if len(seen) < 2:
        return twist
    inside = slice(int(seen[0]), int(seen[-1]) + 1)
    time_s, angle, sigma = (part[inside] for part in (twist.time_s, twist.angle_rad, twist.sigma_rad))
    steps = np.diff(time_s, prepend=time_s[0])
    model = KalmanFilter(dim_x=2, dim_z=1)
    model.H = np.array([[1.0, 0.0]])
    model.x = np.array([[angle[0]], [0.0]])
    # wide open: the first angle is an observation as any other
    model.P = np.diag([(1e4 * sigma[0]) ** 2, (100 * acceleration_rad_s2) ** 2])
    forward, noise = [], []
    for step, value, deviation in zip(steps, angle, sigma, strict=True):
        model.F = np.array([[1.0, step], [0.0, 1.0]])
        model.Q = Q_discrete_white_noise(2, dt=step, var=acceleration_rad_s2**2)
        model.predict()
        model.update(None if np.isnan(value) else value, R=None if np.isnan(value) else deviation**2)
        forward.append((model.x.copy(), model.P.copy()))
        noise.append((model.F.copy(), model.Q.copy()))
    states, spreads = (np.array(part) for part in zip(*forward, strict=True))
    # filterpy moves from k to k+1 with entry k + 1
    smoothed, covariance, *_ = model.rts_smoother(states, spreads, [f for f, _ in noise], [q for _, q in noise])
    angles, sigmas, status = twist.angle_rad.copy(), twist.sigma_rad.copy(), list(twist.status)
    angles[inside], sigmas[inside] = smoothed[:, 0, 0], np.sqrt(covariance[:, 0, 0])
    status[inside] = [SMOOTHED if np.isnan(value) else OK for value in angle]
    return replace(twist, angle_rad=angles, sigma_rad=sigmas, status=tuple(status))


def region_px(found: MarkerFit) -> tuple[float, float, float, float]:
    """Return x, y, width, height [px] of where the next frame's marker is looked for first."""
    reach = found.size / 2 + 0.2
    corners = np.array([[-reach, -reach], [1 + reach, -reach], [1 + reach, 1 + reach], [-reach, 1 + reach]])
    seen = to_picture(found.homography, corners)
    low, high = seen.min(axis=0), seen.max(axis=0)
    return float(low[0]), float(low[1]), float(high[0] - low[0]), float(high[1] - low[1])
