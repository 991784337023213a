"""What a replay's plots draw: its numbers in the units that are shown, put on their clocks."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from catheter.lab.display import shown_unit
from catheter.lab.views.clocks import Clocks, Column

if TYPE_CHECKING:
    from catheter.lab.replay import Replay
    from sysid.fit import Fit


@dataclass(frozen=True)
class Candidate:
    """A model's response and its residual, model minus measurement. reach: the largest residual."""

    fit: "Fit"
    model: Column
    residual: Column
    reach: float


@dataclass(frozen=True)
class Columns:
    """Where everything stands: signals by name, and the models, best first."""

    signals: dict[str, Column]
    candidates: list[Candidate]


def collect(replay: "Replay", clocks: Clocks) -> Columns:
    """Put every signal, model and residual of a replay on the clocks."""
    signals = {}
    for label, signal in replay.signals.items():
        signals[label] = clocks.add("Signal", label, signal.time_s, signal.value * shown_unit(signal)[1])
    found = [_candidate(replay, fit, clocks) for fit in replay.models]
    return Columns(signals, sorted(found, key=lambda candidate: candidate.fit.held_out_rmse))


def _candidate(replay: "Replay", fit: "Fit", clocks: Clocks) -> Candidate:
    experiment = replay.experiment
    assert experiment is not None
    factor = shown_unit(replay.signals[replay.ask.response])[1]
    model = fit.predicted * factor
    residual = model - experiment.response * factor  # of what is shown, so that it adds up to the last bit
    return Candidate(
        fit,
        clocks.add("Model", fit.model.name, experiment.time_s, model),
        clocks.add("Residual", fit.model.name, experiment.time_s, residual),
        float(abs(residual).max()),
    )
