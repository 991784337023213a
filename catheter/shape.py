"""A hollow actuator between two shapes, its wall exactly as incompressible as its material.

Places in the wall: u the distance from the centreline in the initial shape, v the angle from N1,
w along it (thesis 4.4). Both shapes are written in rotation-minimising frames of their own
centrelines. With the speed s = |dc/dw| and the bending b = p1 cos(angle) + p2 sin(angle) (see
catheter.curve.Along), the volume of du dv dw at distance h and shear gamma(v, w) is

    h (s - h b) dh (1 + dgamma/dv) dv dw.

Equal volume from the bore to u is a cubic in h at every (v, w), and h and gamma do not change the
frame's part of the gradient: its determinant is the product above, whatever dh/dv, dh/dw and
dgamma/dw. Where gamma depends on u the determinant has one more term, -h dgamma/du dh/dv, and
the wall is incompressible only as far as `Wall.volume_ratio` says.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from catheter.curve import Along, Blend, Curve
from catheter.equal_volume import Number, distance, moment, smallest_bend
from catheter.frames import rotation_minimising
from data.errors import BadInput
from data.signal import Array

STEP = 1e-100  # of complex-step derivatives: no difference is taken, so it may be as small as a float


@dataclass(frozen=True, eq=False)
class Slopes:
    """A field over (v, w) with its slopes along both: each (V, W)."""

    value: Array
    by_v: Array
    by_w: Array


@dataclass(frozen=True, eq=False)
class Shear:
    """gamma (V, W) [rad] of the final shape, slopes, second slopes by v, and how much turns by u [rad/m]."""

    gamma: Slopes
    slope: Slopes
    through: float = 0.0


@dataclass(frozen=True, eq=False)
class Centre:
    """A configuration's centreline at stations: speed and bending towards angles (V, W), and where it lies."""

    along: Along

    @property
    def speed(self) -> Slopes:
        """s (1, W)."""
        s = self.along.speed
        return Slopes(s[0][None], np.zeros_like(s[0])[None], s[1][None])

    def bending(self, angle: Slopes) -> Slopes:
        """Return b at angles (V, W) and its slopes."""
        p1, p2 = self.along.bends
        cos, sin = np.cos(angle.value), np.sin(angle.value)
        around = p2[0] * cos - p1[0] * sin
        return Slopes(p1[0] * cos + p2[0] * sin, angle.by_v * around, p1[1] * cos + p2[1] * sin + angle.by_w * around)


@dataclass(frozen=True, kw_only=True, eq=False)
class Shape:
    """What an actuator is (q = 0) and is to become (q = 1); lengths in m, w from 0 to length.

    shear and lumen of the final shape as functions of v (V, 1) and w (1, W): the bore starts as
    `inner` everywhere and is the designer's choice, the outer wall follows. lumen_is_outside: lumen
    gives the outer wall instead, and the bore follows. seed: N1 of both at w = 0, by default the
    axis least along the initial tangent.
    """

    initial: Curve
    final: Curve
    length: float
    inner: float
    outer: float
    shear: Callable[[Array, Array], Shear]
    lumen: Callable[[Array, Array], Slopes]
    lumen_is_outside: bool = False
    seed: Array | None = None

    def centre(self, q: float, w: Array) -> Centre:
        """Return the centreline at q and ascending stations w (W,)."""
        curve = Blend(self.initial, self.final, q) if q else self.initial
        return Centre(Along(curve(w, 3), rotation_minimising(curve, w, self.seed).normal))

    def wall(self, q: float, u: Array, v: Array, w: Array) -> "Wall":
        """Return the wall at q at distances u (U,), angles v (V,) and ascending stations w (W,).

        Raises BadInput for a fold, with its place and the smallest bend radius that it could have.
        """
        if not 0 <= q <= 1:
            raise BadInput("q", f"is {q}", "expected 0 to 1")
        if not 0 < self.inner < self.outer:
            raise BadInput("actuator", f"has radii {self.inner:g} and {self.outer:g} m", "expected 0 < inner < outer")
        return Wall(self, q, u, v, w)


@dataclass(frozen=True, eq=False)
class Wall:
    """Places of the wall at one q: arrays (V, W, U), as fem numbers a lattice (around, along, through)."""

    shape: Shape
    q: float
    u: Array
    v: Array
    w: Array

    def __post_init__(self) -> None:
        """Refuse folds before anything is asked."""
        self._refuse_folds()

    @cached_property
    def rest(self) -> Centre:
        """The initial centreline."""
        return self.shape.centre(0.0, self.w)

    @cached_property
    def centre(self) -> Centre:
        """The centreline at q."""
        return self.shape.centre(self.q, self.w)

    @cached_property
    def _shear(self) -> Shear:
        return self.shape.shear(self.v[:, None], self.w[None])

    @cached_property
    def angle(self) -> Slopes:
        """v + q gamma at the bore, and its slopes (V, W)."""
        full, v = self._shear.gamma, self.v[:, None]
        return Slopes(v + self.q * full.value, 1 + self.q * full.by_v + 0 * full.value, self.q * full.by_w)

    @cached_property
    def bore(self) -> Slopes:
        """Distance of the bore from the centreline (V, W) [m]: linear in q."""
        full, q = self._final_bore, self.q
        return Slopes((1 - q) * self.shape.inner + q * full.value, q * full.by_v, q * full.by_w)

    @cached_property
    def _final_bore(self) -> Slopes:
        given = self.shape.lumen(self.v[:, None], self.w[None])
        if not self.shape.lumen_is_outside:
            return given
        if self.q != 1:
            return Wall(self.shape, 1.0, self.u, self.v, self.w).bore
        outer = np.array([self.shape.outer])
        ways = [self._outward(outer, way, given, -1.0)[..., 0] for way in (0, 1, 2)]
        zero = np.zeros((len(self.v), len(self.w)))
        if not np.isfinite(ways[0]).all():
            raise BadInput("balloon", "leaves no bore in the wall", "a larger fit, or a thinner wall")
        return Slopes(np.real(ways[0]) + zero, *(np.imag(way) / STEP + zero for way in ways[1:]))

    @cached_property
    def parts(self) -> list[Slopes]:
        """s0, b0, s, b and 1 + dgamma/dv: what the cubic is made of, beside where it starts."""
        v = self.v[:, None] + 0 * self.w
        plain = Slopes(v, np.ones_like(v), np.zeros_like(v))
        slope, q = self._shear.slope, self.q
        stretch = Slopes(1 + q * slope.value, q * slope.by_v, q * slope.by_w)
        bends = self.rest.bending(plain), self.centre.bending(self.angle)
        return [self.rest.speed, bends[0], self.centre.speed, bends[1], stretch]

    def _outward(self, u: Number, way: int, start: Slopes, sign: float = 1.0) -> Number:
        """Return the distance at which the wall from inner to u has its volume, seen from `start`.

        sign -1: inwards of start. way 1 or 2 carries a complex step along v or w, 0 none.
        """
        ways = [(p.value, p.by_v, p.by_w) for p in (*self.parts, start)]
        s0, b0, s, b, stretch, begin = ((x[0] + 1j * STEP * x[way] if way else x[0])[..., None] for x in ways)
        rest = moment(u, s0, b0) - moment(np.asarray(self.shape.inner), s0, b0)
        return distance(moment(begin, s, b) + sign * rest / stretch, s, b)

    @cached_property
    def h(self) -> Array:
        """Distance from the centreline (V, W, U) [m], from the closed form."""
        return np.asarray(self._outward(self.u, 0, self.bore) + np.zeros((len(self.v), len(self.w), 1)))

    @cached_property
    def _h_slopes(self) -> tuple[Array, Array, Array]:
        """dh/du, dh/dv, dh/dw of the closed form itself, by complex steps."""
        by_u = self._outward(self.u + 1j * STEP, 0, self.bore)
        return (
            np.imag(by_u) / STEP + 0 * self.h,
            np.imag(self._outward(self.u, 1, self.bore)) / STEP,
            np.imag(self._outward(self.u, 2, self.bore)) / STEP,
        )

    @cached_property
    def _turned(self) -> Array:
        """The angle at every place (V, W, U)."""
        return self.angle.value[..., None] + self.q * self._shear.through * (self.u - self.shape.inner)

    @cached_property
    def positions(self) -> Array:
        """Positions (V, W, U, 3) [m] (thesis eq. 4.17)."""
        along = self.centre.along
        out = np.cos(self._turned)[..., None] * along.normal[0][:, None]
        out = out + np.sin(self._turned)[..., None] * along.binormal[0][:, None]
        return np.asarray(along.curve[0][:, None] + self.h[..., None] * out)

    @cached_property
    def gradient(self) -> Array:
        """Deformation gradients (V, W, U, 3, 3): columns radial, around, along at rest; rows the same at q."""
        by_u, by_v, by_w = self._h_slopes
        turned = self._turned
        here = Slopes(turned, np.zeros_like(turned), np.zeros_like(turned))
        p1, p2 = (p[0][:, None] for p in self.centre.along.bends)
        along = self.centre.along.speed[0][:, None] - self.h * (p1 * np.cos(here.value) + p2 * np.sin(here.value))
        s0, b0 = (p.value[..., None] for p in self.parts[:2])
        around, rest = self.u, s0 - self.u * b0
        F = np.zeros((*self.h.shape, 3, 3))
        F[..., 0, 0], F[..., 1, 0] = by_u, self.h * self.q * self._shear.through
        F[..., 0, 1], F[..., 1, 1] = by_v / around, self.h * self.angle.by_v[..., None] / around
        F[..., 0, 2], F[..., 1, 2] = by_w / rest, self.h * self.angle.by_w[..., None] / rest
        F[..., 2, 2] = along / rest
        return F

    @property
    def volume_ratio(self) -> Array:
        """det F (V, W, U)."""
        return np.asarray(np.linalg.det(self.gradient))

    @property
    def strain(self) -> Array:
        """Lagrangian strain (V, W, U, 3, 3) in the radial, around, along directions at rest."""
        F = self.gradient
        return np.asarray((np.swapaxes(F, -1, -2) @ F - np.eye(3)) / 2)

    def _refuse_folds(self) -> None:
        outer = np.array([self.shape.outer])
        s0, b0, s, b, stretch, bore = (p.value for p in (*self.parts, self.bore))
        rest = (moment(outer, s0, b0) - moment(np.asarray(self.shape.inner), s0, b0)) / np.where(
            stretch > 0, stretch, 1
        )
        least = smallest_bend(bore, rest / s)
        tests = (
            ("the shear turns faster than the angle around", stretch + 0 * b, None),
            ("the bore has no width", bore + 0 * b, None),
            ("the initial shape folds", s0 - outer * b0, smallest_bend(outer, 0 * s0) + 0 * b0),
            ("the shape folds", 1 - b / s * least, least),
        )
        for what, room, allowed in tests:
            if (room > 0).all():
                continue
            i, j = np.unravel_index(int(np.argmin(np.where(np.isnan(room), -np.inf, room))), room.shape)
            place = f"q = {self.q:g}, v = {np.degrees(self.v[i]):.4g} deg, w = {1e3 * self.w[j]:.4g} mm"
            if allowed is None:
                raise BadInput(place, what, "make the shear's wave or the change of the bore smaller")
            speed, bend = (s0, b0) if what.startswith("the initial") else (s, b)
            radius = float(speed[0, j] / bend[i, j])
            found = f"{what}: its bend radius is {1e3 * radius:.4g} mm there"
            raise BadInput(place, found, f"the smallest allowed is {1e3 * float(allowed[i, j]):.4g} mm for this wall")
