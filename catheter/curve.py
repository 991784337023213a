"""Curves by their derivatives, and the rotation-minimising frame's own derivatives along them.

A stack of derivatives holds the 0th, 1st, 2nd ... by w along its first axis; w is a length [m].
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import comb
from typing import TYPE_CHECKING, Protocol

import numpy as np

from data.signal import Array

if TYPE_CHECKING:
    from scipy.interpolate import PPoly


class Curve(Protocol):
    """A smooth curve or profile over w [m]."""

    def __call__(self, w: Array, order: int) -> Array:
        """Return the derivatives 0 to order at w (n,): (order + 1, n, 3), or (order + 1, n) of a profile."""


@dataclass(frozen=True)
class Piecewise:
    """A curve of polynomial pieces over w + start."""

    pieces: "PPoly"
    start: float = 0.0

    def __call__(self, w: Array, order: int) -> Array:
        """Return the derivatives."""
        return np.asarray(np.stack([self.pieces(w + self.start, k) for k in range(order + 1)]))


def line(origin: Array, direction: Array) -> Piecewise:
    """Return the straight line from an origin (3,) along a unit vector (3,)."""
    from scipy.interpolate import PPoly

    return Piecewise(PPoly(np.stack([direction, origin])[:, None, :], np.array([0.0, 1.0])))


@dataclass(frozen=True)
class Blend:
    """(1 - q) first + q second (thesis eq. 4.7)."""

    first: Curve
    second: Curve
    q: float

    def __call__(self, w: Array, order: int) -> Array:
        """Return the derivatives."""
        return (1 - self.q) * self.first(w, order) + self.q * self.second(w, order)


@dataclass(frozen=True, eq=False)
class Offset:
    """A curve carried along another in its rotation-minimising frame: c + x N1 + y N2 + z T (thesis eq. 4.4).

    offsets(w) returns the derivatives 0 to 3 of x, y, z: (4, n, 3). Its own derivatives end at the third.
    """

    base: Curve
    offsets: Callable[[Array], Array]
    normals: Callable[[Array], Array]  # N1 of the base at w: (n, 3)

    def __call__(self, w: Array, order: int) -> Array:
        """Return the derivatives, at most the third."""
        along = Along(self.base(w, 4), self.normals(w))
        frame = np.stack([along.normal, along.binormal, along.tangent], axis=2)  # (4, n, 3 of xyz, 3)
        moved = product(self.offsets(w)[..., None], frame).sum(axis=2)
        return np.asarray(along.curve[: order + 1] + moved[: order + 1])


def product(a: Array, b: Array) -> Array:
    """Return the stack of derivatives of a product from those of its factors (Leibniz)."""
    order = min(len(a), len(b))
    return np.stack([sum(comb(k, j) * a[j] * b[k - j] for j in range(k + 1)) for k in range(order)])


@dataclass(frozen=True, eq=False)
class Along:
    """A curve's derivatives (order + 1, n, 3), N1 (n, 3), and what follows of the rotation-minimising frame.

    T' = p1 N1 + p2 N2 and N_i' = -p_i T, with p_i = s kappa_i, by w: recursions from the lowest derivative up.
    """

    curve: Array
    first_normal: Array

    @cached_property
    def _frame(self) -> tuple[Array, Array, Array, Array, Array]:
        c, n = self.curve, self.curve.shape[1]
        order = len(c) - 1
        speed, p = np.zeros((order, n)), np.zeros((2, max(order - 1, 1), n))
        t, m1, m2 = np.zeros((3, order, n, 3))
        speed[0] = np.linalg.norm(c[1], axis=-1)
        t[0] = c[1] / speed[0][:, None]
        m1[0], m2[0] = self.first_normal, np.cross(t[0], self.first_normal)
        for k in range(order - 1):
            lower = slice(None, k + 1)
            speed[k + 1] = product(c[2 : k + 3], t[lower])[k].sum(axis=-1)
            for i, m in enumerate((m1, m2)):
                bend = product(c[2 : k + 3], m[lower])[k].sum(axis=-1)
                known = sum(comb(k, j) * p[i, j] * speed[k - j] for j in range(k))
                p[i, k] = (bend - known) / speed[0]
                m[k + 1] = -product(p[i, lower, :, None], t[lower])[k]
            t[k + 1] = (product(p[0, lower, :, None], m1[lower]) + product(p[1, lower, :, None], m2[lower]))[k]
        return speed, p, t, m1, m2

    @property
    def speed(self) -> Array:
        """|dc/dw| and its derivatives (order, n)."""
        return self._frame[0]

    @property
    def bends(self) -> Array:
        """p1 and p2: the bending by w along N1 and N2, and its derivatives (2, order - 1, n) [1/m]."""
        return self._frame[1]

    @property
    def tangent(self) -> Array:
        """T and its derivatives (order, n, 3)."""
        return self._frame[2]

    @property
    def normal(self) -> Array:
        """N1 and its derivatives (order, n, 3)."""
        return self._frame[3]

    @property
    def binormal(self) -> Array:
        """N2 and its derivatives (order, n, 3)."""
        return self._frame[4]
