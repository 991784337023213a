"""Where the marker is: all of its pixels fitted at once, and the checks that let a frame be believed."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.errors import CatheterError
from data.signal import Array
from vision.fit_kernel import BAD_INSIDE, BAD_OUTSIDE, CENTRE, INSIDE, OUTSIDE, gauss_newton
from vision.pattern import BLOBS, Marker
from vision.plane import angle_slope, plane_angle_rad, to_picture

Picture = NDArray[np.uint8] | NDArray[np.uint16]

MOST_STEPS = 20
SHARP_PX = 0.3  # of blur: a narrower one is felt by no pixel, and the fit loses its way
SMALL_STEP = 0.3  # standard deviations: the step after it would be some hundredths
LEAST_CONTRAST = 4.5  # noises: below it a cut blob cannot be told from noise
LEAST_BLOB_PX = 5.0
FLATTEST = 0.55  # length of the marker's shorter axis over the longer: a tilt of 57 degrees
ENTRIES = ((0, 2), (1, 2), (0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1))  # a step's places in the homography
COVERED = {"squares": (0.05, 0.15), "qr": (0.12, 0.2)}  # most share of unlike pixels inside and outside


class NoMarker(CatheterError):
    """A picture in which no marker can be vouched for; the message says why."""


class TooSharp(NoMarker):
    """Edges between one pixel and the next, as a program draws them, say nothing of where between they lie."""


@dataclass(frozen=True, kw_only=True)
class Start:
    """Where a fit begins: homography (3, 3), half side and blurs (3,) in pitches, grey steeper (2,), light (3, 4)."""

    homography: Array
    shape: Array
    steeper: Array
    light: Array


@dataclass(frozen=True, kw_only=True)
class MarkerFit:
    """A marker found in one picture.

    homography: picture from marker, (3, 3). angle_rad: of the marker in its own plane, with its
    standard deviation sigma_rad from the noise and the information of all its pixels.
    blobs_px: (3, 2) centres of corner, second, third. size: a blob's side over the pitch. blur:
    along the marker's axes, in pitches. noise_grey: root mean square of the residuals near edges.
    light (3, 4) and steeper (2,): the light's parameters, see `fit_kernel`. steps: of Gauss-Newton.
    """

    homography: Array
    angle_rad: float
    sigma_rad: float
    blobs_px: Array
    size: float
    blur: Array
    noise_grey: float
    light: Array
    steeper: Array
    steps: int

    @property
    def pitch_px(self) -> float:
        """The legs' mean length in the picture."""
        return float(np.hypot(*(self.blobs_px[1:] - self.blobs_px[0]).T).mean())

    @property
    def start(self) -> Start:
        """These values as the beginning of another fit."""
        shape = np.array([self.size / 2, *self.blur])
        return Start(homography=self.homography, shape=shape, steeper=self.steeper, light=self.light)


def fit(picture: Picture, start: Start, marker: Marker, principal_px: Array | None = None) -> MarkerFit:
    """Return the least-squares fit of the whole marker to a grey picture, checked.

    principal_px: where the optical axis meets the picture, its middle by default; it matters for
    tilted markers alone. Raises NoMarker when the fit does not settle or what it settled on is not
    this marker, whole and within the picture; TooSharp for a blur of less than 0.3 px.
    """
    homography, shape = start.homography.copy(), start.shape.copy()
    steeper, light = start.steeper.copy(), start.light.copy()
    bin_grey = 0.25 if picture.dtype == np.uint8 else 64.0
    try:
        steps, information, counts, noise = gauss_newton(
            picture, homography, shape, steeper, light, marker.rings, MOST_STEPS, SMALL_STEP, bin_grey
        )
        _check_blur(homography, shape)
        if steps == 0 or steps > MOST_STEPS:
            raise NoMarker("the fit did not settle")
        covariance = np.asarray(noise**2 * np.linalg.inv(information)[:8, :8], np.float64)
    except np.linalg.LinAlgError as error:
        _check_blur(homography, shape)
        raise NoMarker("the fit is singular") from error
    if principal_px is None:
        principal_px = np.asarray((np.array(picture.shape[::-1]) - 1) / 2, np.float64)
    found = MarkerFit(
        homography=homography,
        angle_rad=plane_angle_rad(homography, principal_px),
        sigma_rad=_sigma_rad(homography, principal_px, covariance),
        blobs_px=to_picture(homography, BLOBS),
        size=2 * float(shape[0]),
        blur=shape[1:],
        noise_grey=float(noise),
        light=light,
        steeper=steeper,
        steps=steps,
    )
    _check_shape(found, picture.shape, marker, principal_px)
    _check_light(found, counts, marker)
    return found


def _check_blur(homography: Array, shape: Array) -> None:
    blur_px = float(shape[1:].min()) * math.hypot(homography[0, 0], homography[1, 0])
    if blur_px < SHARP_PX:
        raise TooSharp(f"a blur of {blur_px:.2f} px hides where between two pixels an edge lies")


def step_slopes(homography: Array, by_entry: Array) -> Array:
    """Return a slope by the homography's entries, (3, 3), as one by the eight parameters of a step."""
    centre, back = np.eye(3), np.eye(3)
    centre[:2, 2], back[:2, 2] = CENTRE, -CENTRE
    by_step = (homography @ centre).T @ by_entry @ back.T
    return np.array([by_step[entry] for entry in ENTRIES])


def _sigma_rad(homography: Array, principal_px: Array, covariance: Array) -> float:
    slopes = step_slopes(homography, angle_slope(homography, principal_px))
    return math.sqrt(float(slopes @ covariance @ slopes))


def _check_shape(found: MarkerFit, size: tuple[int, ...], marker: Marker, principal_px: Array) -> None:
    """Raise NoMarker unless the marker is of this design, not too oblique, and inside the picture."""
    if not marker.least_size <= found.size <= marker.most_size:
        raise NoMarker(f"blobs of {found.size:.3f} pitches, not {marker.least_size:g} to {marker.most_size:g}")
    block = found.homography[:2, :2] - np.outer(principal_px, found.homography[2, :2])
    axes = np.linalg.svd(block, compute_uv=False)
    if np.linalg.det(block) <= 0 or axes[1] < FLATTEST * axes[0]:
        raise NoMarker(f"its axes are {axes[0]:.0f} and {axes[1]:.0f} px: too oblique")
    if found.size * found.pitch_px < LEAST_BLOB_PX:
        raise NoMarker(f"blobs of {found.size * found.pitch_px:.1f} px are too small")
    reach = found.size / 2 + 0.5 * float(found.blur.max())
    corners = BLOBS[:, None] + reach * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    seen = to_picture(found.homography, corners.reshape(-1, 2))
    if (seen < 0).any() or (seen > np.array(size[::-1]) - 1).any():
        raise NoMarker("the picture's border cuts the marker")


def _check_light(found: MarkerFit, counts: Array, marker: Marker) -> None:
    """Raise NoMarker unless every blob stands out, as a whole, from its paper."""
    contrast = (found.light[:, 0] - found.light[:, 1]) * (-1 if marker.light else 1)
    if contrast.min() < LEAST_CONTRAST * found.noise_grey or contrast.min() < 0.2 * contrast.max():
        levels = ", ".join(f"{grey:.1f}" for grey in contrast)
        raise NoMarker(f"contrasts {levels} grey at noise {found.noise_grey:.1f}: a blob hardly stands out")
    inside = counts[:, BAD_INSIDE] / np.maximum(1, counts[:, INSIDE])
    outside = counts[:, BAD_OUTSIDE] / np.maximum(1, counts[:, OUTSIDE])
    most_inside, most_outside = COVERED[marker.pattern]
    if inside.max() > most_inside or outside.max() > most_outside:
        raise NoMarker(f"{100 * inside.max():.0f} % of a blob and {100 * outside.max():.0f} % beside one are unlike it")
