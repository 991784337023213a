"""Dashboard of a conical valve's cracking pressures: the recorded ramps, flow over drop, measured and published."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr

from catheter.lab.views.benches import KPA, ML, flow_sheet, label, plotted, scatter, send, sheet_view, text_view
from catheter.lab.views.clocks import Clocks
from catheter.lab.views.labels import BEST, MEASURED, MODELS, literal, view_name
from catheter.lab.views.output import Output
from data.signal import Array
from sysid.orifice import Cracking


@dataclass(frozen=True, eq=False)
class Ramps:
    """Recorded ramps, each (n,): pressure drop and flow; what was found; published [Pa] by direction, where known."""

    title: str
    kind: str
    time_s: Array
    drop_pa: Array
    flow_m3_s: Array
    found: Sequence[Cracking]
    published_pa: Mapping[str, float]


def save_cracking(ramps: Ramps, path: Path) -> None:
    """Write the dashboard to `path`, replaced. Raises CannotWrite."""
    kind, clocks, time_s = ramps.kind, Clocks(), ramps.time_s
    levels = {one.direction: KPA * one.pressure_pa * (1 if one.direction == "forward" else -1) for one in ramps.found}
    lines = [(f"cracks {name}", np.full(len(time_s), level), BEST) for name, level in levels.items()]
    plots = [
        plotted("pressure drop [kPa]", [("drop", KPA * ramps.drop_pa, MEASURED), *lines], time_s, kind, clocks),
        plotted("flow [mL/s]", [("flow", ML * ramps.flow_m3_s, MODELS[1])], time_s, kind, clocks),
    ]
    with Output("cracking", path) as output:
        clocks.send(output, lambda: None)
        sheet = flow_sheet(output.stream, ramps.drop_pa, ramps.flow_m3_s)
        points = sheet.points(ramps.drop_pa, ramps.flow_m3_s)
        scatter(sheet, points, MEASURED)
        for name, level in levels.items():
            at = float(sheet.x.place(np.array([level]))[0])
            bar = rr.LineStrips2D([[(at, 0.0), (at, -1.0)]], colors=BEST, radii=rr.Radius.ui_points(1.0))
            output.stream.log(f"{sheet.path}/cracks/{name}", bar, static=True)
            label(sheet, (at, -0.2), f"cracks {name}", BEST)
        sheet.mark(time_s, points)
        views = [
            sheet_view(sheet, "flow over pressure drop", kind),
            text_view(output.stream, _text(ramps), ramps.title, kind),
        ]
        send(output.stream, view_name(ramps.title, "", kind), views, plots, float(time_s[-1]))


def _text(ramps: Ramps) -> list[str]:
    lines = ["| direction | cracks at kPa | interval | published |", "|---|---:|---:|---:|"]
    for one in ramps.found:
        known = ramps.published_pa.get(one.direction)
        cells = [one.direction, f"{KPA * one.pressure_pa:.2f}", f"{KPA * one.low_pa:.2f} to {KPA * one.high_pa:.2f}"]
        lines.append(f"| {' | '.join([*cells, '-' if known is None else f'{KPA * known:.2f}'])} |")
    notes = [f"Intervals hold at {100 * ramps.found[0].level:g} %. Published: thesis Table 3.5."]
    if ramps.kind == "simulated":
        notes.append("The thesis prints cracking pressures only: the flow beyond them is assumed.")
    return [*lines, "", *(f"- {literal(note)}" for note in notes)]
