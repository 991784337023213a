"""A response over an input and its two derivatives: the thesis's nine terms and a constant (eq. 3.27-3.34)."""

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput
from data.options import option
from sysid.estimate import Bootstrap, Estimate, Whiteness, estimate, ljung_box
from sysid.motion import DEFAULT, HALVES, METHODS, Motion, motion
from sysid.reduction import Reduction, reduce_blocks, reduce_rows
from sysid.selection import RULES, Selection, select

Array = NDArray[np.float64]

TERMS = tuple(f"{name}{power}" for name in ("x", "xd", "xdd") for power in ("^3", "^2", ""))


MOST_ROWS = 1 << 15  # of a stream, worked on at a time


@dataclass(frozen=True, kw_only=True)
class Identify:
    """How a model is identified: the rule that chooses, the derivatives' method, the weights' signs.

    The thesis's weights are not negative. constant_free: the constant may be; signed: all may be.
    """

    rule: str = option("1 %", choices=RULES)
    derivative: str = option(DEFAULT, choices=tuple(METHODS))
    half: int = option(0, least=0, most=10_000)  # 0: chosen by the noise, see `choose_half`
    constant_free: bool = True
    signed: bool = False


@dataclass(frozen=True, eq=False)
class Identification:
    """A certified sparse model of y over x: weights in y's unit over x's and seconds.

    choices: the terms each rule picks. held_out: the error on every other tenth of the time when
    selection and fit saw the rest only, and of what spread; second_half likewise for the second
    half. residual (m,) belongs to samples `used` (m,) of the recording.
    """

    selection: Selection
    reduction: Reduction
    chosen: Estimate
    choices: dict[str, tuple[str, ...]]
    held_out: float
    second_half: float
    whiteness: Whiteness
    motion: Motion
    columns: Array
    response: Array
    used: NDArray[np.int64]
    residual: Array
    seconds: float
    options: Identify

    @property
    def mask(self) -> int:
        """The chosen subset."""
        return self.selection.mask(self.chosen.names[1:])


def columns_of(moved: Motion) -> Array:
    """Return the nine regressors in the order of TERMS, (n, 9)."""
    rates = (moved.position, moved.velocity, moved.acceleration)
    return np.stack([rate**power for rate in rates for power in (3, 2, 1)], axis=1)


def identify(
    time_s: Array, x: Array, y: Array, options: Identify | None = None, bootstrap: Bootstrap | None = None
) -> Identification:
    """Identify y over x (n,), sampled at time_s. NaN stretches and gaps are left out and noted in `motion`.

    Raises BadInput for an x that never changes, too few samples, or stamps that do not increase.
    """
    chosen = options or Identify()
    begun = time.perf_counter()
    _check(x, y)
    moved = motion(time_s, x, chosen.derivative, chosen.half or None)
    used = np.flatnonzero(moved.known & np.isfinite(y))
    columns, response = columns_of(moved)[used], y[used]
    reduction = reduce_rows(TERMS, columns, response)
    selection = select(reduction, constant_free=chosen.constant_free, signed=chosen.signed)
    mask = selection.choose(chosen.rule)
    seconds = time.perf_counter() - begun
    residual = response - selection.constants[mask] - columns @ selection.weights[mask]
    return Identification(
        selection=selection,
        reduction=reduction,
        chosen=estimate(reduction, selection, mask, bootstrap),
        choices={rule: selection.names(selection.choose(rule)) for rule in RULES},
        held_out=held_out(reduction, chosen, (np.arange(len(reduction.rows)) * 10 // len(reduction.rows)) % 2 == 0),
        second_half=held_out(reduction, chosen, np.arange(len(reduction.rows)) < len(reduction.rows) // 2),
        whiteness=ljung_box(residual, min(20, len(residual) - 2)),
        motion=moved,
        columns=columns,
        response=response,
        used=used,
        residual=residual,
        seconds=seconds,
        options=chosen,
    )


def held_out(reduction: Reduction, options: Identify, fitted: NDArray[np.bool_]) -> float:
    """Select and fit on some units, (u,); return the RMSE on the others, NaN where either is too short."""
    seen, unseen = reduction.part(fitted), reduction.part(~fitted)
    if len(seen) <= len(reduction.terms) + 1 or not len(unseen):
        return float("nan")
    selection = select(seen, constant_free=options.constant_free, signed=options.signed)
    mask = selection.choose(options.rule)
    return unseen.rmse(float(selection.constants[mask]), selection.weights[mask])


def _check(x: Array, y: Array) -> None:
    sound = x[np.isfinite(x)]
    if len(sound) < 4 * METHODS[DEFAULT].least + 1 or not np.isfinite(y).any():
        raise BadInput("identification", f"{len(sound)} samples", "expected more than there are weights; record longer")
    if np.ptp(sound) <= 1e-9 * np.abs(sound).max():
        raise BadInput(
            "identification", f"the input stays at {sound[0]:.6g}", "no term differs from the constant; move it"
        )


def reduce_stream(pieces: Iterable[tuple[Array, Array, Array]], options: Identify | None = None) -> Reduction:
    """Reduce (time, x, y) piece by piece, in order: memory holds two pieces, whatever the recording's length.

    Half-widths are chosen piece by piece. Raises as `identify`.
    """
    return reduce_blocks(TERMS, _streamed(pieces, options or Identify()))


def _streamed(pieces: Iterable[tuple[Array, Array, Array]], options: Identify) -> Iterator[tuple[Array, Array]]:
    kept = np.empty((3, 0))
    reach, done = 4 * (options.half or HALVES[-1]), -np.inf
    for piece in _short(pieces):
        rows = np.concatenate([kept, piece], axis=1)
        if rows.shape[1] <= reach:
            kept = rows
            continue
        moved = motion(rows[0], rows[1], options.derivative, options.half or None)
        new = moved.known & np.isfinite(rows[2]) & (rows[0] > done)
        if new.any():
            done = float(rows[0][new][-1])
            yield columns_of(moved)[new], rows[2][new]
        kept = rows[:, -reach:]


def _short(pieces: Iterable[tuple[Array, Array, Array]]) -> Iterator[Array]:
    for piece in pieces:
        for first in range(0, len(piece[0]), MOST_ROWS):
            yield np.stack([one[first : first + MOST_ROWS] for one in piece])
