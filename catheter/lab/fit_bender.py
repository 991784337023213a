"""The bender's fit: force over volume, every subset of nine terms, the chosen one with its uncertainty."""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from catheter.lab.outcome import table
from data.errors import BadInput
from data.recording import Recording
from data.signal import Array

if TYPE_CHECKING:
    from catheter.lab.replay import Replay
    from sysid.identify import Identification, Identify

MOST_ROWS = 4_000_000  # beyond it a recording is streamed, see `sysid.identify.reduce_stream`
PIECE_S = 3600.0
PLANT = {"x^3": "cubic", "x^2": "square", "xdd^2": "inertia"}
ML = 1e-6


@dataclass(frozen=True)
class Fitted:
    """What a model's fit gives: values for --json, parts to print, and the tables of its TOML."""

    values: dict[str, Any]
    parts: list[Any]
    tables: dict[str, dict[str, Any]]
    dashboard: Callable[[Path], None] | None = None


def replayed(recording: Recording, options: argparse.Namespace) -> "Replay":
    """Return the recording's signals and questions, those of the command line where it names some."""
    from catheter.lab.replay import Replay
    from data.ask import Ask

    given = Ask(response=options.response, input=options.input)
    return Replay(recording, given if options.response or options.input else None)


def bender(recording: Recording, options: argparse.Namespace) -> Fitted:
    """Force over volume: every subset of the nine terms, the rule's choice with its uncertainty."""
    from sysid.estimate import Bootstrap, dropped
    from sysid.identify import Identify, identify

    replay = replayed(recording, options)
    ask = replay.ask
    if not (ask.response and ask.input):
        raise BadInput(recording.path, "has no response and input", "name them with --response and --input")
    rule = Identify(rule=options.rule, signed=options.signed)
    largest = max(channel.messages for channel in recording.channels.values())
    if largest > MOST_ROWS:
        return _streamed(recording, ask.response, ask.input, rule)
    experiment = replay.experiment
    if experiment is None:
        raise BadInput(recording.path, "; ".join(replay.left_out), "name other signals")
    in_ml = replay.signals[ask.input].unit == "m^3"
    x = experiment.input / ML if in_ml else experiment.input
    found = identify(experiment.time_s, x, experiment.response, rule, Bootstrap(resamples=options.resamples))
    _differences, percent = dropped(found.selection, found.columns, found.response)
    values = _bender_values(found) | {
        "dropped_percent": dict(zip(found.selection.terms, percent.tolist(), strict=True)),
        "x": ask.input + (" [mL]" if in_ml else ""),
        "response": ask.response,
    }
    parts = list(_bender_parts(found, f"{ask.response} over x = {values['x']}", percent))
    tables = _bender_tables(found, in_ml)
    if options.validate:
        values["validation"] = _validate(found, Path(options.validate), ask.response, ask.input, in_ml)
        v = values["validation"]
        parts.append(
            f"On {options.validate} ({v['kind']}): RMSE {v['rmse']:.4g}, fit {v['fit_percent']:.1f} %; there the best "
            f"subset of this size has {v['best_rmse']:.4g}"
        )

    def dashboard(path: Path) -> None:
        from catheter.lab.views import fit as view

        view.save(found, experiment.time_s, x, recording.kind, path)

    return Fitted(values, parts, tables, dashboard)


def _bender_values(found: "Identification") -> dict[str, Any]:
    chosen, selection = found.chosen, found.selection
    weights = {
        name: {"value": value, "standard_error": error, "low": low, "high": high}
        for name, value, error, low, high in zip(
            chosen.names, *(a.tolist() for a in (chosen.values, chosen.standard_errors, chosen.low, chosen.high)),
            strict=True,
        )
    }  # fmt: skip
    sizes = [
        {"size": size, "terms": selection.names(int(mask)), "rmse": float(selection.rmse[mask])}
        for size, mask in enumerate(selection.best)
    ]
    return {
        "rule": found.options.rule,
        "constant_free": selection.constant_free,
        "signed": selection.signed,
        "choices": found.choices,
        "weights": weights,
        "rmse": chosen.rmse,
        "root_sum_square": chosen.root_sum_square,
        "fit_percent": chosen.fit_percent,
        "held_out_rmse": found.held_out,
        "second_half_rmse": found.second_half,
        "best_of_size": sizes,
        "inclusion": {
            rule: dict(zip(selection.terms, share.tolist(), strict=True)) for rule, share in chosen.inclusion.items()
        },
        "condition": found.reduction.condition,
        "whiteness": vars(found.whiteness),
        "samples": chosen.samples,
        "derivative": {"method": found.motion.method, "half": list(found.motion.half), "noise": found.motion.noise},
        "notes": list(found.motion.notes),
        "seconds": found.seconds,
    }


def _bender_parts(found: "Identification", what: str, percent: Array) -> Iterator[Any]:
    chosen, selection, white = found.chosen, found.selection, found.whiteness
    included = dict(zip(selection.terms, chosen.inclusion[found.options.rule], strict=True))
    level = f"{100 * chosen.options.level:g} %"
    dropped_by = dict(zip(selection.terms, percent, strict=True))
    rows = [
        [name, f"{value:.5g}", f"{error:.2g}", f"{low:.5g} .. {high:.5g}", f"{100 * included.get(name, 1):.0f} %",
         f"{dropped_by[name]:+.2f} %" if name in dropped_by else ""]
        for name, value, error, low, high in zip(
            chosen.names, chosen.values, chosen.standard_errors, chosen.low, chosen.high, strict=True
        )
    ]  # fmt: skip
    header = ["term", "weight", "std. error", f"{level} block bootstrap", "included", "dropped: error"]
    yield table(header, rows, f"{what}; weights {'of any sign' if selection.signed else '>= 0, constant free'}")
    sizes = [[str(n), " ".join(selection.names(int(m))) or "constant only", f"{selection.rmse[m]:.5g}"]
             for n, m in enumerate(selection.best)]  # fmt: skip
    yield table(["terms", "best of all subsets of this size", "RMSE"], sizes, words=2)
    for rule, names in found.choices.items():
        yield f"{rule} rule: {' '.join(names) or 'constant only'} (and the constant)"
    yield (
        f"fit {chosen.fit_percent:.2f} %, RMSE {chosen.rmse:.5g}; held out: every other tenth {found.held_out:.5g}, "
        f"second half {found.second_half:.5g}; root-sum-square {chosen.root_sum_square:.5g}"
    )
    yield (
        f"condition number {found.reduction.condition:.3g}; residual Ljung-Box p = {white.p_value:.3g} over "
        f"{white.lags} lags, first autocorrelation {white.first:.3f}"
        + ("" if white.p_value > 0.01 else ": not white, so trust the bootstrap, not the standard errors")
    )
    yield (
        f"{chosen.samples} samples, all {len(selection.rmse)} subsets in {1e3 * found.seconds:.0f} ms with "
        f"derivatives ({found.motion.method}, half-width {_span(found.motion.half)}, noise {found.motion.noise:.3g})"
    )
    yield from (f"Note: {note}" for note in found.motion.notes)


def _span(half: tuple[int, int]) -> str:
    return f"{half[0]}" if half[0] == half[1] else f"{half[0]} to {half[1]}"


def _bender_tables(found: "Identification", in_ml: bool) -> dict[str, dict[str, Any]]:
    """Return [fit], and the bender scene's own [plant] where it can hold the chosen terms."""
    chosen = found.chosen
    told = {
        "x_unit": "mL" if in_ml else "SI", "terms": list(chosen.names), "weights": chosen.values.tolist(),
        "standard_errors": chosen.standard_errors.tolist(), "low": chosen.low.tolist(), "high": chosen.high.tolist(),
        "rmse": chosen.rmse, "fit_percent": chosen.fit_percent, "rule": found.options.rule,
    }  # fmt: skip
    tables: dict[str, dict[str, Any]] = {"fit": told}
    weights = dict(zip(chosen.names, chosen.values.tolist(), strict=True))
    if in_ml and set(weights) <= {"1", *PLANT}:
        tables["plant"] = {key: weights.get(term, 0.0) for term, key in PLANT.items()} | {
            "constant": weights["1"], "slip_ml": [], "stiffness": [], "pressure_stiffness": [],
        }  # fmt: skip
    return tables


def _validate(found: "Identification", path: Path, response: str, named: str, in_ml: bool) -> dict[str, Any]:
    """Judge the chosen weights on another recording, perhaps of another loading."""
    from sysid.identify import TERMS, columns_of
    from sysid.motion import motion
    from sysid.reduction import reduce_rows
    from sysid.selection import select

    with Recording(path) as other:
        y, x = other.signal(response), other.signal(*named.split(":"))
        moved = motion(y.time_s, x.at(y.time_s) / (ML if in_ml else 1.0), found.options.derivative)
        used = moved.known & np.isfinite(y.value)
        reduction = reduce_rows(TERMS, columns_of(moved)[used], y.value[used])
        kind = other.kind
    selection, mask = found.selection, found.mask
    rmse = reduction.rmse(float(selection.constants[mask]), selection.weights[mask])
    there = select(reduction, signed=selection.signed)
    best = float(there.rmse[there.best[len(found.chosen.names) - 1]])
    fit = 100 * (1 - rmse / reduction.response_deviation)
    return {"recording": str(path), "kind": kind, "rmse": rmse, "fit_percent": fit, "best_rmse": best}


def _streamed(recording: Recording, response: str, named: str, options: "Identify") -> Fitted:
    """Fit a recording too long for memory, an hour at a time: weights and errors, no residual series."""
    from sysid.estimate import estimate
    from sysid.identify import reduce_stream
    from sysid.selection import RULES, select

    def pieces() -> Iterator[tuple[Array, Array, Array]]:
        for start in np.arange(0.0, recording.duration_s + 1e-9, PIECE_S):
            first, last = float(start), float(start + PIECE_S)
            y, x = (recording.signal(*one.split(":"), start_s=first, end_s=last) for one in (response, named))
            if len(y) and len(x):
                yield y.time_s, x.at(y.time_s) / (ML if x.unit == "m^3" else 1.0), y.value

    reduction = reduce_stream(pieces(), options)
    selection = select(reduction, signed=options.signed)
    found = estimate(reduction, selection, selection.choose(options.rule))
    rows = [
        [n, f"{v:.5g}", f"{e:.2g}"] for n, v, e in zip(found.names, found.values, found.standard_errors, strict=True)
    ]
    values = {
        "weights": dict(zip(found.names, found.values.tolist(), strict=True)), "rmse": found.rmse,
        "fit_percent": found.fit_percent, "samples": found.samples,
        "choices": {rule: selection.names(selection.choose(rule)) for rule in RULES},
    }  # fmt: skip
    told = {"terms": list(found.names), "weights": found.values.tolist(), "rmse": found.rmse}
    text = f"{found.samples} samples streamed: RMSE {found.rmse:.5g}, fit {found.fit_percent:.2f} %"
    return Fitted(values, [table(["term", "weight", "std. error"], rows), text], {"fit": told})
