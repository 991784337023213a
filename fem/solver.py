"""Factors of a stiffness matrix that say how many of its pivots are negative.

A mesh swept from one end is block-tridiagonal: dense LAPACK blocks from level to level, Cholesky
where a block is positive definite and its eigenvectors where it is not. Meshes whose levels are
too wide for that, and matrices that are not symmetric, go to SuperLU.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dgemm, dsyrk, dtrsm
from scipy.linalg.lapack import dpotrf

from data.errors import DidNotConverge
from data.signal import Array
from fem.kernel import dense_block

Integers = NDArray[np.int64]

RINGS, SPARSE, GENERAL = "block-tridiagonal", "SuperLU, symmetric mode", "SuperLU"
MOST_WORK = 1e12  # multiplications of the dense blocks beyond which SuperLU is the faster


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


def work(level: Integers) -> float:
    """Return the multiplications that a block-tridiagonal factor over these levels (of unknowns) needs."""
    width = np.bincount(level).astype(float)
    return float((width**3 / 3).sum() + (width[1:] * width[:-1] * (width[1:] + width[:-1])).sum())


@dataclass(frozen=True, eq=False)
class _Block:
    """A diagonal block A = S^-1 signs S^-T: `half` is S b, `back` is S^T b."""

    root: Array
    signs: Array | None  # None: the root is Cholesky's lower triangle

    def half(self, right: Array) -> Array:
        if self.signs is None:
            return np.asarray(dtrsm(1.0, self.root, right, lower=1))
        return self.root @ right

    def back(self, right: Array) -> Array:
        if self.signs is None:
            return np.asarray(dtrsm(1.0, self.root, right, lower=1, trans_a=1))
        return self.root.T @ (self.signs[:, None] * right)

    def half_right(self, left: Array) -> Array:
        """Return left S^T."""
        if self.signs is None:
            return np.asarray(dtrsm(1.0, self.root, left, side=1, lower=1, trans_a=1, overwrite_b=1))
        return left @ self.root.T

    def signed(self, z: Array) -> Array:
        return z if self.signs is None else self.signs[:, None] * z


def _factored(block: Array) -> _Block:
    """Factor a symmetric block of which the lower triangle is given. Raises DidNotConverge for a singular one."""
    root, info = dpotrf(block, lower=1)
    if info == 0:
        return _Block(np.asarray(root), None)
    if not np.isfinite(block).all():
        raise DidNotConverge("stiffness: is not finite; try a smaller step")
    values, vectors = np.linalg.eigh(block, UPLO="L")
    if np.abs(values).min() <= 1e-15 * np.abs(values).max():
        raise DidNotConverge(
            "stiffness: is singular; a body that can move freely, or a limit point: use volume control"
        )
    return _Block(np.asfortranarray((vectors / np.sqrt(np.abs(values))).T), np.sign(values))


class BlockTridiagonal:
    """The factor of a symmetric CSR matrix whose rows are sorted by level, levels coupled to neighbours only."""

    def __init__(self, matrix: Any, ends: Integers) -> None:
        self.ends, self.blocks, self.below = ends, list[_Block](), list[Array]()
        self.negative = 0
        left = first = 0
        for last in ends.tolist():
            rows = np.empty((last - first, last - left), order="F")
            dense_block(matrix.data, matrix.indices, matrix.indptr, first, last, left, rows)
            diagonal = rows[:, first - left :]
            if self.blocks:
                before = self.blocks[-1]
                below = before.half_right(rows[:, : first - left])
                self.below.append(below)
                if before.signs is None:
                    diagonal = dsyrk(-1.0, below, beta=1.0, c=diagonal, lower=1, overwrite_c=1)
                else:
                    diagonal = dgemm(-1.0, below * before.signs, below, beta=1.0, c=diagonal, trans_b=1)
            block = _factored(diagonal)
            self.negative += 0 if block.signs is None else int((block.signs < 0).sum())
            self.blocks.append(block)
            left, first = first, last

    def solve(self, right: Array) -> Array:
        """Return the solution for right-hand sides (n, k)."""
        parts = np.split(right, self.ends[:-1])
        z = [self.blocks[0].half(parts[0])]
        for block, below, before, part in zip(self.blocks[1:], self.below, self.blocks, parts[1:], strict=False):
            z.append(block.half(part - below @ before.signed(z[-1])))
        x = [self.blocks[-1].back(z[-1])]
        for k in range(len(self.below) - 1, -1, -1):
            x.append(self.blocks[k].back(z[k] - self.below[k].T @ x[-1]))
        return np.vstack(x[::-1])


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
        return np.asarray(self._lu.solve(right, trans="T" if transposed else "N"))


def _odd(permutation: Integers) -> int:
    """Return whether a permutation is odd: its length less its cycles."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    n = len(permutation)
    graph: Any = csr_array((np.ones(n), permutation, np.arange(n + 1)), shape=(n, n))
    return int((n - connected_components(graph, directed=False)[0]) % 2)
