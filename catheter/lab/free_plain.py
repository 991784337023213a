"""The plain ways that ours is measured against: one design at a time, Newton's method as it stands."""

import math

import numpy as np

from catheter.free import Array, stretch
from catheter.task import Task


def plain_cost(task: Task, alpha: float, beta: float, gamma: float) -> float:
    """Return the cost of one design as a plain program finds it, formula by formula; NaN where there is none.

    Newton's method in 13 volumes from rest, halved back where it leaves the fibres' range.
    """
    ca, cb, sa, sb = math.cos(alpha), math.cos(beta), math.sin(alpha), math.sin(beta)
    s = math.sin(alpha - beta)
    if min(abs(s), abs(sa), abs(sb)) < 1e-9 or abs(gamma) > math.pi / 2 - 1e-9:
        return math.nan
    end = 1 / max(ca, cb)
    l1 = 1.0
    try:
        rising = 1 + 2 * ca * cb / (sa * sb) > 0
        for step in range(1, 13):
            wanted = 1 + (task.volume_ratio - 1) * step / 12
            for _ in range(30):
                qa, qb = math.sqrt(1 - (l1 * ca) ** 2), math.sqrt(1 - (l1 * cb) ** 2)
                l2 = (math.copysign(qa, alpha) * cb - math.copysign(qb, beta) * ca) / s
                slope = (-cb * l1 * ca**2 / math.copysign(qa, alpha) + ca * l1 * cb**2 / math.copysign(qb, beta)) / s
                error, slope = l1 * l2**2 - wanted, l2**2 + 2 * l1 * l2 * slope
                if abs(error) < 1e-14:
                    break
                l1 = l1 - error / slope if l1 - error / slope < end else (l1 + end) / 2
            if abs(error) > 1e-9 or (slope > 0) != rising:
                return math.nan
    except (ValueError, ZeroDivisionError, OverflowError):
        return math.nan
    a, b = math.copysign(math.sqrt(1 - (l1 * ca) ** 2), alpha), math.copysign(math.sqrt(1 - (l1 * cb) ** 2), beta)
    l2, d = (a * cb - b * ca) / s, (b * sa - a * sb) / (a * cb - b * ca)
    around = l2 * (math.sin(gamma) + d * math.cos(gamma))
    if abs(around) > 1:
        return math.nan
    limiter = math.sqrt(1 - around**2) / math.cos(gamma)
    if limiter >= l1 * (1 - 1e-9):
        return math.nan
    rho = l1 * l2 * task.radius / (l1 - limiter)
    tau = (d + math.tan(gamma)) / task.radius / (l1 if task.torsion == "exact" else 1)
    radius = rho / (1 + (tau * rho) ** 2)
    ratio = l1 * abs(math.sin(math.atan(tau * rho)))
    twist = d * task.length / task.radius
    return float(task.cost(np.array(radius), np.array(ratio), np.array(twist)))


def newton_finds(alpha: Array, beta: Array, volumes: Array, *, iterations: int, halve: bool) -> Array:
    """Return where Newton's method ends (n,), from l1 = 1 through volume ratios (k,) in turn; NaN where it does not.

    It counts as found when V is met to 1e-9 and dV/dl1 kept its sign. halve: steps past where a fibre lies
    along the axis go half-way there instead. With one volume and no halving it is the thesis's way.
    """
    x, end = np.ones_like(alpha), 1 / np.maximum(np.cos(alpha), np.cos(beta))
    found = np.ones(alpha.shape, bool)
    with np.errstate(all="ignore"):
        rising = _volume(alpha, beta, x)[1] > 0
        for wanted in volumes:
            for _ in range(iterations):
                volume, slope = _volume(alpha, beta, x)
                following = x - (volume - wanted) / slope
                x = np.where(halve & (following >= end), (x + end) / 2, following)
            volume, slope = _volume(alpha, beta, x)
            found &= (np.abs(volume - wanted) < 1e-9) & ((slope > 0) == rising)
    return np.where(found, x, np.nan)


def _volume(alpha: Array, beta: Array, axial: Array) -> tuple[Array, Array]:
    """Return V and dV/dl1 by thesis eq. 3.12 and 3.14 and its quotient's derivative, as they stand."""
    ca, cb = np.cos(alpha), np.cos(beta)
    radial = stretch(alpha, beta, axial)[0]
    qa = np.sign(alpha) * np.sqrt(1 - (axial * ca) ** 2)
    qb = np.sign(beta) * np.sqrt(1 - (axial * cb) ** 2)
    slope = (-cb * axial * ca**2 / qa + ca * axial * cb**2 / qb) / np.sin(alpha - beta)
    return axial * radial**2, radial**2 + 2 * axial * radial * slope
