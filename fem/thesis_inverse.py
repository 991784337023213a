"""The thesis's own inverse method (6.3 to 6.28), for comparison with fem.inverse; its misprints corrected.

Corrected: 6.7 and 6.10 lack a transpose and disagree in sign, 6.15 and 6.18 have the opposite sign of 6.10
(as printed the strain update goes uphill), 6.28 prints a sum where rows are stacked, Algorithm 3 as
printed keeps exactly the differences that the text leaves unpenalised. Its sum over load steps (6.24) is
replaced by what it amounts to for a hyperelastic body, the converged tangent; its lambda I (6.26) is kept.
fmincon's SQP is one exact step: the three penalties, linearised and stacked, are minimised in the bounds by
block pivoting (fem.regular.boxed).
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from data.errors import DidNotConverge
from data.signal import Array
from fem.observation import Seen
from fem.regular import boxed
from fem.voxels import Standing, Voxels

MOST_CONDITION = 1e12
FIRST_LAMBDA = 1e-3
UNTOUCHED = 0.3  # differences beyond this share of the bounds' width are not smoothed


@dataclass(frozen=True, eq=False)
class ThesisStep:
    """One update: moduli (v,) [Pa], root mean square misfit over the largest displacement, seconds since the start."""

    moduli: Array
    misfit: float
    seconds: float


@dataclass(frozen=True, kw_only=True)
class ThesisWeights:
    """w1, w2, w3 of displacement, strain and similarity (bend 2, 0, 1; twist 0, 1, 0), set by hand for each motion.

    classes: for so many first iterations the moduli are thresholded into two classes (twist: 4).
    """

    displacement: float
    strain: float
    similarity: float
    classes: int = 0
    most: int = field(default=20)


def thesis_inverse(  # noqa: PLR0917
    voxels: Voxels,
    seen: Seen,
    seed: Array,
    pairs: Any,
    bounds: tuple[float, float],
    weights: ThesisWeights,
    progress: Callable[[ThesisStep], None] | None = None,
) -> list[ThesisStep]:
    """Return the thesis's iterations from a seed (v,) [Pa] on displacements of nodes.

    The update of the moduli themselves, within bounds, is halved only where the map does not bear the
    pressure, eight times before the run ends there. pairs: neighbours' differences (p, v).
    """
    started, done = time.perf_counter(), list[ThesisStep]()
    moduli, low, high = np.clip(seed, *bounds), *bounds
    try:
        standing = voxels.inflate(np.log(moduli), seen.pressure)
        for number in range(weights.most + 1):
            misfit = seen.misfit(standing.state.x)
            rms = float(np.sqrt((misfit**2).mean())) / seen.size
            done.append(ThesisStep(moduli, rms, time.perf_counter() - started))
            if progress:
                progress(done[-1])
            if number == weights.most or rms < 1e-6:
                break
            change = _update(voxels, standing, seen, misfit, moduli, pairs, (low, high), weights)
            standing = _borne(voxels, standing, moduli, change, number < weights.classes)
            moduli = np.exp(standing.log)
    except DidNotConverge:
        return done
    return done


def _borne(voxels: Voxels, standing: Standing, moduli: Array, change: Array, classes: bool) -> Standing:
    """Return the equilibrium after a change of the moduli, or the largest half, quarter ... of it that stands."""
    for halved in range(9):
        wanted = moduli + change / 2**halved
        try:
            return voxels.moved(standing, np.log(two_classes(wanted) if classes else wanted))
        except DidNotConverge:
            if halved == 8:
                raise
    raise AssertionError


def _update(  # noqa: PLR0917
    voxels: Voxels, standing: Standing, seen: Seen, misfit: Array, moduli: Array, pairs: Any,
    bounds: tuple[float, float], weights: ThesisWeights,
) -> Array:  # fmt: skip
    """Return the change of the moduli (v,) [Pa] that minimises the three penalties (6.3, linearised)."""
    unknowns = regularised(voxels, standing) / moduli  # over moduli, not their logarithms
    everywhere = voxels.onto(standing.state.x)
    curvature, rise = np.zeros((len(moduli), len(moduli))), np.zeros(len(moduli))
    if weights.displacement:
        slope = (seen.rows @ everywhere) @ unknowns / seen.size
        curvature += weights.displacement * slope.T @ slope
        rise += weights.displacement * slope.T @ (misfit / seen.size)
    if weights.strain:
        strain = strains(voxels)
        left = (seen.rows.T @ misfit).reshape(-1)
        slope = (strain @ everywhere) @ unknowns
        curvature += weights.strain * slope.T @ slope
        rise += weights.strain * slope.T @ (strain @ left)
    if weights.similarity:
        step = pairs @ moduli
        alike = pairs[np.abs(step) <= UNTOUCHED * (bounds[1] - bounds[0])] / bounds[1]
        curvature += weights.similarity * np.asarray((alike.T @ alike).todense())
        rise += weights.similarity * (alike.T @ (alike @ moduli))
    scale = float(np.trace(curvature)) / len(moduli)
    curvature[np.diag_indices(len(moduli))] += 1e-10 * scale
    return boxed(curvature, rise, bounds[0] - moduli, bounds[1] - moduli)


def regularised(voxels: Voxels, standing: Standing) -> Array:
    """Return -(K + lambda I)^-1 dF/d(log moduli) (k, v) (6.24, 6.26): lambda where the condition demands it.

    lambda is in units of the mean diagonal of K, whose own condition is taken from its factor by norms of one vector.
    """
    slopes = voxels.slopes(standing).toarray(order="F")
    plain = standing.tangent.solve(slopes)
    vector = np.random.default_rng(0).standard_normal((len(slopes), 1))
    for _ in range(20):  # power iteration: the largest eigenvalue of the inverse, the least of K
        vector = standing.tangent.solve(vector / np.linalg.norm(vector))
    least, largest = 1 / float(np.linalg.norm(vector)), float(voxels.stiffest(standing))
    amount = 0.0 if largest / least < MOST_CONDITION else FIRST_LAMBDA * largest
    return np.asarray(-plain if not amount else -plain + amount * standing.tangent.solve(plain))


def strains(voxels: Voxels) -> Any:
    """Return the six linearised strains at each element's centre over displacements (6e, 3n), sparse (2.58)."""
    from scipy.sparse import coo_array

    mean = voxels.system.body.gradient.mean(axis=1)  # (e, a, 3)
    count, nodes = mean.shape[:2]
    rows, columns, values = [], [], []
    hexes = voxels.mesh.hexes
    for k, (i, j) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))):
        for a, b in {(i, j), (j, i)}:
            rows.append(np.repeat(6 * np.arange(count) + k, nodes))
            columns.append((3 * hexes + a).ravel())
            values.append(mean[:, :, b].ravel() * (1.0 if i == j else 0.5))
    places = np.concatenate(rows), np.concatenate(columns)
    return coo_array((np.concatenate(values), places), shape=(6 * count, 3 * len(voxels.mesh.nodes))).tocsr()


def two_classes(moduli: Array) -> Array:
    """Return each modulus as the mean of its class: K-means with two clusters, from the extremes."""
    centres = np.array([moduli.min(), moduli.max()])
    for _ in range(100):
        nearest = np.abs(moduli[:, None] - centres).argmin(axis=1)
        fresh = np.array([moduli[nearest == k].mean() if (nearest == k).any() else centres[k] for k in (0, 1)])
        if np.array_equal(fresh, centres):
            break
        centres = fresh
    return np.asarray(centres[np.abs(moduli[:, None] - centres).argmin(axis=1)])


def thesis_seed(voxels: Voxels, seen: Seen, bounds: tuple[float, float]) -> Array:
    """Return the thesis's seed (v,) [Pa]: Hooke's law between hoop stress (6.29) and hoop strain at the target.

    For internal pressure P and closed ends the bore's stresses are radial -P, hoop P (o^2 + i^2) / (o^2 - i^2),
    axial P i^2 / (o^2 - i^2) (6.29 is printed otherwise); c1 is a sixth of Young's modulus.
    """
    rest = voxels.mesh.nodes
    moved = (seen.rows.T @ seen.target).reshape(-1, 3)
    centre = rest[voxels.mesh.hexes].mean(axis=1)
    turned = np.arctan2(centre[:, 1], centre[:, 0])
    body = np.stack([-np.sin(turned), np.cos(turned)], axis=1)
    strain = (strains(voxels) @ moved.ravel()).reshape(-1, 6)
    hoop = strain[:, 0] * body[:, 0] ** 2 + strain[:, 1] * body[:, 1] ** 2 + 2 * strain[:, 3] * body.prod(axis=1)
    radius = np.hypot(rest[:, 0], rest[:, 1])
    outer, inner = float(radius.max()), float(radius[np.unique(voxels.mesh.pressed)].max())
    inner = float(radius[voxels.mesh.hexes].min()) if inner >= outer else inner
    stress = seen.pressure * (outer**2 + inner**2) / (outer**2 - inner**2)
    of_element = stress / np.maximum(hoop, 1e-6) / 6
    inside = voxels.which >= 0
    total = np.bincount(voxels.which[inside], of_element[inside], minlength=voxels.count)
    return np.asarray(np.clip(total / np.bincount(voxels.which[inside]), *bounds))
