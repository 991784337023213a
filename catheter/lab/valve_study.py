"""The study of the conical valves: what the thesis says of them, against its own table."""

import time
from typing import Any

import numpy as np

from catheter.lab.report import Progress, Report, Row
from catheter.valve import INCH, cone, measured
from catheter.valve_claims import claims


def valves(*, quick: bool, progress: Progress) -> Report:
    """Hold what the thesis says of its conical valves against its table."""
    started = time.perf_counter()
    found = claims()
    spent = (time.perf_counter() - started) / len(found)
    progress(1.0)
    return Report(
        name="valves",
        title="What the thesis says of its conical valves, against its Table 3.5",
        level="verdict",
        error="contradictions",
        rows=[
            Row(method=c.text, level="holds" if c.holds else "fails", error=float(len(c.against)), seconds=spent)
            for c in found
        ],
        notes=[f"{c.text}: {c.table}" + "".join(f"\n    {cell}" for cell in c.against) for c in found],
        draw=draw_ratio,
    )


def draw_ratio(figure: Any) -> None:
    """Draw the map of Prev/Pfwd - 1 (thesis Fig 3.20) on a matplotlib figure."""
    known = measured()
    angle = np.linspace(known.angle_rad[0], known.angle_rad[-1], 201)
    thick = np.linspace(known.thickness_m[0], known.thickness_m[-1], 121)
    axes = figure.add_subplot()
    levels = np.arange(0, 4.25, 0.25)
    shown = axes.contourf(thick / INCH, np.degrees(angle), cone(angle[:, None], thick).ratio, levels=levels)
    figure.colorbar(shown, label="Prev / Pfwd - 1, bilinear between measured cones")
    spots = np.meshgrid(known.thickness_m / INCH, np.degrees(known.angle_rad))
    axes.plot(*(x.ravel() for x in spots), "k.", label="measured")
    axes.set(xlabel="thickness, in", ylabel="cone angle, deg", title="Thesis Fig 3.20, from Table 3.5")
    axes.legend(fontsize=8, loc="upper right")
