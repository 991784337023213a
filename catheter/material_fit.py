"""Materials from tensile tests: five laws, numbers with intervals over specimens, what speaks for which law.

Every specimen counts alike: its squares are divided by its samples. Intervals are percentiles over
resamples of whole specimens, because samples of one specimen are no independent witnesses.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from catheter.laws import LINEAR, NUMBERS, OGDEN, Stability, columns, drucker
from catheter.tensile import Rested, Specimen, Toe, rested
from data.errors import BadInput
from data.options import option
from data.signal import Array
from fem.material import Law, Ogden

LEAST_IN_RANGE = 8
LEAST_SQUARE = 1e-12  # Pa^2: below it a residual is rounding
POWERS = np.concatenate([np.linspace(-12, -0.1, 60), np.linspace(0.1, 12, 60)])  # of Ogden's term


@dataclass(frozen=True, kw_only=True)
class Tensile:
    """How materials are fitted: strain range from the stress-free state, resamples of specimens, interval's level."""

    most_strain: float = option(1.0, least=0.1, most=20.0)
    resamples: int = option(400, least=50, most=100_000)
    level: float = option(0.95, least=0.5, most=0.999)
    seed: int = option(0, least=0)
    nu: float = option(0.499, least=0.0, most=0.499999)
    toe: Toe = field(default_factory=Toe)


@dataclass(frozen=True, eq=False)
class LawFit:
    """One law on all specimens: numbers (k,), their interval, each specimen's own (s, k), distance and stability.

    low, high (k,): the interval, NaN where one specimen tells nothing of others.
    aicc: Akaike's criterion of the specimens' own fits, summed, their samples taken for independent:
    some tens in favour of a law that holds another may come from the zero's own error. chosen_by:
    specimens of which it is the least. rms: of the common fit, over the specimens [Pa]; own_rms: of
    their own fits [Pa].
    """

    name: str
    numbers: tuple[str, ...]
    law: Law
    values: Array
    low: Array
    high: Array
    each: Array
    rms: float
    own_rms: float
    aicc: float
    chosen_by: int
    stability: Stability


@dataclass(frozen=True, eq=False)
class MaterialFit:
    """Specimens without their toes, the laws that were fitted, and how far the material goes.

    elongation: the least strain at the greatest stress [1]; strength: the median greatest stress [Pa]; both are
    lower bounds unless all broke. left_out: laws whose best numbers make no solid, and why.
    """

    specimens: tuple[Rested, ...]
    laws: dict[str, LawFit]
    left_out: dict[str, str]
    elongation: float
    strength: float
    broke: int
    options: Tensile

    @property
    def preferred(self) -> LawFit:
        """The law of least AICc among those that are stable; raises BadInput if none is."""
        sound = [fit for fit in self.laws.values() if fit.stability.everywhere]
        if not sound:
            raise BadInput("material", "no law is stable over its range", "fit a smaller range")
        return min(sound, key=lambda fit: fit.aicc)


def fit_material(
    tests: Sequence[Specimen], options: Tensile | None = None, progress: Callable[[float], None] | None = None
) -> MaterialFit:
    """Fit every law by least squares on engineering stress. Raises BadInput for too few samples in the range."""
    chosen = options or Tensile()
    free = tuple(rested(test, chosen.toe) for test in tests)
    pieces = [_ranged(one, chosen.most_strain) for one in free]
    laws: dict[str, LawFit] = {}
    left_out: dict[str, str] = {}
    for done, name in enumerate(NUMBERS):
        try:
            laws[name] = _fit(name, pieces, chosen)
        except BadInput as error:
            left_out[name] = str(error)
        if progress:
            progress((done + 1) / len(NUMBERS))
    return MaterialFit(
        specimens=free,
        laws=_compared(laws, pieces),
        left_out=left_out,
        elongation=min(float(one.strain[-1]) for one in free),
        strength=float(np.median([one.stress[-1] for one in free])),
        broke=sum(one.broke is True for one in free),
        options=chosen,
    )


@dataclass(frozen=True, eq=False)
class _Piece:
    """A specimen's samples within the range: stretch (n,), stress (n,) [Pa]."""

    stretch: Array
    stress: Array


def _ranged(one: Rested, most: float) -> _Piece:
    inside = (one.strain > 0) & (one.strain <= most)
    if inside.sum() < LEAST_IN_RANGE:
        found = f"has {inside.sum()} samples at strains of 0 to {most:g}"
        raise BadInput(f"specimen {one.name}", found, f"expected {LEAST_IN_RANGE} or more: widen the range")
    return _Piece(1 + one.strain[inside], one.stress[inside])


def make_law(name: str, values: Array, nu: float, title: str = "", elongation: float = np.inf) -> Law:
    """Return the law of that name with its numbers, as `LawFit.values` has them. Raises BadInput for no solid."""
    numbers = [float(v) for v in values]
    made = Ogden((numbers[0],), (numbers[1],)) if name == OGDEN else LINEAR[name][1](numbers)
    return replace(made, nu=nu, name=title, elongation=elongation)


def _fit(name: str, pieces: list[_Piece], options: Tensile) -> LawFit:
    """Return a law's common fit, its specimens' own, and intervals; AICc is left to the comparison."""
    solve = _Ogden(pieces) if name == OGDEN else _Linear(name, pieces)
    alone = np.eye(len(pieces))
    values, each = solve(np.ones(len(pieces))), np.stack([solve(one) for one in alone])
    draw = np.random.default_rng(options.seed)
    picks = draw.multinomial(len(pieces), np.full(len(pieces), 1 / len(pieces)), size=options.resamples)
    resampled = np.stack([solve(pick.astype(np.float64)) for pick in picks])
    tail = (1 - options.level) / 2
    low, high = np.quantile(resampled, [tail, 1 - tail], axis=0)
    if len(pieces) == 1:
        low, high = np.full_like(low, np.nan), np.full_like(high, np.nan)
    made = make_law(name, values, options.nu)
    squares = [_square(name, values, piece) for piece in pieces]
    own = [_square(name, value, piece) for value, piece in zip(each, pieces, strict=True)]
    return LawFit(
        name=name,
        numbers=NUMBERS[name],
        law=made,
        values=values,
        low=low,
        high=high,
        each=each,
        rms=float(np.sqrt(np.mean(squares))),
        own_rms=float(np.sqrt(np.mean(own))),
        aicc=np.nan,
        chosen_by=0,
        stability=drucker(made, max(1 + options.most_strain, 2.0)),
    )


class _Linear:
    """Least squares of a law that is linear in its numbers; each specimen reduced to a triangle once."""

    def __init__(self, name: str, pieces: list[_Piece]) -> None:
        blocks = [np.column_stack([columns(name, p.stretch), p.stress]) / np.sqrt(len(p.stress)) for p in pieces]
        self.triangles = np.stack([np.linalg.qr(block, mode="r") for block in blocks])

    def __call__(self, weights: Array) -> Array:
        """Return the numbers (k,) for weights of the specimens (s,)."""
        rows = (np.sqrt(weights)[:, None, None] * self.triangles).reshape(-1, self.triangles.shape[-1])
        return np.asarray(np.linalg.lstsq(rows[:, :-1], rows[:, -1], rcond=None)[0])


class _Ogden:
    """Least squares of Ogden's law of one term: the power by search, the modulus follows from it."""

    def __init__(self, pieces: list[_Piece]) -> None:
        self.stretch = np.concatenate([p.stretch for p in pieces])
        self.stress = np.concatenate([p.stress for p in pieces])
        self.number = np.repeat(np.arange(len(pieces)), [len(p.stress) for p in pieces])
        self.share = 1 / np.bincount(self.number)
        self.tried = np.stack([self._column(power) for power in POWERS])

    def _column(self, power: float) -> Array:
        return np.asarray(self.stretch ** (power - 1) - self.stretch ** (-power / 2 - 1))

    def _left(self, column: Array, weight: Array) -> Array:
        """Return the squares left (...,) by columns (..., n), each with its best modulus, less those of the stress."""
        return np.asarray(-((column @ (weight * self.stress)) ** 2) / (column**2 @ weight))

    def __call__(self, weights: Array) -> Array:
        """Return (mu [Pa], alpha) for weights of the specimens (s,)."""
        from scipy.optimize import minimize_scalar

        weight = (weights * self.share)[self.number]
        at = int(np.argmin(self._left(self.tried, weight)))
        ends = POWERS[max(at - 1, 0)], POWERS[min(at + 1, len(POWERS) - 1)]
        found = minimize_scalar(lambda a: float(self._left(self._column(a), weight)), bounds=ends, method="bounded")
        column = self._column(found.x)
        return np.array([(column @ (weight * self.stress)) / (column**2 @ weight), found.x])


def _square(name: str, values: Array, piece: _Piece) -> float:
    """Return the mean square residual of a specimen [Pa^2]."""
    return float(np.mean(_residual(name, values, piece) ** 2))


def _residual(name: str, values: Array, piece: _Piece) -> Array:
    if name in LINEAR:
        return piece.stress - columns(name, piece.stretch) @ values
    mu, alpha = values
    return np.asarray(piece.stress - mu * (piece.stretch ** (alpha - 1) - piece.stretch ** (-alpha / 2 - 1)))


def _compared(laws: dict[str, LawFit], pieces: list[_Piece]) -> dict[str, LawFit]:
    """Return the laws with n ln(mean square) + 2 k + 2 k (k + 1) / (n - k - 1) summed over specimens, and its winners.

    n samples of a specimen, k numbers of its law and the variance.
    """
    table = {}
    for name, fit in laws.items():
        squares = np.array([_square(name, value, piece) for value, piece in zip(fit.each, pieces, strict=True)])
        n, k = np.array([len(piece.stress) for piece in pieces]), fit.values.size + 1
        table[name] = n * np.log(np.maximum(squares, LEAST_SQUARE)) + 2 * k + 2 * k * (k + 1) / (n - k - 1)
    won = np.argmin(np.stack(list(table.values())), axis=0)
    return {
        name: replace(fit, aicc=float(table[name].sum()), chosen_by=int((won == index).sum()))
        for index, (name, fit) in enumerate(laws.items())
    }
