"""The plots of a replay: its response with models, residuals side by side, and every other signal."""

from typing import TYPE_CHECKING

import numpy as np
import rerun.blueprint as rrb

from catheter.lab.display import shown_unit
from catheter.lab.views.columns import Candidate, Columns
from catheter.lab.views.labels import BEST, MEASURED, MODELS, SIGNALS, plain, view_name
from catheter.lab.views.plots import Line, emptiest_corner, plot

if TYPE_CHECKING:
    from catheter.lab.replay import Replay


def response_plot(replay: "Replay", columns: Columns, shown: list[Candidate]) -> rrb.TimeSeriesView:
    """Return the plot of the measured response and of the models `shown`, the last on top."""
    label, kind = replay.ask.response, replay.recording.kind
    measured = Line(columns.signals[label], f"{plain(label)}, {kind}", MEASURED, 3.0)
    models = [Line(c.model, c.fit.model.name, _colour(replay, c), 1.3, c in few(replay, columns)) for c in shown]
    name = view_name(f"{plain(label)} and its models", _unit(replay), kind)
    signal = replay.signals[label]
    return plot(name, [measured, *models], corner=emptiest_corner(signal.time_s, signal.value))


def residuals_plot(replay: "Replay", shown: list[Candidate]) -> rrb.TimeSeriesView:
    """Return one plot with the residuals of the models `shown`, the last on top."""
    lines = [Line(c.residual, c.fit.model.name, _colour(replay, c), 1.3) for c in shown]
    name = view_name("residuals, model minus measurement", _unit(replay), replay.recording.kind)
    return plot(name, lines, legend=False)


def residual_plots(replay: "Replay", shown: list[Candidate]) -> list[rrb.TimeSeriesView]:
    """Return a plot of the residual of each model, all over the same range, to be put side by side."""
    reach = 1.1 * max((candidate.reach for candidate in shown), default=0.0)
    span = (-reach, reach) if reach > 0 else None
    views = []
    for candidate in shown:
        name = view_name("residual", _unit(replay), replay.recording.kind) + f", {candidate.fit.model.name}"
        line = Line(candidate.residual, candidate.fit.model.name, _colour(replay, candidate), 1.0)
        views.append(plot(name, [line], span))
    return views


def few(replay: "Replay", columns: Columns) -> list[Candidate]:
    """Return the models worth a first look: the one tried first, and the best, which comes last."""
    best = columns.candidates[:1]
    first = [c for c in columns.candidates if c.fit is replay.models[0] and c not in best]
    return first + best


def signal_plots(replay: "Replay", columns: Columns, left_out: list[str]) -> list[rrb.TimeSeriesView]:
    """Return one plot for each topic and unit, those that were asked for first.

    Signals without a number have none, and are listed in `left_out`; nor has the response where the
    plot of its models shows it already.
    """
    empty = [label for label, signal in replay.signals.items() if not np.isfinite(signal.value).any()]
    left_out += [f"{label}: no sample is a number" for label in empty]
    ask = replay.ask
    groups: dict[tuple[str, str], list[str]] = {}
    for label in (*filter(None, (ask.response, ask.input, *ask.others)), *replay.signals):
        unit = shown_unit(replay.signals[label])[0]
        members = groups.setdefault((label.partition(":")[0], unit), [])
        if label not in members and label not in empty:
            members.append(label)
    shown = [ask.response] if columns.candidates else []
    return [
        _signal_plot(replay, columns, unit, labels)
        for (_, unit), labels in groups.items()
        if labels and labels != shown
    ]


def _signal_plot(replay: "Replay", columns: Columns, unit: str, labels: list[str]) -> rrb.TimeSeriesView:
    ordered = [label for label in replay.signals if label in labels]
    lines = [
        Line(columns.signals[label], label.partition(":")[2] or plain(label), SIGNALS[index % len(SIGNALS)])
        for index, label in enumerate(ordered)
    ]
    what = plain(ordered[0]) if len(ordered) == 1 else plain(ordered[0].partition(":")[0])
    return plot(view_name(what, unit, replay.recording.kind), lines)


def _unit(replay: "Replay") -> str:
    return shown_unit(replay.signals[replay.ask.response])[0]


def _colour(replay: "Replay", candidate: Candidate) -> tuple[int, int, int]:
    """Return the model's colour: the same in every plot."""
    if candidate.fit is replay.best:
        return BEST
    return MODELS[next(i for i, fit in enumerate(replay.models) if fit is candidate.fit) % len(MODELS)]
