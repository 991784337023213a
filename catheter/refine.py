"""From a grid's best design to the continuous optimum, and how much either depends on workmanship."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from catheter.free import Array, Infeasible, Stretches, inflate, stretch, volume_slope
from catheter.helix import Design, HelixState, bend
from catheter.task import DEGREE, MM, Task
from data.errors import CatheterError
from data.options import option

LIMIT = 89.999 * DEGREE  # how far a polish goes: at +-90 deg the design is infeasible
TINY = 1e-30  # complex step: its square is nothing, so that the derivative has no truncation error


class DidNotConverge(CatheterError):
    """An iteration that ended without an answer: the message names how far it came."""


def residuals(task: Task, angles: Array) -> Array:
    """Return the weighted deviations (3, ...) of (R, lambda_x, delta); their squares sum to the cost.

    angles (3, ...): alpha, beta, gamma in rad, complex ones too. NaN where there is no helix.
    """
    alpha, beta, gamma = angles
    pair = inflate(np.real(alpha), np.real(beta), task.volume_ratio)
    with np.errstate(invalid="ignore", divide="ignore"):
        # One Newton step in complex numbers gives a root the derivative of the implicit function.
        error = np.log(pair.axial * stretch(alpha, beta, pair.axial)[0] ** 2 / task.volume_ratio)
        axial = pair.axial - error / volume_slope(alpha, beta, pair.axial)
        moved = Stretches(axial, *stretch(alpha, beta, axial), pair.volume_ratio, pair.state)
        helix = task.helix(moved, gamma)
        found = np.stack([helix.radius_m, helix.length_ratio, helix.twist_rad])
    wanted = np.array([task.wanted_radius, task.target_length_ratio, task.target_twist])
    scale = np.sqrt(task.weights)
    shape = (3,) + (1,) * (found.ndim - 1)
    return np.where(helix.state == HelixState.VALID, (found - wanted.reshape(shape)) * scale.reshape(shape), np.nan)


def jacobian(task: Task, angles: Array) -> Array:
    """Return d residuals / d angles (3, 3) at angles (3,), by complex steps: exact to rounding."""
    return np.asarray(np.imag(residuals(task, angles[:, None] + 1j * TINY * np.eye(3))) / TINY)


@dataclass(frozen=True, kw_only=True)
class Polish:
    """Where descending from a design ends.

    slope: size of the cost's gradient [1/rad] over the angles that are free to move there.
    boundary: what ends the descent when it is a limit of the angles, where the design is infeasible; "" when the
    optimum lies inside.
    """

    design: Design
    cost: float
    slope: float
    steps: int
    boundary: str


def polish(task: Task, start: tuple[float, float, float], *, keep_alpha: bool = False, most_steps: int = 200) -> Polish:
    """Return the continuous optimum below a design (alpha, beta, gamma) in rad: damped Gauss-Newton.

    Angles stay within `LIMIT`; keep_alpha holds the first one. A step into what is infeasible is
    shortened. In a flat valley it ends after most_steps once a millionth of the cost is left, with the slope
    in the result. Raises Infeasible for a start that is, DidNotConverge with the slope left.
    """
    x = np.clip(np.array(start, dtype=np.float64), -LIMIT, LIMIT)
    movable, damping = np.array([not keep_alpha, True, True]), 1e-3
    begun = residuals(task, x)
    if not np.isfinite(begun).all():
        task.design(*start)  # says why
        raise Infeasible("the start of the polish lies too close to +-90 deg; start from another design")
    for steps in range(most_steps):
        r, jac = residuals(task, x), jacobian(task, x)
        gradient = jac.T @ r
        free = movable & ~((np.abs(x) >= LIMIT) & (gradient * np.sign(x) < 0))
        jac, gradient = jac * free, gradient * free
        slope = 2 * float(np.linalg.norm(gradient))
        following, damping = _step(task, x, jac.T @ jac, gradient, damping)
        if following is None or slope <= 1e-12:
            return _polished(task, x, slope, steps)
        x = following
    if r @ r <= 1e-6 * (begun @ begun):
        return _polished(task, x, slope, most_steps)
    raise DidNotConverge(
        f"polish from {np.round(np.degrees(start), 3)} deg: slope {slope:.2g} 1/rad left after {most_steps} steps;"
        " start closer, or allow more steps"
    )


def _step(task: Task, x: Array, normal: Array, gradient: Array, damping: float) -> tuple[Array | None, float]:
    """Return the next angles and damping, or None when no step lowers the cost any more."""
    before = residuals(task, x)
    while damping < 1e12:
        scaled = normal + np.diag(damping * np.diag(normal) + 1e-15)  # an angle that is held has a gradient of 0
        trial = np.clip(x - np.linalg.solve(scaled, gradient), -LIMIT, LIMIT)
        after = residuals(task, trial)
        if np.isfinite(after).all() and after @ after < before @ before * (1 - 1e-14):
            return trial, max(damping / 10, 1e-12)
        damping *= 4
    return None, damping


def _polished(task: Task, x: Array, slope: float, steps: int) -> Polish:
    found = task.design(*map(float, x))
    names = zip(("alpha", "beta", "gamma"), x, strict=True)
    ends = " and ".join(f"{name} -> {90 * np.sign(angle):+.0f} deg" for name, angle in names if abs(angle) >= LIMIT)
    boundary = f"{ends}: the cost still falls there, and at the limit itself the design is infeasible" if ends else ""
    return Polish(design=found, cost=task.cost_of(found), slope=slope, steps=steps, boundary=boundary)


def approach(task: Task, start: Design, alphas: ArrayLike) -> list[Polish]:
    """Return the best design at each fixed alpha (rad), each started from the one before: the way to the boundary."""
    found: list[Polish] = []
    beta, gamma, last = start.beta_rad, start.gamma_rad, start.alpha_rad
    for alpha in np.atleast_1d(alphas):
        beta = float(np.clip(beta + np.sign(beta) * (abs(alpha) - abs(last)), -np.pi / 2, np.pi / 2))
        found.append(polish(task, (float(alpha), beta, gamma), keep_alpha=True))
        beta, gamma, last = found[-1].design.beta_rad, found[-1].design.gamma_rad, float(alpha)
    return found


@dataclass(frozen=True, kw_only=True)
class Scatter:
    """Standard deviations of what is made by hand: winding angles, tube radius, volume ratio filled; and the draw."""

    angle: float = option(1 * DEGREE, unit="rad", least=0.0)
    radius: float = option(0.1 * MM, unit="m", least=0.0)
    volume_ratio: float = option(0.01, least=0.0)
    samples: int = option(10_000, least=10, most=10_000_000)
    seed: int = option(2019, least=0)


@dataclass(frozen=True, kw_only=True)
class Bar:
    """One quantity moved down and up by `by`, the others kept: radius of the helix (m) and cost; NaN: infeasible."""

    what: str
    by: float
    unit: str
    radius_m: tuple[float, float]
    cost: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """How a design suffers from scatter: bars of one deviation each, and 5, 50, 95 % quantiles of all together.

    failed: the share of samples that the fibres do not allow; quantiles are over the others, NaN when
    there are none.
    """

    bars: tuple[Bar, ...]
    radius_m: tuple[float, float, float]
    cost: tuple[float, float, float]
    failed: float
    scatter: Scatter


def tolerance(task: Task, found: Design, scatter: Scatter | None = None) -> Tolerance:
    """Return how cost and helix radius of a design react to scatter of angles, radius and volume ratio.

    Independent normal deviations. Raises Infeasible when the design itself is not feasible for the task.
    """
    scatter = scatter or Scatter()
    at = np.array([found.alpha_rad, found.beta_rad, found.gamma_rad, task.radius, task.volume_ratio])
    task.design(*map(float, at[:3]))
    names = ("alpha", "beta", "gamma", "radius", "volume ratio")
    by = np.array([scatter.angle] * 3 + [scatter.radius, scatter.volume_ratio])
    radius, cost = _responses(task, at[:, None, None] + np.eye(5)[:, :, None] * by[:, None, None] * np.array([-1, 1]))
    bars = tuple(
        Bar(what=name, by=float(by[i]), unit=unit, radius_m=_pair(radius[i]), cost=_pair(cost[i]))
        for i, (name, unit) in enumerate(zip(names, ("rad", "rad", "rad", "m", "1"), strict=True))
    )
    draw = np.random.default_rng(scatter.seed).standard_normal((5, scatter.samples))
    radius, cost = _responses(task, at[:, None] + by[:, None] * draw)
    failed = float(np.mean(~np.isfinite(cost)))
    return Tolerance(bars=bars, radius_m=_quantiles(radius), cost=_quantiles(cost), failed=failed, scatter=scatter)


def _responses(task: Task, points: Array) -> tuple[Array, Array]:
    """Return (R, cost) at points (5, ...): three angles in rad, tube radius, volume ratio; NaN where infeasible."""
    radius, volume = points[3:]
    inside = (np.abs(points[:3]) <= np.pi / 2).all(axis=0) & (radius > 0) & (volume > 0)
    safe = [np.where(inside, value, other) for value, other in zip(points, (1, -1, 0, task.radius, 1), strict=True)]
    with np.errstate(invalid="ignore", divide="ignore"):
        pair = inflate(safe[0], safe[1], safe[4])
        helix = bend(pair, safe[2], radius=safe[3], length=task.length, torsion=task.torsion)
        good = inside & (helix.state == HelixState.VALID)
        cost = task.cost(helix.radius_m, helix.length_ratio, helix.twist_rad)
        return np.where(good, helix.radius_m, np.nan), np.where(good, cost, np.nan)


def _pair(values: Array) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def _quantiles(values: Array) -> tuple[float, float, float]:
    known = values[np.isfinite(values)]
    low, middle, high = np.quantile(known, [0.05, 0.5, 0.95]) if len(known) else [np.nan] * 3
    return float(low), float(middle), float(high)
