"""The synthetic camera: pictures of a marker at a pose known exactly, each pixel an exact area integral.

A pixel is the mean over its square of the scene blurred by a Gaussian, that is the integral over
each polygon of k(x) k(y), k a box convolved with a Gaussian. By Green's theorem this is the sum
over the polygon's edges of the integral of K(x) k(y) dy, K the antiderivative of k: smooth
integrals over lines, done by Gauss-Legendre to about 1e-7 of the contrast. No bitmap is turned.
"""

import math
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

from data.options import option
from data.signal import Array
from vision.pattern import BLOBS, MIDDLE, SQUARES, Marker, cut, shapes
from vision.plane import picture_from_plane, to_picture
from vision.render_kernel import cover, sum_from_the_right


@dataclass(frozen=True, kw_only=True)
class Shot:
    """A picture to be taken: marker, pose, optics, light and noise. Grey levels run from 0 to 255.

    middle_px: where the card's middle is seen. tilt about an axis in the picture's plane.
    blur_px: the Gaussian's standard deviation. motion_px, spin_rad: how far the marker moves and
    turns while the shutter is open; the pose is that of mid-exposure. ramp: relative change of
    light per picture width and height. glare: x, y, radius [px], peak [grey] of added light.
    patches: further polygons (n, 2) [px] with the grey they add. cut: number of a blob, direction
    [rad] and share of its area taken off. layout: polygons and ink in place of the marker's own.
    """

    marker: Marker = SQUARES
    size: float = 0.4
    width_px: int = 640
    height_px: int = 480
    angle_rad: float = 0.0
    middle_px: tuple[float, float] = (319.5, 239.5)
    pitch_px: float = option(200 / 1.4, least=1.0)
    tilt_rad: float = 0.0
    tilt_axis_rad: float = 0.0
    focal_px: float = 800.0
    blur_px: float = option(0.7, least=0.1)
    card_grey: float = 220.0
    ink_grey: float = 40.0
    ramp: tuple[float, float] = (0.0, 0.0)
    glare: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 0.0)
    motion_px: tuple[float, float] = (0.0, 0.0)
    spin_rad: float = 0.0
    noise_grey: float = 0.0
    patches: tuple[tuple[Array, float], ...] = ()
    cut: tuple[int, float, float] | None = None
    layout: tuple[tuple[Array, float], ...] = field(default=())

    @property
    def principal_px(self) -> Array:
        """The picture's middle, where the optical axis meets it."""
        return np.array([(self.width_px - 1) / 2, (self.height_px - 1) / 2])

    def homography(self, share: float = 0.0) -> Array:
        """Return picture from plane, (3, 3), at a share (-0.5 to 0.5) of the exposure from its middle."""
        return picture_from_plane(
            angle_rad=self.angle_rad + share * self.spin_rad,
            tilt_rad=self.tilt_rad,
            tilt_axis_rad=self.tilt_axis_rad,
            origin=MIDDLE,
            origin_px=np.asarray(self.middle_px) + share * np.asarray(self.motion_px),
            pitch_px=self.pitch_px,
            focal_px=self.focal_px,
            principal_px=self.principal_px,
        )

    def blobs_px(self) -> Array:
        """Return where the blobs' middles are seen, (3, 2): corner, second, third."""
        return to_picture(self.homography(), BLOBS)


def exact(shot: Shot) -> Array:
    """Return the picture before noise and rounding, (height, width) in grey levels."""
    ink = np.zeros((shot.height_px, shot.width_px))
    contrast = shot.ink_grey - shot.card_grey
    for share, weight in _exposure(shot):
        homography = shot.homography(share)
        for polygon, amount in _layout(shot):
            cover(_edges(to_picture(homography, polygon)), shot.blur_px, contrast * amount * weight, ink)
    for polygon, grey in shot.patches:
        cover(_edges(polygon), shot.blur_px, grey, ink)
    sum_from_the_right(ink)
    return _light(shot, ink + shot.card_grey)


def render(shot: Shot, seed: int | np.random.Generator = 0) -> NDArray[np.uint8]:
    """Return the picture as a camera gives it: noise added, rounded, cut to 0 to 255; (height, width)."""
    picture = exact(shot)
    if shot.noise_grey:
        picture += shot.noise_grey * np.random.default_rng(seed).standard_normal(picture.shape)
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


NUISANCES = ("x", "y", "pitch_px", "size", "blur_px", "card_grey", "ink_grey")


def angle_bound_rad(shot: Shot, nuisances: tuple[str, ...] = NUISANCES, noise_grey: float | None = None) -> float:
    """Return the Cramer-Rao bound of the angle's standard deviation, other parameters unknown.

    The Fisher information is J'J / noise^2, J the picture's derivatives by central differences of
    the renderer itself. noise_grey: the shot's own when None; rounding to whole grey levels adds
    1/12 to its square.
    """
    noise = math.hypot(shot.noise_grey if noise_grey is None else noise_grey, math.sqrt(1 / 12))
    slopes = np.stack([slope(shot, name).ravel() for name in ("angle_rad", *nuisances)])
    scale = np.linalg.norm(slopes, axis=1)
    information = (slopes / scale[:, None]) @ (slopes / scale[:, None]).T
    return float(noise * math.sqrt(np.linalg.inv(information)[0, 0]) / scale[0])


def slope(shot: Shot, name: str, step: float = 1e-3) -> Array:
    """Return the exact picture's derivative by one parameter, (height, width), by a central difference.

    name: a number of `Shot`, or x or y of its middle. step: relative to the parameter's own size,
    1e-3 of it in general; the error is of its square.
    """
    known = {f.name for f in fields(shot)}
    if name in ("x", "y"):
        value, size = float(shot.middle_px["xy".index(name)]), 10.0
    else:
        assert name in known
        value = float(getattr(shot, name))
        size = {"angle_rad": 0.1, "tilt_rad": 0.1}.get(name, abs(value) or 1.0)

    def moved(amount: float) -> Array:
        if name == "x":
            return exact(replace(shot, middle_px=(value + amount, shot.middle_px[1])))
        if name == "y":
            return exact(replace(shot, middle_px=(shot.middle_px[0], value + amount)))
        return exact(replace(shot, **{name: value + amount}))  # type: ignore[arg-type]

    return np.asarray((moved(step * size) - moved(-step * size)) / (2 * step * size))


def _layout(shot: Shot) -> list[tuple[Array, float]]:
    polygons = list(shot.layout) or shapes(shot.marker, shot.size)
    if shot.cut is None:
        return polygons
    blob, direction_rad, share = shot.cut
    first = blob * len(shot.marker.rings)
    towards = np.array([math.cos(direction_rad), math.sin(direction_rad)])
    return [(cut(p, towards, share) if i == first else p, ink) for i, (p, ink) in enumerate(polygons)]


def _exposure(shot: Shot) -> list[tuple[float, float]]:
    """Return moments of the exposure (-0.5 to 0.5) and their weights, close enough for the blur."""
    path = math.hypot(*shot.motion_px) + abs(shot.spin_rad) * shot.pitch_px
    if path == 0:
        return [(0.0, 1.0)]
    nodes, weights = np.polynomial.legendre.leggauss(3 + math.ceil(1.3 * path / shot.blur_px))
    return [(float(node) / 2, float(weight) / 2) for node, weight in zip(nodes, weights, strict=True)]


def _light(shot: Shot, picture: Array) -> Array:
    x, y = np.arange(shot.width_px)[None, :], np.arange(shot.height_px)[:, None]
    if any(shot.ramp):
        middle = shot.principal_px
        picture = picture * (
            1 + shot.ramp[0] * (x - middle[0]) / shot.width_px + shot.ramp[1] * (y - middle[1]) / shot.height_px
        )
    left, top, radius, peak = shot.glare
    if peak:
        picture = picture + peak * np.exp(-((x - left) ** 2 + (y - top) ** 2) / (2 * radius**2))
    return picture


def _edges(polygon: Array) -> Array:
    return np.ascontiguousarray(np.hstack([polygon, np.roll(polygon, -1, axis=0)]))
