"""The dashboard's text: what was recorded, which models were tried, what was left out."""

from typing import TYPE_CHECKING

from catheter.lab.display import display
from catheter.lab.views.labels import literal, plain, shown_unit
from data.units import UNDOCUMENTED

if TYPE_CHECKING:
    from catheter.lab.replay import LoopFamily, Replay
    from sysid.fit import Fit


def summary(replay: "Replay") -> str:
    """Return the summary in markdown. The first word says whether the data are simulated or measured."""
    recording = replay.recording
    title = recording.metadata.get("origin", {}).get("title", recording.path.stem)
    parts = [
        f"# {recording.kind.upper()}",
        f"**{literal(title)}**: {literal(recording.path.name)}, {recording.duration_s:.4g} s",
    ]
    if recording.cut:
        parts.append(f"**This recording was {literal(recording.cut)}.**")
    if replay.models:
        parts += _models(replay)
    parts += _loops(replay)
    if replay.left_out:
        parts += ["**Left out**", "\n".join(f"- {literal(reason)}" for reason in replay.left_out)]
    return "\n\n".join(parts) + "\n"


def _models(replay: "Replay") -> list[str]:
    unit, factor = shown_unit(replay.signals[replay.ask.response])
    head = ["model", "weights", "fit %", f"RMSE [{unit}]", f"held-out RMSE [{unit}]"]
    rows = [head, ["---", *["---:"] * 4]]
    for fit in sorted(replay.models, key=lambda fit: fit.held_out_rmse):
        rows.append(_row(fit, factor, best=fit is replay.best))
    table = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    asked = " and ".join(plain(label) for label in (replay.ask.input, *replay.ask.others))
    return [
        f"**Models of {plain(replay.ask.response)} from {asked}**, {replay.models[0].split}",
        table,
    ]


def _row(fit: "Fit", factor: float, *, best: bool) -> list[str]:
    row = [
        literal(fit.model.name),
        str(fit.parameters),
        f"{fit.fit_percent:.2f}",
        f"{fit.rmse * factor:.3g}",
        f"{fit.held_out_rmse * factor:.3g}",
    ]
    return [f"**{cell}**" for cell in row] if best else row


def _loops(replay: "Replay") -> list[str]:
    lines = [_areas(replay, family) for family in replay.loops if family.loops]
    return ["**Loop areas** (what a cycle loses)", "\n".join(lines)] if lines else []


def _areas(replay: "Replay", family: "LoopFamily") -> str:
    areas = [loop.area for loop in family.loops]
    unit, factor = _area_unit(replay, family)
    span = f"{min(areas) * factor:.3g}" + (f" to {max(areas) * factor:.3g}" if len(areas) > 1 else "")
    count = f"{len(areas)} loops" if len(areas) > 1 else "1 loop"
    return f"- {plain(family.y.name)} over {plain(family.x.name)}: {count}, {span} {unit}"


def _area_unit(replay: "Replay", family: "LoopFamily") -> tuple[str, float]:
    """Return the area's unit and factor; a unit nobody documented is said, not left out."""
    units = [shown_unit(replay.signals[signal.name]) for signal in (family.y, family.x)]
    if any(unit == UNDOCUMENTED for unit, _ in units):
        return " x ".join(f"[{unit}]" for unit, _ in units), units[0][1] * units[1][1]
    return display(family.unit)
