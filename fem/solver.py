"""Factors of a stiffness matrix that say how many of its pivots are negative.

A mesh swept from one end is block-tridiagonal: dense LAPACK blocks from level to level, Cholesky
where a block is positive definite and its eigenvectors where it is not. Meshes whose levels are
too wide for that, and matrices that are not symmetric, go to SuperLU.
"""

from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from typing import Any, Protocol
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from data.errors import DidNotConverge
from data.signal import Array
from fem import dense
from fem.kernel import dense_block

Integers = NDArray[np.int64]

RINGS, SPARSE, GENERAL = "block-tridiagonal", "SuperLU, symmetric mode", "SuperLU"
PANEL = 48  # rows of a staircase taken together
MOST_WORK = 1e12  # multiplications of the dense blocks beyond which SuperLU is the faster


@cache
def _libraries() -> Any:
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def one_thread() -> AbstractContextManager[Any]:
    """Return a context in which BLAS has one thread: on blocks as small as these several wait for one another."""
    limited: AbstractContextManager[Any] = _libraries().limit(limits=1, user_api="blas")
    return limited


class Factor(Protocol):
    """A factorised matrix: `solve` it, and how many of its pivots are negative."""

    negative: int

    def solve(self, right: Array) -> Array:
        """Return the solution for right-hand sides (n, k)."""
        ...


def sweep(start: NDArray[np.int32], column: NDArray[np.int32], seed: NDArray[np.bool_]) -> Integers:
    """Return each node's distance from the seeds (n,) in the graph of a CSR pattern; parts not reached follow on."""
    from scipy.sparse import csr_array

    n = len(seed)
    graph = csr_array((np.ones(len(column)), column, start), shape=(n, n))
    level, front, at = np.full(n, -1), seed.copy(), 0
    while (level < 0).any():
        if not front.any():  # an island
            front[np.argmax(level < 0)] = True
        level[front] = at
        at += 1
        front = (graph @ front.astype(float) > 0) & (level < 0)
    return level


def ranked(start: NDArray[np.int32], column: NDArray[np.int32], level: Integers) -> Integers:
    """Return each node's place (n,) in an order level by level whose couplings are staircases (Cuthill and McKee).

    Nodes of a level follow their first neighbours in the level before; the first level's go by its own graph.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    n = len(level)
    place = np.empty(n, dtype=np.int64)
    graph = csr_array((np.ones(len(column)), column, start), shape=(n, n))
    done = 0
    for at in range(int(level.max()) + 1):
        nodes = np.flatnonzero(level == at)
        if at == 0:
            order: Any = reverse_cuthill_mckee(graph[nodes][:, nodes].tocsr(), symmetric_mode=True)
        else:
            rows = graph[nodes]
            of, back = np.repeat(np.arange(len(nodes)), np.diff(rows.indptr)), level[rows.indices] == at - 1
            of, near = of[back], place[rows.indices[back]]
            least, total = np.full(len(nodes), n), np.bincount(of, near, len(nodes))
            np.minimum.at(least, of, near)
            order = np.lexsort((total / np.maximum(np.bincount(of, minlength=len(nodes)), 1), least))
        place[nodes[order]] = done + np.arange(len(nodes))
        done += len(nodes)
    return place


def work(level: Integers) -> float:
    """Return the multiplications that a block-tridiagonal factor over these levels (of unknowns) needs."""
    width = np.bincount(level).astype(float)
    return float((width**3 / 3).sum() + (width[1:] * width[:-1] * (width[1:] + width[:-1])).sum())


@dataclass(frozen=True, eq=False)
class _Level:
    """A level's part of the factor.

    root (n, n): Cholesky's lower triangle of the diagonal block, or, with signs (n,), a matrix R with
    block^-1 = R^T signs R. below (m, n): what couples the next level. panels: its rows in groups
    (first, last, first column that is not zero); columns before that are never read.
    """

    root: Array
    signs: Array | None
    below: Array = field(default_factory=lambda: np.empty((0, 0), order="F"))
    panels: tuple[tuple[int, int, int], ...] = ()

    def half(self, right: Array) -> None:
        """Set the columns of right (n, k) to L^-1 right, or R right."""
        if self.signs is None:
            n, k = right.shape
            dense.divide("L", "N", n, k, self.root.ctypes.data, _far(self.root), right.ctypes.data, _far(right))
        else:
            right[:] = self.root @ right

    def back(self, right: Array) -> None:
        """Set the columns of right (n, k) to L^-T right, or R^T signs right."""
        if self.signs is None:
            n, k = right.shape
            dense.divide("L", "T", n, k, self.root.ctypes.data, _far(self.root), right.ctypes.data, _far(right))
        else:
            right[:] = self.root.T @ (self.signs[:, None] * right)

    def coupled(self, block: Array, panels: tuple[tuple[int, int, int], ...]) -> "_Level":
        """Return the level with a block that couples the next one, turned into `below`: times L^-T, or R^T."""
        if self.signs is not None:
            block[:] = block @ self.root.T
            panels = ((0, len(block), 0),)
        n, ldr, ldb = len(self.root), _far(self.root), _far(block)
        for first, last, c in panels if self.signs is None else ():
            there, at = self.root.ctypes.data + 8 * c * (ldr + 1), block.ctypes.data + 8 * (first + c * ldb)
            dense.divide("R", "T", last - first, n - c, there, ldr, at, ldb)
        return _Level(self.root, self.signs, block, panels)

    def reduce(self, diagonal: Array) -> None:
        """Take below signs below^T from the lower triangle of the next level's diagonal block."""
        if self.signs is not None:
            diagonal -= (self.below * self.signs) @ self.below.T
            return
        far = _far(self.below)
        for (_, rows, c), end in zip(self.panels, self._column_ends(), strict=True):
            dense.subtract_square(
                rows, end - c, self.below.ctypes.data + 8 * c * far, far, diagonal.ctypes.data, _far(diagonal)
            )

    def _column_ends(self) -> list[int]:
        return [*(c for _, _, c in self.panels[1:]), len(self.root)]

    def forward(self, z: Array, right: Array) -> None:
        """Take below signs z from right (m, k)."""
        if self.signs is not None:
            z = np.asfortranarray(self.signs[:, None] * z)
        base, far, k, ldz, ldr = self.below.ctypes.data, _far(self.below), right.shape[1], _far(z), _far(right)
        for first, last, c in self.panels:
            size, at = (last - first, k, len(self.root) - c), base + 8 * (first + c * far)
            dense.subtract_product("N", *size, at, far, z.ctypes.data + 8 * c, ldz, right.ctypes.data + 8 * first, ldr)

    def backward(self, x: Array, z: Array) -> None:
        """Take below^T x from z (n, k)."""
        base, far, k, ldx, ldz = self.below.ctypes.data, _far(self.below), z.shape[1], _far(x), _far(z)
        for (_, rows, c), end in zip(self.panels, self._column_ends(), strict=True):
            at = base + 8 * c * far
            dense.subtract_product("T", end - c, k, rows, at, far, x.ctypes.data, ldx, z.ctypes.data + 8 * c, ldz)


def _far(part: Array) -> int:
    """Return the distance between a part's columns, in numbers."""
    return max(part.strides[1] // 8, len(part), 1)


def _diagonalised(block: Array) -> tuple[Array, Array]:
    """Return root and signs of a symmetric block of which the lower triangle is given.

    Raises DidNotConverge for a singular one.
    """
    if not np.isfinite(block).all():
        raise DidNotConverge("stiffness: is not finite; try a smaller step")
    values, vectors = np.linalg.eigh(block, UPLO="L")
    if np.abs(values).min() <= 1e-15 * np.abs(values).max():
        raise DidNotConverge(
            "stiffness: is singular; a body that can move freely, or a limit point: use volume control"
        )
    return np.asfortranarray((vectors / np.sqrt(np.abs(values))).T), np.sign(values)


class BlockTridiagonal:
    """The factor of a symmetric CSR matrix whose rows are sorted by level, levels coupled to neighbours only.

    Where rows are also sorted so that a level's coupling to the one before is a staircase, what
    lies below the stairs is not computed: a third of the work of dense blocks is saved on a ring.
    spare: memory of factors of this matrix that are gone, to be used again; fresh memory costs more
    than the factor, as the system clears it page by page.
    """

    def __init__(self, matrix: Any, ends: Integers, spare: list[Array]) -> None:
        self.ends, self.levels = ends, list[_Level]()
        self.negative = 0
        size, wide = np.diff(ends, prepend=0), np.diff(ends, prepend=[0, 0])
        room = spare.pop() if spare else np.empty(int((size * (size + wide[:-1])).sum()))
        finalize(self, spare.append, room)
        stairs = np.minimum.accumulate(matrix.indices[matrix.indptr[:-1]][::-1])[::-1]
        left = first = at = 0
        for last in ends.tolist():
            rows = room[at : at + (last - first) * (last - left)].reshape(last - first, last - left, order="F")
            at += rows.size
            before = self.levels[-1] if self.levels else None
            panels = _panels(stairs[first:last] - left, first - left)
            for again in (False, True):
                dense_block(matrix.data, matrix.indices, matrix.indptr, first, last, left, rows)
                below, diagonal = rows[:, : first - left], rows[:, first - left :]
                if before is not None:
                    before = before.coupled(below, panels)
                    before.reduce(diagonal)
                if again:
                    root, signs = _diagonalised(diagonal)
                    self.negative += int((signs < 0).sum())
                    self.levels.append(_Level(root, signs))
                elif dense.cholesky(len(diagonal), diagonal.ctypes.data, _far(diagonal)):
                    self.levels.append(_Level(diagonal, None))
                    break
            if before is not None:
                self.levels[-2] = before
            left, first = first, last

    def solve(self, right: Array) -> Array:
        """Return the solution for right-hand sides (n, k)."""
        x = np.array(right, dtype=np.float64, order="F")
        parts = [x[a:b] for a, b in zip([0, *self.ends[:-1].tolist()], self.ends.tolist(), strict=True)]
        for level, part, following in zip(self.levels, parts, [*parts[1:], None], strict=True):
            level.half(part)
            if following is not None:
                level.forward(part, following)
        for level, part, following in zip(self.levels[::-1], parts[::-1], [None, *parts[:0:-1]], strict=True):
            if following is not None:
                level.backward(following, part)
            level.back(part)
        return x


def _panels(stairs: NDArray[np.int32], width: int) -> tuple[tuple[int, int, int], ...]:
    """Return groups of rows, first and last, with the first of `width` columns that is not zero in them."""
    cuts = [*range(0, len(stairs), PANEL), len(stairs)]
    return tuple((a, b, min(int(stairs[a]), width)) for a, b in pairwise(cuts))


class SuperLU:
    """SuperLU of a CSR matrix; `negative` is exact in symmetric mode, otherwise the determinant's parity."""

    def __init__(self, matrix: Any, *, symmetric: bool) -> None:
        from scipy.sparse import csc_array
        from scipy.sparse.linalg import splu

        columns = csc_array((matrix.data, matrix.indices, matrix.indptr), shape=matrix.shape)
        try:
            if symmetric:
                options = {"SymmetricMode": True}
                self._lu = splu(columns, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
            else:
                self._lu = splu(columns.T.tocsc())
        except RuntimeError as error:
            raise DidNotConverge(f"stiffness: {error}; a body that can move freely, or a limit point") from error
        below = int((self._lu.U.diagonal() < 0).sum())
        exact = symmetric and np.array_equal(self._lu.perm_r, self._lu.perm_c)
        self.negative = below if exact else (below + _odd(self._lu.perm_r) + _odd(self._lu.perm_c)) % 2

    def solve(self, right: Array, *, transposed: bool = False) -> Array:
        """Return the solution for right-hand sides (n, k), of the transposed matrix if asked for."""
        solve: Any = self._lu.solve  # scipy's stubs know no trans
        return np.asarray(solve(right, trans="T" if transposed else "N"))


def _odd(permutation: Integers) -> int:
    """Return whether a permutation is odd: its length less its cycles."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    n = len(permutation)
    graph: Any = csr_array((np.ones(n), permutation, np.arange(n + 1)), shape=(n, n))
    return int((n - connected_components(graph, directed=False)[0]) % 2)
