"""The synthetic camera: pictures of a marker at a pose known exactly, each pixel an exact area integral.

A pixel is the mean over its square of the scene blurred by a Gaussian, that is the integral over
each polygon of k(x) k(y), k a box convolved with a Gaussian. By Green's theorem this is the sum
over the polygon's edges of the integral of K(x) k(y) dy, K the antiderivative of k: smooth
integrals over lines, done by Gauss-Legendre to about 1e-7 of the contrast. No bitmap is turned.
"""

import math
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from data.options import option
from data.signal import Array
from vision.pattern import BLOBS, MIDDLE, SQUARES, Marker, cut, shapes
from vision.plane import picture_from_plane, to_picture

REACH = 5.5  # blurs beyond which an edge does nothing: the normal tail there is 2e-8
PIECE = 1.5  # blurs that one quadrature piece spans
NODES, WEIGHTS = (np.asarray(part) for part in np.polynomial.legendre.leggauss(5))


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
            self.angle_rad + share * self.spin_rad,
            self.tilt_rad,
            self.tilt_axis_rad,
            MIDDLE,
            np.asarray(self.middle_px) + share * np.asarray(self.motion_px),
            self.pitch_px,
            self.focal_px,
            self.principal_px,
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
            _cover(
                _edges(to_picture(homography, polygon)), shot.blur_px, contrast * amount * weight, ink, NODES, WEIGHTS
            )
    for polygon, grey in shot.patches:
        _cover(_edges(polygon), shot.blur_px, grey, ink, NODES, WEIGHTS)
    _sum_from_the_right(ink)
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


@njit(cache=True)
def _rise(x: float, blur: float) -> float:
    """Return the integral up to x of a unit box convolved with a Gaussian: z F(z) + f(z), twice."""
    a, b = (x + 0.5) / blur, (x - 0.5) / blur
    cdf_a, cdf_b = 0.5 * math.erfc(-a * 0.7071067811865476), 0.5 * math.erfc(-b * 0.7071067811865476)
    bell = 0.3989422804014327 * (math.exp(-0.5 * a * a) - math.exp(-0.5 * b * b))
    return blur * (a * cdf_a - b * cdf_b + bell)


@njit(cache=True)
def _cover(edges: Array, blur: float, weight: float, out: Array, nodes: Array, weights: Array) -> None:
    """Add a polygon's edges to `out`, whose rows are then summed from the right.

    A pixel left of an edge gets the edge's whole share of the row, one right of it nothing, one
    near it the integral over the edge of K(x) k(y) dy. The share is stored at the last pixel that
    gets it all; what is near is stored as differences.
    """
    height, width = out.shape
    reach = 0.5 + REACH * blur
    for e in range(edges.shape[0]):
        x0, y0, x1, y1 = edges[e]
        sign = weight
        if y1 < y0:
            x0, y0, x1, y1, sign = x1, y1, x0, y0, -weight
        if y1 - y0 < 1e-12:
            continue
        tilt = (x1 - x0) / (y1 - y0)
        for row in range(max(0, math.ceil(y0 - reach)), min(height - 1, math.floor(y1 + reach)) + 1):
            low, high = max(y0, row - reach), min(y1, row + reach)
            if high <= low:
                continue
            pieces = 1 + int((high - low) * math.sqrt(1 + tilt * tilt) / (PIECE * blur))
            count = pieces * nodes.shape[0]
            xs, amounts = np.empty(count), np.empty(count)
            total, step = 0.0, (high - low) / pieces
            for k in range(count):
                j = k if tilt >= 0 else count - 1 - k  # nodes in the order of growing x
                piece, node = j // nodes.shape[0], j % nodes.shape[0]
                y = low + step * (piece + 0.5 + 0.5 * nodes[node])
                a, b = (y - row + 0.5) / blur, (y - row - 0.5) / blur
                k_y = 0.5 * (math.erfc(-a * 0.7071067811865476) - math.erfc(-b * 0.7071067811865476))
                xs[k] = x0 + tilt * (y - y0)
                amounts[k] = sign * 0.5 * step * weights[node] * k_y
                total += amounts[k]
            first = max(0, math.ceil(xs[0] - reach))
            last = min(width - 1, math.floor(xs[count - 1] + reach))
            if first > 0:
                out[row, min(first, width) - 1] += total
            for column in range(first, last + 1):
                value = _near(xs, amounts, column, blur, reach)
                out[row, column] += value
                if column > 0:
                    out[row, column - 1] -= value


@njit(cache=True)
def _near(xs: Array, amounts: Array, column: int, blur: float, reach: float) -> float:
    """Return the sum over an edge's nodes of amount times K(x - column)."""
    value = 0.0
    for k in range(xs.shape[0] - 1, -1, -1):
        x = xs[k] - column
        if x < -reach:
            break
        value += amounts[k] * (1.0 if x > reach else _rise(x, blur))
    return value


@njit(cache=True)
def _sum_from_the_right(out: Array) -> None:
    for row in range(out.shape[0]):
        for column in range(out.shape[1] - 2, -1, -1):
            out[row, column] += out[row, column + 1]
