"""The best sparse model, certified: non-negative least squares of every subset of the terms, exactly.

A non-negative optimum is the plain least-squares answer of its own positive terms. So all 2^k
plain answers on the reduced triangle, and for every subset the best of those inside it whose
weights are not negative, are all 2^k non-negative optima: nothing is iterated, nothing can stall.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import NDArray

from data.errors import BadInput, nearest
from sysid.reduction import Reduction, _lengths

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MOST_TERMS = 16
# The root of rounding: a smaller one lets weights grow until they round worse than this.
RANK_TOLERANCE = 1e-8
FLOOR = 1e-13  # an error this small, relative to the response, is rounding
RULES = ("1 %", "AICc", "BIC")


@njit(cache=True)
def _plain(matrix: Array, target: Array, signed: bool, weights: Array, squares: Array) -> None:
    """Least squares of every subset (its bits): Gram-Schmidt, each column orthogonalised twice.

    Counting with the first term as the highest bit, each subset is an earlier one and a term
    after its last: one more column, for the columns before it are still there.
    """
    height, width = matrix.shape
    basis, upper = np.empty((width, height)), np.zeros((width, width))
    chosen, inner = np.zeros(width, np.int64), np.empty(width)
    rest, sound = np.empty((width + 1, height)), np.ones(width + 1, np.bool_)
    rest[0] = target
    squares[0] = np.dot(target, target)
    for count in range(1, 1 << width):
        added = 0
        while not (count >> added) & 1:
            added += 1
        size = 0
        for bit in range(added + 1, width):
            size += (count >> bit) & 1
        chosen[size] = width - 1 - added
        column = basis[size]
        column[:] = matrix[:, chosen[size]]
        upper[:size, size] = 0.0
        for _ in range(2):
            for j in range(size):
                share = np.dot(basis[j], column)
                upper[j, size] += share
                column -= share * basis[j]
        length = np.sqrt(np.dot(column, column))
        mask = 0
        for j in range(size + 1):
            mask |= 1 << chosen[j]
        sound[size + 1] = sound[size] and length > RANK_TOLERANCE
        if not sound[size + 1]:
            squares[mask] = np.inf
            continue
        upper[size, size] = length
        column /= length
        inner[size] = np.dot(column, rest[size])
        rest[size + 1] = rest[size] - inner[size] * column
        squares[mask] = np.dot(rest[size + 1], rest[size + 1])
        for j in range(size, -1, -1):
            value = inner[j]
            for m in range(j + 1, size + 1):
                value -= upper[j, m] * weights[mask, chosen[m]]
            weights[mask, chosen[j]] = value / upper[j, j]
            if value < 0 and not signed:
                squares[mask] = np.inf


@njit(cache=True)
def _inside(squares: Array, width: int, best: Indices) -> None:
    """For every subset, which subset of it has the least squares: one pass of minima for each bit."""
    for mask in range(1 << width):
        best[mask] = mask
    for bit in range(width):
        for mask in range(1 << width):
            if (mask >> bit) & 1 and squares[best[mask ^ (1 << bit)]] <= squares[best[mask]]:
                best[mask] = best[mask ^ (1 << bit)]


@dataclass(frozen=True, eq=False)
class Selection:
    """The non-negative optimum of every subset of k terms; row m's bits say which terms it may use.

    weights (2^k, k) and constants (2^k,): in the response's unit over the terms'. rmse (2^k,):
    root mean square of the residual. constant_free: whether the constant may be negative; it is
    in every subset either way. signed: whether all weights may be.
    """

    terms: tuple[str, ...]
    samples: int
    constant_free: bool
    signed: bool
    weights: Array
    constants: Array
    rmse: Array
    response_deviation: float

    @cached_property
    def sizes(self) -> Indices:
        """How many terms each subset may use, (2^k,)."""
        return np.array([mask.bit_count() for mask in range(len(self.rmse))])

    @cached_property
    def best(self) -> Indices:
        """The best subset of each size 0 .. k, (k+1,)."""
        masks = [np.flatnonzero(self.sizes == size) for size in range(len(self.terms) + 1)]
        return np.array([group[np.argmin(self.rmse[group])] for group in masks])

    def mask(self, names: tuple[str, ...]) -> int:
        """Return the subset of these terms. Raises BadInput with the nearest name for an unknown one."""
        for name in names:
            if name not in self.terms:
                raise BadInput(f"term {name!r}", "is not known", nearest(name, self.terms))
        return sum(1 << self.terms.index(name) for name in set(names))

    def names(self, mask: int) -> tuple[str, ...]:
        """Return a subset's terms, in the order of all terms."""
        return tuple(name for bit, name in enumerate(self.terms) if (mask >> bit) & 1)

    def support(self, mask: int) -> int:
        """Return the terms of a subset whose weights are not zero."""
        return sum(1 << bit for bit, weight in enumerate(self.weights[mask]) if weight != 0)

    def information(self, rule: str) -> Array:
        """Return AICc or BIC of every subset, (2^k,): its terms, constant and variance counted."""
        n, floor = self.samples, FLOOR * max(self.response_deviation, 1e-300)
        count = 2.0 + (self.weights != 0).sum(axis=1)
        fit = 2 * n * np.log(np.maximum(self.rmse, floor))
        if rule == "BIC":
            return np.asarray(fit + count * np.log(n))
        spare = np.maximum(n - count - 1, 1e-3)
        return np.asarray(fit + 2 * count + 2 * count * (count + 1) / spare)

    def choose(self, rule: str = "1 %", threshold: float = 0.01) -> int:
        """Return the subset a rule picks: "1 %", "AICc" or "BIC".

        1 % (thesis 3.3.3): the best of each size in turn, until the next size lowers the error of
        the one before by less than `threshold`.
        """
        if rule not in RULES:
            raise BadInput("rule", f"{rule!r} is not known", f"known: {', '.join(RULES)}")
        if rule != "1 %":
            return self.support(int(np.argmin(self.information(rule))))
        errors, floor = self.rmse[self.best], FLOOR * max(self.response_deviation, 1e-300)
        size = 0
        while size < len(self.terms) and errors[size] > floor:
            if errors[size + 1] > (1 - threshold) * errors[size]:
                break
            size += 1
        return self.support(int(self.best[size]))


def select(reduction: Reduction, *, constant_free: bool = True, signed: bool = False) -> Selection:
    """Return the non-negative optimum of every subset of the reduction's terms (thesis eq. 3.30).

    The optimality conditions hold for every subset, to rounding; to 1e-8 where terms are
    collinear: those never stand in one optimum together, one of them does. signed: plain least
    squares of every subset instead. Raises BadInput for no or more than 16 terms.
    """
    terms, total = reduction.terms, reduction.total
    if not 1 <= len(terms) <= MOST_TERMS:
        raise BadInput("selection", f"{len(terms)} terms", f"expected 1 to {MOST_TERMS}: all subsets are solved")
    if constant_free or signed:  # the first row is the constant's own: without it, it is projected out
        matrix, target = total[1:, 1:-1], total[1:, -1]
        reach = _lengths(total[:, 1:-1])
    else:
        matrix, target = np.roll(total[:, :-1], -1, axis=1), total[:, -1]
        reach = _lengths(matrix)
    length = np.asarray(np.linalg.norm(matrix, axis=0))
    dead = length <= RANK_TOLERANCE * reach  # nothing but the constant
    scaled = np.where(dead, 0.0, matrix / np.where(dead, 1.0, length))
    weights, rmse = _all(scaled, target, signed)
    weights = weights / np.where(dead, 1.0, length)
    if constant_free or signed:
        constants = (total[0, -1] - weights @ total[0, 1:-1]) / total[0, 0]
    else:
        half = len(weights) // 2  # the upper half of the subsets holds the constant, the last column
        weights, constants, rmse = weights[half:, :-1], weights[half:, -1], rmse[half:]
    return Selection(
        terms, len(reduction), constant_free or signed, signed, weights, constants,
        rmse / np.sqrt(len(reduction)), reduction.response_deviation,
    )  # fmt: skip


def _all(scaled: Array, target: Array, signed: bool) -> tuple[Array, Array]:
    width = scaled.shape[1]
    weights, squares = np.zeros((1 << width, width)), np.empty(1 << width)
    _plain(np.ascontiguousarray(scaled), np.ascontiguousarray(target), signed, weights, squares)
    best = np.empty(1 << width, np.int64)
    _inside(squares, width, best)
    return weights[best], np.sqrt(squares[best])
