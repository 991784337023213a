"""The dashboard's text: what was recorded, which models were tried, what was left out."""

from typing import TYPE_CHECKING

from catheter.lab.display import area_unit, shown_unit
from catheter.lab.views.labels import literal, plain
from catheter.lab.views.loops import MOST_LOOPS

if TYPE_CHECKING:
    from catheter.lab.replay import LoopFamily, Replay
    from sysid.fit import Fit


def summary(replay: "Replay", left_out: list[str]) -> str:
    """Return the summary in markdown. Its first word says whether the data are simulated or measured.

    left_out: what the views leave out, beside what the replay does.
    """
    recording = replay.recording
    title = recording.metadata.get("origin", {}).get("title", recording.path.stem)
    parts = [
        f"## {recording.kind.upper()}: {literal(title)}",
        f"{literal(recording.path.name)}, {recording.duration_s:.4g} s. {_question(replay)}".rstrip(),
    ]
    if recording.cut:
        parts.append(f"**This recording was {literal(recording.cut)}.**")
    if replay.models:
        parts.append(_models(replay))
    areas = [_areas(family) for family in replay.loops if family.loops]
    if areas:
        parts.append(f"**Loop areas:** {', '.join(areas)}")
    reasons = [*replay.left_out, *left_out]
    if reasons:
        parts += ["**Left out**", "\n".join(f"- {literal(reason)}" for reason in reasons)]
    return "\n\n".join(parts) + "\n"


def _question(replay: "Replay") -> str:
    if not replay.models:
        return ""
    asked = " and ".join(_named(label) for label in (replay.ask.input, *replay.ask.others))
    return f"**Models of {_named(replay.ask.response)} from {asked}**, {literal(replay.models[0].split)}:"


def _models(replay: "Replay") -> str:
    """Return the table of models, best first."""
    unit, factor = shown_unit(replay.signals[replay.ask.response])
    rows = [["model", "weights", "fit %", f"RMSE [{unit}]", "held-out RMSE"], ["---", *["---:"] * 4]]
    for fit in sorted(replay.models, key=lambda fit: fit.held_out_rmse):
        rows.append(_row(fit, factor, best=fit is replay.best))
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _row(fit: "Fit", factor: float, *, best: bool) -> list[str]:
    row = [
        literal(fit.model.name),
        str(fit.parameters),
        f"{fit.fit_percent:.2f}",
        _number(fit.rmse * factor),
        _number(fit.held_out_rmse * factor),
    ]
    return [f"**{cell}**" for cell in row] if best else row


def _areas(family: "LoopFamily") -> str:
    areas = [loop.area for loop in family.loops]
    unit, factor = area_unit(family)
    span = _number(min(areas) * factor) + (f" to {_number(max(areas) * factor)}" if len(areas) > 1 else "")
    count = f"{len(areas)} loops" if len(areas) > 1 else "1 loop"
    if len(areas) > MOST_LOOPS:
        count += f", {MOST_LOOPS} drawn"
    return f"{_named(family.y.name)} over {_named(family.x.name)}: {span} {unit} ({count})"


def _named(label: str) -> str:
    return literal(plain(label))


def _number(value: float) -> str:
    return f"{value:#.3g}".removesuffix(".")
