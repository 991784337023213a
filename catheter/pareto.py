"""Designs of a grid that no other beats in every target at once, without any weights."""

from bisect import bisect_left, bisect_right
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from catheter.free import Array, Infeasible
from catheter.search import Block, blocks
from catheter.task import Task, check

GUARDS = 64  # members of the front that a block's cells are compared with before the exact sweep


@dataclass(frozen=True, eq=False)
class Front:
    """The Pareto front of a grid, k designs by falling accuracy of the radius.

    angles (k, 3): alpha, beta, gamma in rad, one for each set of symmetric copies. radius_m (k,),
    length_ratio (k,), twist_rad (k,); deviations (k, 3): their distances from the task's targets.
    """

    angles: Array
    radius_m: Array
    length_ratio: Array
    twist_rad: Array
    deviations: Array


def pareto(task: Task) -> Front:
    """Return the front of |R - target|, |lambda_x - target|, |delta - target|. Raises as `search`."""
    check(task)
    front = np.empty((0, 9))  # deviations, results, angles
    for block in blocks(task):
        for mirrored in (False, True)[: 1 if task.target_twist == 0 else 2]:
            cells = _cells(task, block, mirrored)
            for guard in front[:: max(1, len(front) // GUARDS)]:
                cells = cells[(cells[:, :3] < guard[:3]).any(axis=1)]
            joined = np.concatenate([front, cells])
            front = joined[nondominated(joined[:, :3])]
    if not len(front):
        raise Infeasible(f"no design makes a helix at V = {task.volume_ratio:g}; change the volume ratio or the step")
    return Front(front[:, 6:] * task.step, front[:, 3], front[:, 4], front[:, 5], front[:, :3])


def _cells(task: Task, block: Block, mirrored: bool) -> Array:
    """Return the valid cells of a block (n, 9): deviations, (R, lambda_x, delta), (alpha, beta, gamma) as indices."""
    row, column = np.nonzero(block.valid)
    if block.helix.twist_rad.any() or task.target_twist == 0:  # gamma and -gamma are copies where nothing twists
        keep = (block.beta[row] != -block.alpha[row]) | (block.gamma[column] <= 0)
        row, column = row[keep], column[keep]
    sign = -1 if mirrored else 1
    results = np.stack(
        [
            block.helix.radius_m[row, column],
            block.helix.length_ratio[row, column],
            sign * block.helix.twist_rad[row, 0],
        ]
    )
    wanted = np.array([task.wanted_radius, task.target_length_ratio, task.target_twist])
    angles = sign * np.stack([block.alpha[row], block.beta[row], block.gamma[column]])
    return np.concatenate([np.abs(results - wanted[:, None]), results, angles]).T


def nondominated(points: Array) -> NDArray[np.int64]:
    """Return which of the points (n, 3) no other point equals or beats in all three, first come first kept.

    By rising first value, holding the staircase of the other two: n log n.
    """
    order = np.lexsort(points.T[::-1])
    seconds: list[float] = []  # of the staircase: rising, while thirds fall
    thirds: list[float] = []
    kept = []
    for index in order:
        second, third = points[index, 1:].tolist()
        place = bisect_right(seconds, second)
        if place and thirds[place - 1] <= third:
            continue
        first, last = bisect_left(seconds, second), place
        while last < len(thirds) and thirds[last] >= third:
            last += 1
        seconds[first:last], thirds[first:last] = [second], [third]
        kept.append(index)
    return np.array(kept, dtype=np.int64)
