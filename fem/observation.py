"""What is seen of a body at one pressure: nodes, rings, twist or the tip's pose, each with its noise.

Every kind says how far positions are from what was seen (`misfit`), and how that changes (`slope`).
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from data.errors import BadInput
from data.signal import Array
from fem.grid import Indices, Mesh
from fem.rigid import rotation


@dataclass(frozen=True, kw_only=True, eq=False)
class Observation(ABC):
    """Something seen at a pressure [Pa]; sd is its noise's standard deviation in its own unit, 0: exact.

    weight multiplies its squared misfits beside other observations'.
    """

    pressure: float
    sd: float = 0.0
    weight: float = 1.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not (self.sd >= 0 and self.weight > 0 and np.isfinite([self.pressure, self.sd, self.weight]).all()):
            raise BadInput("observation", f"sd {self.sd:g}, weight {self.weight:g}", "expected sd >= 0, weight > 0")

    @abstractmethod
    def misfit(self, x: Array) -> Array:
        """Return positions (n, 3) [m] as they would be seen, less what was seen (k,)."""

    @abstractmethod
    def slope(self, x: Array) -> Any:
        """Return d(misfit) / d(positions), sparse or dense (k, 3n)."""

    @property
    @abstractmethod
    def size(self) -> float:
        """Return the largest value seen, the scale of an exact observation."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen(Observation):
    """Weighted sums of node positions: rows (k, 3n) sparse, target (k,) displacements from rest [m]."""

    rows: Any
    rest: Array
    target: Array

    def misfit(self, x: Array) -> Array:
        """Return the displacements less those seen (k,) [m]."""
        return np.asarray(self.rows @ (x - self.rest).ravel() - self.target)

    def slope(self, x: Array) -> Any:
        """Return the rows."""
        return self.rows

    @property
    def size(self) -> float:
        """The largest displacement seen [m]."""
        return float(np.abs(self.target).max())


@dataclass(frozen=True, kw_only=True, eq=False)
class Pose(Observation):
    """A ring's mean displacement [m] and its rotation, as a vector times `arm` [m]: the tip's pose.

    angle_only: the rotation about z alone, which a camera above the tip sees.
    """

    ring: Indices
    rest: Array
    shift: Array
    turn: Array
    arm: float
    angle_only: bool = False

    def misfit(self, x: Array) -> Array:
        """Return shift and turn that remain (6,), or the angle alone (1,) [m]."""
        now = x[self.ring] - x[self.ring].mean(axis=0)
        then = self.rest[self.ring] - self.rest[self.ring].mean(axis=0)
        if self.angle_only:
            angle = _angle(then, now) - self.turn[2]
            return np.array([self.arm * (angle - 2 * np.pi * np.round(angle / (2 * np.pi)))])
        left = _vector(_fitted(then @ rotation(self.turn).T, now))
        return np.concatenate([(x - self.rest)[self.ring].mean(axis=0) - self.shift, self.arm * left])

    def slope(self, x: Array) -> Any:
        """Return the slope, of a rotation that is still far to first order only."""
        count = len(self.ring)
        now = x[self.ring] - x[self.ring].mean(axis=0)
        if self.angle_only:
            then = self.rest[self.ring] - self.rest[self.ring].mean(axis=0)
            return self._angle_slope(then[:, :2], now[:, :2], x.size)
        inertia = (now**2).sum() * np.eye(3) - now.T @ now
        crosses = np.stack([np.cross(now, axis) for axis in np.eye(3)], axis=-1)  # a x e_j, (c, 3, j)
        turn = self.arm * np.linalg.solve(
            inertia, crosses.reshape(3 * count, 3).reshape(count, 3, 3).transpose(1, 0, 2).reshape(3, -1)
        )
        out = np.zeros((6, x.size))
        places = (3 * self.ring[:, None] + np.arange(3)).ravel()
        out[3:, places] = turn
        for axis in range(3):
            out[axis, 3 * self.ring + axis] = 1 / count
        return out

    def _angle_slope(self, then: Array, now: Array, size: int) -> Array:
        sine = (then[:, 0] * now[:, 1] - then[:, 1] * now[:, 0]).sum()
        cosine = (then * now).sum()
        d_sine = np.stack([-then[:, 1], then[:, 0]], axis=1)
        out = np.zeros((1, size))
        each = self.arm * (cosine * d_sine - sine * then) / (sine**2 + cosine**2)
        out[0, (3 * self.ring[:, None] + np.arange(2)).ravel()] = each.ravel()
        return out

    @property
    def size(self) -> float:
        """The largest of shift and turned arc [m]."""
        return float(max(np.abs(self.shift).max() * (not self.angle_only), np.abs(self.arm * self.turn).max()))


def twist(rest: Array, now: Array) -> float:
    """Return the best-fit rotation about z of nodes (r, 3), -pi to pi [rad]."""
    return _angle(rest - rest.mean(axis=0), now - now.mean(axis=0))


def nodes(mesh: Mesh, which: Indices, x: Array, pressure: float, **more: float) -> Seen:
    """Return the observation of nodes' positions: those rows of x (n, 3) [m]."""
    from scipy.sparse import csr_array

    places = (3 * np.asarray(which)[:, None] + np.arange(3)).ravel()
    rows = csr_array((np.ones(len(places)), (np.arange(len(places)), places)), shape=(len(places), mesh.nodes.size))
    target = (x - mesh.nodes).ravel()[places]
    return Seen(rows=rows, rest=mesh.nodes, target=target, pressure=pressure, **more)


def centreline(mesh: Mesh, rings: Sequence[Indices], line: Array, pressure: float, **more: float) -> Seen:
    """Return the observation of rings' mean positions (r, 3) [m]."""
    from scipy.sparse import lil_array

    rows = lil_array((3 * len(rings), mesh.nodes.size))
    for k, ring in enumerate(rings):
        for axis in range(3):
            rows[3 * k + axis, 3 * ring + axis] = 1 / len(ring)
    rest = np.stack([mesh.nodes[ring].mean(axis=0) for ring in rings])
    return Seen(rows=rows.tocsr(), rest=mesh.nodes, target=(line - rest).ravel(), pressure=pressure, **more)


def _angle(then: Array, now: Array) -> float:
    sine = (then[:, 0] * now[:, 1] - then[:, 1] * now[:, 0]).sum()
    return float(np.arctan2(sine, (then[:, :2] * now[:, :2]).sum()))


def _fitted(then: Array, now: Array) -> Array:
    """Return the rotation (3, 3) that takes arms (r, 3) nearest to others (Kabsch)."""
    u, _, v = np.linalg.svd(now.T @ then)
    u[:, 2] *= np.sign(np.linalg.det(u @ v))
    return np.asarray(u @ v)


def _vector(turn: Array) -> Array:
    """Return the rotation vector [rad] of a rotation matrix."""
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
    sine = float(np.linalg.norm(axis))
    angle = float(np.arctan2(sine, (np.trace(turn) - 1) / 2))
    return axis * (angle / sine if sine > 1e-12 else 1.0)
