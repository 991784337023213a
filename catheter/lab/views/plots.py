"""Plots against time: which columns stand in which plot, and in which colour."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping
from rerun.encodings import EntityPathLike

from catheter.lab.views.clocks import Column
from catheter.lab.views.labels import Colour
from data.signal import Array

MOST_IN_LEGEND = 12

Mask = NDArray[np.bool_]
Corner = Literal["LeftTop", "RightTop", "LeftBottom", "RightBottom"]


@dataclass(frozen=True)
class Line:
    """One line of a plot; a line that is not shown waits in the legend for a click.

    exact: every sample is drawn; else the viewer averages those that share a pixel, which is fast, and
    rounds the corners of frames that stand unevenly.
    """

    column: Column
    name: str
    colour: Colour
    width: float = 1.5
    shown: bool = True
    exact: bool = False


def plot(
    name: str,
    lines: Sequence[Line],
    span: tuple[float, float] | None = None,
    *,
    legend: bool = True,
    corner: Corner = "LeftTop",
) -> rrb.TimeSeriesView:
    """Return a plot of the lines. span: the range of its vertical axis, by default what the lines need."""
    entities = list(dict.fromkeys(line.column.entity for line in lines))
    overrides: dict[EntityPathLike, list[rrb.Visualizer]] = {
        entity: [_visualizer(line) for line in lines if line.column.entity == entity] for entity in entities
    }
    return rrb.TimeSeriesView(
        name=name,
        origin="/",
        contents=entities,
        overrides=overrides,
        axis_x=rrb.TimeAxis(link="LinkToGlobal"),
        axis_y=None if span is None else rrb.ScalarAxis(range=span),
        plot_legend=rrb.PlotLegend(corner, visible=legend and 1 < len(lines) <= MOST_IN_LEGEND),
    )


def emptiest_corner(time_s: Array, values: Array) -> Corner:
    """Return the corner of a plot, 30 % wide and 40 % high, in which fewest of the samples lie."""
    along, up = (_share(column) for column in (time_s, values))
    left, top = along < 0.3, up > 0.6
    right, bottom = along > 0.7, up < 0.4
    boxes: dict[Corner, tuple[Mask, Mask]] = {
        "LeftTop": (left, top),
        "RightTop": (right, top),
        "LeftBottom": (left, bottom),
        "RightBottom": (right, bottom),
    }
    return min(boxes, key=lambda corner: int(np.sum(boxes[corner][0] & boxes[corner][1])))


def _share(column: Array) -> Array:
    low, high = np.nanmin(column), np.nanmax(column)
    return (column - low) / ((high - low) or 1.0)


def _visualizer(line: Line) -> rrb.Visualizer:
    policy = rr.components.AggregationPolicy
    style = rr.SeriesLines(
        names=line.name,
        colors=line.colour,
        widths=line.width,
        visible_series=[line.shown],
        aggregation_policy=policy.Off if line.exact else policy.Average,
    )
    source = VisualizerComponentMapping(
        target="Scalars:scalars",
        source_kind=ComponentSourceKind.SourceComponent,
        source_component=line.column.component,
    )
    return style.visualizer(mappings=[source])
