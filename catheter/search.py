"""Which fibre angles suit a task: every design of a grid, its cost, and what the fibres forbid.

Exchanging the first two fibres changes nothing, mirroring all three changes signs only: a quarter
of the (alpha, beta) plane stands for all of it.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from catheter.free import Array, Infeasible, Stretches, inflate
from catheter.helix import Design, Helix, HelixState
from catheter.task import DEGREE, Task, check
from data.errors import BadInput

PAIRS_AT_ONCE = 64  # their arrays stay in the processor's cache
KEPT = 64  # cheapest cells kept of each block: ties and the next distinct cost are among them
MOST_CELLS = 200_000_000  # of a whole cost field, 8 bytes each
SAME = 1e-9  # relative: costs this close are a tie


@dataclass(frozen=True, eq=False)
class Block:
    """Some pairs alpha > 0, |beta| <= alpha of a grid with every gamma: indices from -n to n, helices (pairs, gammas).

    Each pair stands for (alpha, beta) and (beta, alpha), and, with gamma and the twist mirrored, for
    their negatives: `copies` of them that differ (4, or 2 for beta = -alpha).
    """

    alpha: NDArray[np.int64]
    beta: NDArray[np.int64]
    gamma: NDArray[np.int64]
    helix: Helix
    copies: NDArray[np.int64]

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Where there is a helix, (pairs, gammas)."""
        return np.asarray(self.helix.state == HelixState.VALID)

    def costs(self, task: Task, mirrored: bool) -> Array:
        """Return the costs (pairs, gammas), infinite where not valid, of the pairs or of their mirror images."""
        helix = self.helix
        cost = task.cost(helix.radius_m, helix.length_ratio, -helix.twist_rad if mirrored else helix.twist_rad)
        return np.where(self.valid, cost, np.inf)


def half_steps(task: Task) -> int:
    """Return n: the grid's angles are the multiples of the step from -n to n, within +-90 deg."""
    return int(np.floor(np.pi / 2 / task.step * (1 + 1e-12)))


def blocks(task: Task) -> Iterator[Block]:
    """Go through the quarter of the grid that stands for all of it, its feasible pairs only."""
    n = half_steps(task)
    angle = _angles(task, np.arange(n + 1))
    signed = np.concatenate([-angle[:0:-1], angle])  # exactly symmetric
    gamma = np.arange(-n, n + 1)
    gamma = gamma[np.abs(signed[gamma + n]) < np.pi / 2 - 1e-12]  # psi = tan(gamma) is infinite at 90 deg
    for alpha, beta in _quarter(n):
        pair = inflate(signed[alpha + n], signed[beta + n], task.volume_ratio)
        good = np.flatnonzero(pair.feasible)
        for first in range(0, len(good), PAIRS_AT_ONCE):
            some = good[first : first + PAIRS_AT_ONCE]
            column = Stretches(*(value[some][:, None] for value in vars(pair).values()))
            a, b = alpha[some], beta[some]
            with np.errstate(invalid="ignore"):
                yield Block(a, b, gamma, task.helix(column, signed[gamma + n]), np.where(b == -a, 2, 4))


def _angles(task: Task, index: NDArray[np.int64]) -> Array:
    """Return the angles of non-negative indices, the last exactly 90 deg when the step divides it."""
    angle = index * task.step
    return np.asarray(np.where(np.abs(angle - np.pi / 2) < 1e-12, np.pi / 2, angle))


def _quarter(n: int) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Yield indices (alpha, beta), 0 < alpha, -alpha <= beta < alpha, ten thousand or so at a time."""
    rows = max(1, 10_000 // (2 * n + 1))
    for start in range(1, n + 1, rows):
        alphas = np.arange(start, min(start + rows, n + 1))
        yield np.repeat(alphas, 2 * alphas), np.concatenate([np.arange(-a, a) for a in alphas])


@dataclass(frozen=True, kw_only=True)
class Search:
    """What a search found. Counts are over the whole grid, all symmetric copies included.

    ties: (alpha, beta, gamma) in rad of every cell that costs as little as `best`, the thesis's
    choice of signs (alpha > 0, gamma < 0) first. runner_up, runner_up_cost: the next distinct cost
    (infinite, and the best cell again, when there is none). slack includes the cells whose third
    fibre lies along one of the others.
    """

    task: Task
    best: Design
    cost: float
    ties: tuple[tuple[float, float, float], ...]
    runner_up: tuple[float, float, float]
    runner_up_cost: float
    cells: int
    pairs: int
    feasible_pairs: int
    over_constrained: int
    slack: int
    valid: int
    seconds: float


def search(task: Task) -> Search:
    """Return the cheapest design of the grid (thesis eq. 3.18). Raises Infeasible when no cell is valid, BadInput."""
    started = time.perf_counter()
    check(task)
    counts = np.zeros(4, np.int64)  # pairs, over-constrained, slack, valid
    kept: list[tuple[Array, NDArray[np.int64]]] = []
    for block in blocks(task):
        states = [block.helix.state == state for state in (1, 2, 0)]
        counts += [block.copies.sum(), *(int(block.copies @ state.sum(axis=1)) for state in states)]
        for mirrored in (False, True)[: 1 if task.target_twist == 0 else 2]:
            kept.append(_cheapest(block, block.costs(task, mirrored), mirrored))
    cost = np.concatenate([costs for costs, _ in kept]) if kept else np.array([])
    finite = np.isfinite(cost)
    if not finite.any():
        raise Infeasible(
            f"none of the {counts[0]} feasible pairs makes a helix at V = {task.volume_ratio:g}: {counts[1]} designs"
            f" are over-constrained, {counts[2]} slack; change the volume ratio or the step"
        )
    cost, cells = cost[finite], np.concatenate([cells for _, cells in kept])[finite]
    order = np.argsort(cost, kind="stable")
    return _found(task, cost[order], cells[order], counts, started)


def _found(task: Task, cost: Array, cells: NDArray[np.int64], counts: NDArray[np.int64], started: float) -> Search:
    """Return the result from the cheapest cells (k, 3) of all blocks by rising cost, and the counts."""
    tied = int(np.searchsorted(cost, cost[0] * (1 + SAME), side="right"))
    mirror = task.target_twist == 0
    ties = _copies(cells[:tied], mirror=mirror)
    others = len(cost) > tied
    best, n = task.design(*_radians(task, ties[0])), half_steps(task)
    return Search(
        task=task,
        best=best,
        cost=task.cost_of(best),
        ties=tuple(_radians(task, cell) for cell in ties),
        runner_up=_radians(task, _copies(cells[tied if others else 0][None], mirror=mirror)[0]),
        runner_up_cost=float(cost[tied]) if others else float("inf"),
        cells=(2 * n + 1) ** 3,
        pairs=(2 * n + 1) ** 2,
        feasible_pairs=int(counts[0]),
        over_constrained=int(counts[1]),
        slack=int(counts[2]),
        valid=int(counts[3]),
        seconds=time.perf_counter() - started,
    )


def _cheapest(block: Block, cost: Array, mirrored: bool) -> tuple[Array, NDArray[np.int64]]:
    """Return the smallest costs of a block and their cells (alpha, beta, gamma) as indices, (k, 3)."""
    flat = cost.ravel()
    kept = np.argpartition(flat, KEPT)[:KEPT] if len(flat) > KEPT else np.arange(len(flat))
    row, column = np.unravel_index(kept, cost.shape)
    cells = np.stack([block.alpha[row], block.beta[row], block.gamma[column]], axis=1)
    return flat[kept], -cells if mirrored else cells


def _copies(cells: NDArray[np.int64], *, mirror: bool) -> list[tuple[int, ...]]:
    """Return cells with their symmetric copies, each once, alpha > 0 and gamma < 0 first."""
    swapped = np.concatenate([cells, cells[:, [1, 0, 2]]])
    every = np.concatenate([swapped, -swapped]) if mirror else swapped
    return sorted({tuple(map(int, cell)) for cell in every}, key=lambda c: (c[0] < 0, c[2] > 0, -c[0]))


def _radians(task: Task, cell: tuple[int, ...]) -> tuple[float, float, float]:
    a, b, g = (float(np.sign(i) * _angles(task, np.array(abs(i)))) for i in cell)
    return a, b, g


def cost_field(task: Task) -> tuple[Array, Array]:
    """Return the grid's angles (m,) in rad and the cost of every cell (m, m, m), NaN where there is no helix.

    Axes: alpha, beta, gamma. Raises BadInput when it would hold more than 200 million cells.
    """
    n = half_steps(task)
    if (2 * n + 1) ** 3 > MOST_CELLS:
        raise BadInput("step", f"{task.step / DEGREE:g} deg makes {(2 * n + 1) ** 3} cells", f"at most {MOST_CELLS}")
    field = np.full((2 * n + 1,) * 3, np.nan)
    for block in blocks(task):
        a, b, g = block.alpha[:, None], block.beta[:, None], block.gamma
        for sign in (1, -1):
            cost = np.where(block.valid, block.costs(task, sign < 0), np.nan)
            field[n + sign * a, n + sign * b, n + sign * g] = cost
            field[n + sign * b, n + sign * a, n + sign * g] = cost
    angle = _angles(task, np.arange(n + 1))
    return np.concatenate([-angle[:0:-1], angle]), field
