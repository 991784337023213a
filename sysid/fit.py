"""Models side by side: each fitted, and judged on data it was not fitted to."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput
from sysid.nonnegative import solve, triangle
from sysid.terms import Branch, Experiment, Other, Play, Power, Stop, Term, VelocitySign

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Five operators, spread evenly in the logarithm from just above the noise to almost the whole
# span. On the real recordings more gain at most 5 % of the held-out error, or lose (the motor).
SHARES = tuple(float(f"{share:.3g}") for share in np.geomspace(0.002, 0.9, 5))


@dataclass(frozen=True)
class Model:
    """A response that is linear in its weights: `free` terms of any sign, others not negative."""

    name: str
    free: tuple[Term, ...]
    nonnegative: tuple[Term, ...] = ()

    @property
    def terms(self) -> tuple[Term, ...]:
        """All terms, free ones first."""
        return self.free + self.nonnegative


# Two models in one: each branch with a constant and a cubic of its own (thesis 3.3.5 asks for them).
TWO_BRANCHES = Model(
    "cubic, rising and falling apart", tuple(Branch(n, rising) for rising in (True, False) for n in range(4))
)


@dataclass(frozen=True)
class Split:
    """Which samples are fitted when the others are held out: a name for reports and a mask (n,)."""

    name: str
    fitted: Mask


@dataclass(frozen=True, eq=False)
class Fit:
    """One model on one experiment. rmse and residuals are in the response's unit.

    weights (k,) and rmse come from all samples; held_out_rmse from the samples that the split
    holds out, with weights fitted to the others. fit_percent = 100 (1 - |error| / |y - mean y|),
    both norms over the same samples. extrapolated: share of held-out samples whose leverage is
    twice the 99th percentile of the fitted ones' or more: far from what was fitted, in the space of the
    regressors. Near 0 for samples alike.
    """

    model: Model
    weights: Array
    predicted: Array
    rmse: float
    fit_percent: float
    held_out_rmse: float
    held_out_fit_percent: float
    extrapolated: float
    condition: float
    split: str
    seconds: float

    @property
    def parameters(self) -> int:
        """How many weights the model has."""
        return len(self.weights)

    @property
    def active(self) -> int:
        """How many weights are not zero."""
        return int(np.count_nonzero(self.weights))


def candidates(others: tuple[str, ...]) -> tuple[Model, ...]:
    """Return the models that a replay compares, those with further signals only if there are any.

    "thesis" is eq. 3.28 without its rates; Maxwell slip is a spring in parallel with springs that
    slip; the play models are Prandtl-Ishlinskii.
    """
    constant, cubic = (Power(0),), (Power(1), Power(2), Power(3))
    helpers = tuple(Other(topic) for topic in others)
    named = " + " + " + ".join(term.name for term in helpers) if helpers else ""
    plays, stops = tuple(map(Play, SHARES)), tuple(map(Stop, SHARES))
    with_helpers = (
        (
            Model(named.removeprefix(" + "), constant + helpers),
            Model(f"cubic{named}", constant + cubic + helpers),
        )
        if helpers
        else ()
    )
    return (
        Model("cubic, weights >= 0 (thesis)", constant, cubic),
        Model("cubic, signed", constant + cubic),
        *with_helpers,
        Model(f"cubic{named} + sign(v)", constant + cubic + helpers + (VelocitySign(),)),
        Model(f"cubic{named} + play >= 0", constant + cubic + helpers, plays),
        Model(f"cubic{named} + play, signed", constant + cubic + helpers + plays),
        Model(f"Maxwell slip{named}", constant + helpers + (Power(1),), stops),
        Model(f"Maxwell slip{named} + cubic", constant + helpers + cubic, stops),
    )


def second_half(experiment: Experiment) -> Split:
    """Fit the first half of the time, hold out the second."""
    middle = (experiment.time_s[0] + experiment.time_s[-1]) / 2
    return Split("second half held out", np.asarray(experiment.time_s < middle))


def alternate_steps(experiment: Experiment, least: float = 0.02) -> Split:
    """Fit every other level of a staircase, hold out those between.

    A level ends where the input jumps by more than `least` of its span from one sample to the
    next. Raises BadInput when there are fewer than 4 levels.
    """
    jumps = np.flatnonzero(np.abs(np.diff(experiment.input)) > least * experiment.span)
    starts = jumps[np.diff(jumps, prepend=-len(experiment)) > max(2, len(experiment) // 400)] + 1
    if len(starts) < 3:
        raise BadInput("split 'steps'", f"the input has {len(starts) + 1} levels", "at least 4 are needed")
    level = np.searchsorted(starts, np.arange(len(experiment)), side="right")
    return Split(f"every other of {len(starts) + 1} steps held out", level % 2 == 0)


SPLITS = {"half": second_half, "steps": alternate_steps}


def fit(model: Model, experiment: Experiment, split: Split) -> Fit:
    """Fit a model to all samples, and again to the split's, and measure both.

    Raises BadInput for an input that never changes, too few samples, or values that are not finite.
    """
    started = time.perf_counter()
    if len(experiment) <= len(model.terms) or experiment.span == 0:
        raise BadInput(model.name, f"{len(experiment)} samples over an input span of {experiment.span:g}")
    columns = np.column_stack([term.column(experiment) for term in model.terms])
    y, free = experiment.response, len(model.free)
    solution = solve(columns, y, free)
    trained = solve(columns[split.fitted], y[split.fitted], free)
    seconds = time.perf_counter() - started
    predicted, unseen = columns @ solution.weights, ~split.fitted
    held = y[unseen] - columns[unseen] @ trained.weights
    return Fit(
        model=model,
        weights=solution.weights,
        predicted=predicted,
        rmse=rms(y - predicted),
        fit_percent=fit_percent(y, y - predicted),
        held_out_rmse=rms(held),
        held_out_fit_percent=fit_percent(y[unseen], held),
        extrapolated=_extrapolated(columns, split.fitted),
        condition=solution.condition,
        split=split.name,
        seconds=seconds,
    )


def compare(models: Sequence[Model], experiment: Experiment, split: Split) -> list[Fit]:
    """Fit every model, in order. What is compiled or imported on first use is so before the clock runs."""
    warm = Experiment(np.arange(9.0), np.arange(9.0) ** 2, np.arange(9.0))
    fit(Model("warm-up", (Power(0),), (Play(0.5),)), warm, second_half(warm))
    fit(models[0], experiment, split)  # and the first touch of this much memory
    return [fit(model, experiment, split) for model in models]


def rms(error: Array) -> float:
    """Return the root mean square, NaN for no samples. (Thesis eq. 3.32 prints it without 1/N.)"""
    return float(np.sqrt(np.mean(error**2))) if len(error) else float("nan")


def fit_percent(y: Array, error: Array) -> float:
    """Return 100 (1 - |error| / |y - mean y|), the normalised fit; NaN for a constant y."""
    spread = float(np.linalg.norm(y - y.mean())) if len(y) else 0.0
    return 100 * (1 - float(np.linalg.norm(error)) / spread) if spread else float("nan")


def _extrapolated(columns: Array, fitted: Mask) -> float:
    """Return the share of held-out rows beyond twice the 99th percentile of the fitted rows' leverage."""
    if fitted.all() or not fitted.any():
        return 0.0
    largest = np.abs(columns).max(axis=0)
    scaled = columns / np.where(largest > 0, largest, 1)
    reduced = triangle(scaled[fitted], np.zeros(int(fitted.sum())))[:, :-1]
    _, singular, right = np.linalg.svd(reduced)
    weak = singular < 1e-9 * singular[0]
    whitened = scaled @ right.T / np.where(weak, 1e-9 * singular[0], singular)
    leverage = np.einsum("ij,ij->i", whitened, whitened)
    return float(np.mean(leverage[~fitted] > 2 * np.quantile(leverage[fitted], 0.99)))
