"""Hysteresis loops: one quantity over another, with a point that follows the cursor."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from catheter.lab.display import shown_unit
from catheter.lab.views.clocks import stamps
from catheter.lab.views.labels import FRAME, GRID, MARK, TEXT, Colour, plain, ramp, ticks, view_name
from data.signal import Array, Signal

if TYPE_CHECKING:
    from catheter.lab.replay import LoopFamily

MOST_LOOPS = 60
MOST_POINTS = 400  # of one loop
MOST_PLACES = 2000  # of the moving point


@dataclass(frozen=True)
class Axis:
    """A quantity's place on a drawn axis: shown value v stands at length (v - low) / (high - low)."""

    name: str
    unit: str
    factor: float
    low: float
    high: float
    length: float

    @classmethod
    def over(cls, signal: Signal, shown: tuple[str, float], length: float) -> "Axis":
        """Return the axis that holds all of a signal's values, with a margin of 4 %."""
        unit, factor = shown
        low, high = float(signal.value.min()) * factor, float(signal.value.max()) * factor
        margin = 0.04 * (high - low) or abs(high) or 1.0
        return cls(plain(signal.name), unit, factor, low - margin, high + margin, length)

    def place(self, shown: Array) -> Array:
        """Return where shown values (n,) stand on the axis, (n,)."""
        return (shown - self.low) / (self.high - self.low) * self.length


@dataclass(frozen=True)
class Sheet:
    """A drawing of y over x at an entity path, on axes y.length = 1 high; a line of text is `line` high."""

    stream: rr.RecordingStream
    path: str
    x: Axis
    y: Axis
    line: float

    def points(self, x_si: Array, y_si: Array) -> Array:
        """Return coordinates (n, 2) on the drawing, whose second axis points down."""
        return np.stack([self.x.place(x_si * self.x.factor), -self.y.place(y_si * self.y.factor)], axis=-1)

    def bounds(self) -> rrb.VisualBounds2D:
        """Return what the view shows: the axes and the texts around them."""
        x_range = (-0.15, self.x.length + 0.05)
        return rrb.VisualBounds2D(x_range=x_range, y_range=(-1.07 - self.line, 0.06 + 2 * self.line))

    def axes(self) -> None:
        """Draw frame, grid, ticks and the names of the axes."""
        width, at_x, at_y = self.x.length, ticks(self.x.low, self.x.high), ticks(self.y.low, self.y.high)
        across = [np.array([(0.0, -p), (width, -p)]) for p in self.y.place(at_y)]
        up = [np.array([(p, 0.0), (p, -1.0)]) for p in self.x.place(at_x)]
        self._lines("grid", across + up, [GRID], 0.5, order=-2.0)
        self._lines("frame", [np.array([(0.0, -1.0), (0.0, 0.0), (width, 0.0)])], [FRAME], 0.8)
        places = [(p, 0.02) for p in self.x.place(at_x)]
        places += [(-0.07, -p - 0.55 * self.line) for p in self.y.place(at_y)]  # lifted to stand beside the tick
        places += [(width / 2, 0.02 + self.line), (0.0, -1.0 - self.line)]
        texts = [f"{value:.6g}" for value in (*at_x, *at_y)] + [
            f"{axis.name} [{axis.unit}]" for axis in (self.x, self.y)
        ]
        self._texts("ticks", places, texts, [TEXT])

    def loops(self, family: "LoopFamily", points: Array) -> None:
        """Draw at most MOST_LOOPS loops, spread evenly, coloured from the first to the last."""
        chosen = _spread(0, len(family.loops), MOST_LOOPS)
        strips = []
        for loop in (family.loops[number] for number in chosen):
            strips.append(points[np.union1d(_spread(loop.first, loop.last + 1, MOST_POINTS), [loop.peak])])
        colours = ramp(len(strips))
        self._lines("loops", strips, colours, 0.8)
        if len(chosen) > 1:
            above = -1.0 - self.line
            places = [(0.58 * self.x.length, above), (0.9 * self.x.length, above)]
            ends = [f"loop {chosen[0] + 1}", f"loop {chosen[-1] + 1}"]
            self._texts("ramp", places, ends, [colours[0], colours[-1]])

    def mark(self, time_s: Array, points: Array) -> None:
        """Write the point that follows the cursor, at no more than MOST_PLACES times."""
        kept = _spread(0, len(time_s), MOST_PLACES)
        style = rr.Points2D.from_fields(colors=MARK, radii=rr.Radius.ui_points(5), draw_order=40)
        self.stream.log(f"{self.path}/now", style, static=True)
        columns = rr.Points2D.columns(positions=points[kept])
        self.stream.send_columns(f"{self.path}/now", indexes=[stamps(time_s[kept])], columns=columns)

    def _lines(
        self, name: str, strips: list[Array], colours: Sequence[Colour], radius: float, order: float = 0.0
    ) -> None:
        radii = rr.Radius.ui_points(radius)
        lines = rr.LineStrips2D(strips, colors=colours, radii=radii, draw_order=order)
        self.stream.log(f"{self.path}/{name}", lines, static=True)

    def _texts(
        self, name: str, places: Sequence[tuple[float, float]], texts: Sequence[str], colours: Sequence[Colour]
    ) -> None:
        """Write texts that hang from their places, as labels of points that are too small to see."""
        labels = rr.Points2D(places, labels=texts, show_labels=True, colors=colours, radii=1e-9)
        self.stream.log(f"{self.path}/{name}", labels, static=True)


def log_loops(
    stream: rr.RecordingStream,
    family: "LoopFamily",
    sources: dict[str, Signal],
    kind: str,
    shape: tuple[float, float],
) -> rrb.Spatial2DView:
    """Write a family's loops and return their view.

    sources: the recorded signals by name, which know what their units are worth. shape: width of
    the drawing and height of a line of text, both in heights of the axes.
    """
    width, line = shape
    x = Axis.over(family.x, shown_unit(sources[family.x.name]), width)
    y = Axis.over(family.y, shown_unit(sources[family.y.name]), 1.0)
    sheet = Sheet(stream, f"/loops/{y.name} over {x.name}".replace(" ", "_"), x, y, line)
    points = sheet.points(family.x.value, family.y.value)
    sheet.axes()
    sheet.loops(family, points)
    sheet.mark(family.x.time_s, points)
    name = view_name(f"{y.name} over {x.name}", "", kind)
    return rrb.Spatial2DView(name=name, origin=sheet.path, visual_bounds=sheet.bounds())


def _spread(first: int, end: int, most: int) -> NDArray[np.int64]:
    """Return at most `most` numbers from first to end - 1, evenly spread, both ends kept."""
    return np.unique(np.linspace(first, end - 1, min(most, end - first)).round().astype(np.int64))
