"""Table 3.3 and Fig 3.10: pressure over volume, recovered from simulated sine tests of the three actuators."""

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from catheter.bench_runs import BenchRun, accumulator
from catheter.lab import plot
from catheter.lab.scene import Scene
from catheter.lab.thesis.entries import Figure, Section, compare
from sysid.accumulator import AccumulatorFit, fit_accumulator

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

REASON = "the data are not published; the bench of our simulation has the printed law as its truth, with noise of 50 dB"


def accumulators(*, quick: bool) -> Section:
    """Run the sine of volume on each actuator's published law, and fit it by the thesis's rule."""
    tables = {name: options for name, options in Scene.load("accumulator").tables.items() if name != "ask"}
    found: dict[str, tuple[BenchRun, AccumulatorFit]] = {}
    for name in ("Act 1", "Act 2", "Act 3"):
        bench = replace(tables["accumulator"], actuator=name)
        run = accumulator(**tables | {"accumulator": bench})
        found[name] = run, fit_accumulator(run.signals["/volume", "ratio"], run.signals["/pressure", "pressure"])
    entries = [
        compare("3.3", name, float(value), f"c{n}", recovered=True, reason=REASON)
        for name, (_, fit) in found.items()
        for n, value in enumerate(fit.coefficients, start=1)
        if n <= 4
    ]
    orders = [fit.order for _, fit in found.values()]
    entries.append(compare("3.text", "order of the pressure polynomial", max(orders), recovered=True))
    draw = partial(_draw, *found["Act 1"])
    title = "pressure over volume of actuator 1, without the hysteresis of the real tube"
    return Section(entries=entries, figures=[Figure(number="3.10", title=title, kind="simulated", draw=draw)])


def _draw(run: BenchRun, fit: AccumulatorFit, figure: "Drawing") -> None:
    axes = plot.axes(figure, ("volume coefficient V", "1"), ("pressure", "kPa"))
    ratio, pressure = run.signals["/volume", "ratio"], run.signals["/pressure", "pressure"]
    axes.plot(ratio, pressure / 1e3, ".", markersize=2, alpha=0.3, label="simulated sensors")
    smooth = np.linspace(*fit.range, 300)
    axes.plot(smooth, fit.pressure_pa(smooth) / 1e3, label=f"fit of order {fit.order}")
    axes.legend(fontsize=8)
