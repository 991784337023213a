"""Closed surfaces around the voxels of each material, for printing.

A lattice of cells (around, along, through) over positions (around, along + 1, through + 1, 3) closes
around; each cell is of one material, or empty. Faces between cells of one material are left out.

Where two voxels of a material meet along an edge only, its surface would pass that edge twice: no
closed surface, and readers that join equal corners cannot tell the two apart. There the edge is
opened into two, BRIDGE of a voxel up and down the tube: one pair of voxels across it is joined by
that sliver, the other pair parts. So every edge of every surface has exactly two triangles.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput
from data.signal import Array

Numbers = NDArray[np.int64]
EMPTY = -1
BRIDGE = 1e-3  # of a voxel's length: 1 um of the thesis's voxels, a fourteenth of a printer's layer
_SIDES = ((0, -1), (1, 0), (0, 1), (-1, 0))  # the neighbour behind each side of a cell, anticlockwise from below
_CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles (n, 3) of one material over the solid's points, outward normals."""

    points: Array
    triangles: Numbers

    @property
    def volume(self) -> float:
        """Enclosed volume, of the points' unit cubed."""
        return enclosed(self.points[self.triangles])


def enclosed(corners: Array) -> float:
    """Return the volume inside closed triangles (n, 3, 3)."""
    origin = corners.reshape(-1, 3).mean(axis=0)  # nearer than the frame's origin: less to cancel
    a, b, c = np.moveaxis(corners - origin, 1, 0)
    return float((a * np.cross(b, c)).sum()) / 6


@dataclass(frozen=True, eq=False)
class Solid:
    """Cells (around, along, through) of materials 0, 1 ... or EMPTY, over positions.

    Positions are put on a grid that floats of four bytes hold exactly, so that files hold the very
    numbers; `step` is its width. Raises BadInput for cells that no closed surfaces part.
    """

    positions: Array
    cells: Numbers

    def __post_init__(self) -> None:
        """Check the shapes."""
        u, v, w = self.cells.shape
        if self.positions.shape != (u, v + 1, w + 1, 3) or u < 3:
            found = f"{self.cells.shape} cells, {self.positions.shape} positions"
            raise BadInput("solid", found, "expected (u, v + 1, w + 1, 3) positions and 3 cells around")
        if not np.isfinite(self.positions).all():
            raise BadInput("solid", "has positions that are not finite")

    @property
    def step(self) -> Array:
        """The grid's width along x, y, z: powers of two."""
        most = np.maximum(np.abs(self.positions).reshape(-1, 3).max(axis=0), 1e-30)
        return np.asarray(2.0 ** (np.ceil(np.log2(most)) - 24))

    @cached_property
    def opened(self) -> Numbers:
        """How each edge through the wall is opened (around, along + 1): 0 not, 1 or 2 by which pair it joins."""
        below, above = _padded(self.cells)[:, :-1], _padded(self.cells)[:, 1:]
        a, b, c, d = np.roll(below, 1, axis=0), below, above, np.roll(above, 1, axis=0)
        first = (a == c) & (a != EMPTY) & (a != b) & (a != d)
        second = (b == d) & (b != EMPTY) & (b != a) & (b != c)
        kinds = np.where(first, 1, np.where(second, 2, 0))
        if ((kinds == 1).any(axis=2) & (kinds == 2).any(axis=2)).any():
            raise BadInput("solid", "has layers whose voxels meet along one edge in both ways", "one layer of voxels")
        self._refuse_other_edges()
        return np.asarray(kinds.max(axis=2), dtype=np.int64)

    def _refuse_other_edges(self) -> None:
        """Refuse voxels that meet along an edge around or along the tube only: no map of one layer has them."""
        padded = np.pad(self.cells, ((0, 0), (1, 1), (1, 1)), constant_values=EMPTY)
        a, b, c, d = padded[:, :-1, :-1], padded[:, 1:, :-1], padded[:, 1:, 1:], padded[:, :-1, 1:]
        _refuse_diagonal(a, b, c, d)
        other = padded[:, 1:-1]
        a, b = np.roll(other, 1, axis=0)[..., :-1], other[..., :-1]
        _refuse_diagonal(a, b, other[..., 1:], np.roll(other, 1, axis=0)[..., 1:])

    @cached_property
    def points(self) -> Array:
        """All corners (n, 3): first those of the lattice, then the second one of every opened edge."""
        w = self.positions.shape[2]
        where = np.argwhere(self.opened > 0)
        corners = self.positions.copy()
        second = np.empty((len(where), w, 3))
        for row, (i, j) in enumerate(where):
            here = self.positions[i, j]
            # along the tube only: there the corners stay on the outer faces, and no volume is lost
            corners[i, j] = here + BRIDGE * (self.positions[i, j - 1] - here)
            second[row] = here + BRIDGE * (self.positions[i, j + 1] - here)
        every = np.vstack([corners.reshape(-1, 3), second.reshape(-1, 3)])
        return np.asarray(np.round(every / self.step) * self.step)

    @cached_property
    def _corners(self) -> tuple[Numbers, Numbers]:
        """Numbers at the first level by which a cell's outline comes to, and leaves, each corner (u, v, 4)."""
        u, rows, levels, _ = self.positions.shape
        v = rows - 1
        first = (np.arange(u)[:, None] * rows + np.arange(rows)) * levels
        extra = np.cumsum(self.opened.ravel() > 0).reshape(u, rows) - 1
        second = np.where(self.opened > 0, u * rows * levels + extra * levels, first)
        # by corner of the cell, for each way of opening: which of the two comes first, which last
        order = {1: ((1, 0), (1, 1), (0, 1), (0, 0)), 2: ((1, 1), (0, 1), (0, 0), (1, 0))}
        comes, leaves = np.empty((2, u, v, 4), dtype=np.int64)
        for k, (di, dj) in enumerate(_CORNERS):
            at = np.ix_((np.arange(u) + di) % u, np.arange(v) + dj)
            both, kind = np.stack([first[at], second[at]]), self.opened[at]
            pick = [np.where(kind == 1, order[1][k][x], np.where(kind == 2, order[2][k][x], 0)) for x in (0, 1)]
            comes[..., k], leaves[..., k] = (np.take_along_axis(both, p[None], 0)[0] for p in pick)
        return comes, leaves

    def surface(self, materials: Sequence[int]) -> Surface:
        """Return the surface of the cells of these materials, taken as one."""
        mine = np.isin(self.cells, materials)
        comes, leaves = self._corners
        triangles = []
        for layer in range(self.cells.shape[2]):
            own = mine[:, :, layer]
            padded = np.pad(own, ((0, 0), (1, 1)))
            for side, (di, dj) in enumerate(_SIDES):
                behind = np.roll(padded, -di, axis=0)[:, 1 + dj : padded.shape[1] - 1 + dj]
                shown = own & ~behind
                a, b = leaves[shown][:, side], comes[shown][:, (side + 1) % 4]
                triangles.append(_quads(np.stack([a, b, b + 1, a + 1], axis=1) + layer))
            for level, way in ((layer, -1), (layer + 1, 1)):
                inside = 0 <= layer + way < self.cells.shape[2]
                shown = own & ~mine[:, :, layer + way] if inside else own
                outline = np.stack([comes[shown], leaves[shown]], axis=2).reshape(-1, 8) + level
                triangles.append(_fans(outline)[:, ::way])
        return Surface(self.points, np.vstack(triangles))


def _padded(cells: Numbers) -> Numbers:
    return np.pad(cells, ((0, 0), (1, 1), (0, 0)), constant_values=EMPTY)


def _refuse_diagonal(a: Numbers, b: Numbers, c: Numbers, d: Numbers) -> None:
    bad = ((a == c) & (a != EMPTY) & (a != b) & (a != d)) | ((b == d) & (b != EMPTY) & (b != a) & (b != c))
    if bad.any():
        place = tuple(int(k) for k in np.argwhere(bad)[0])
        raise BadInput(f"solid, cell {place}", "meets its like along an edge only", "one layer of voxels has no such")


def _quads(corners: Numbers) -> Numbers:
    """Return two triangles each, cut from the corner of the smallest number: the same seen from either side."""
    turned = _from_smallest(corners)
    return np.concatenate([turned[:, [0, 1, 2]], turned[:, [0, 2, 3]]])


def _fans(outline: Numbers) -> Numbers:
    """Return the triangles of outlines (n, 8) in which corners may stand twice, cut from the smallest number."""
    turned = _from_smallest(outline)
    found = np.concatenate([np.stack([turned[:, 0], turned[:, k], turned[:, k + 1]], axis=1) for k in range(1, 7)])
    a, b, c = found.T
    return np.asarray(found[(a != b) & (b != c) & (a != c)])


def _from_smallest(outline: Numbers) -> Numbers:
    count = outline.shape[1]
    return np.take_along_axis(outline, (np.argmin(outline, axis=1)[:, None] + np.arange(count)) % count, axis=1)
