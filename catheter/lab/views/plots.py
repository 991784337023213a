"""Plots against time: which columns stand in which plot, and in which colour."""

from collections.abc import Sequence
from dataclasses import dataclass

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

from catheter.lab.views.clocks import Column
from catheter.lab.views.labels import Colour

MOST_IN_LEGEND = 12


@dataclass(frozen=True)
class Line:
    """One line of a plot; a line that is not shown waits in the legend for a click."""

    column: Column
    name: str
    colour: Colour
    width: float = 1.5
    shown: bool = True


def plot(
    name: str, lines: Sequence[Line], span: tuple[float, float] | None = None, *, legend: bool = True
) -> rrb.TimeSeriesView:
    """Return a plot of the lines. span: the range of its vertical axis, by default what the lines need."""
    overrides: dict[str, list[rrb.Visualizer]] = {}
    for line in lines:
        overrides.setdefault(line.column.entity, []).append(_visualizer(line))
    return rrb.TimeSeriesView(
        name=name,
        origin="/",
        contents=list(overrides),
        overrides=overrides,
        axis_x=rrb.TimeAxis(link="Independent", view_range=rr.TimeRange(start=rrb.TimeRangeBoundary.absolute(seconds=0.0), end=rrb.TimeRangeBoundary.absolute(seconds=120.0))),
        axis_y=None if span is None else rrb.ScalarAxis(range=span),
        plot_legend=rrb.PlotLegend("LeftTop", visible=legend and 1 < len(lines) <= MOST_IN_LEGEND),
    )


def _visualizer(line: Line) -> rrb.Visualizer:
    style = rr.SeriesLines(
        names=line.name, colors=line.colour, widths=line.width, visible_series=None if line.shown else False
    )
    source = VisualizerComponentMapping(
        target="Scalars:scalars",
        source_kind=ComponentSourceKind.SourceComponent,
        source_component=line.column.component,
    )
    return style.visualizer(mappings=[source])
