"""Hysteresis loops: one quantity over another, with a point that follows the cursor."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from catheter.lab.views.clocks import stamps
from catheter.lab.views.labels import FRAME, GRID, MARK, plain, ramp, shown_unit, ticks, view_name
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
    def over(cls, signal: Signal, unit: str, factor: float, length: float) -> "Axis":
        """Return the axis that holds all of a signal's values, with a margin of 4 %."""
        low, high = float(signal.value.min()) * factor, float(signal.value.max()) * factor
        margin = 0.04 * (high - low) or abs(high) or 1.0
        return cls(plain(signal.name), unit, factor, low - margin, high + margin, length)

    def place(self, shown: Array) -> Array:
        """Return where shown values (n,) stand on the axis, (n,)."""
        return (shown - self.low) / (self.high - self.low) * self.length


def log_loops(
    stream: rr.RecordingStream, family: "LoopFamily", sources: dict[str, Signal], kind: str, *, width: float
) -> rrb.Spatial2DView:
    """Write a family's loops on axes of `width` by 1, and return their view.

    sources: the recorded signals by name, which know what their units are worth.
    """
    x, y = (
        Axis.over(signal, *shown_unit(sources[signal.name]), length)
        for signal, length in ((family.x, width), (family.y, 1.0))
    )
    path = f"/loops/{plain(family.y.name)} over {plain(family.x.name)}".replace(" ", "_")
    _log_axes(stream, path, x, y)
    points = _points(x, y, family.x.value, family.y.value)
    _log_loops(stream, path, family, points)
    _log_mark(stream, path, family.x.time_s, points)
    over = f"{x.name} [{x.unit}]"
    return rrb.Spatial2DView(
        name=view_name(f"loops: {y.name} [{y.unit}] over {over}", "", kind),
        origin=path,
        visual_bounds=rrb.VisualBounds2D(x_range=(-0.16, width + 0.06), y_range=(-1.08, 0.13)),
    )


def _points(x: Axis, y: Axis, x_si: Array, y_si: Array) -> Array:
    """Return picture coordinates (n, 2); a picture's second axis points down."""
    return np.stack([x.place(x_si * x.factor), -y.place(y_si * y.factor)], axis=-1)


def _log_axes(stream: rr.RecordingStream, path: str, x: Axis, y: Axis) -> None:
    at_x, at_y = ticks(x.low, x.high), ticks(y.low, y.high)
    across = [[(0.0, -p), (x.length, -p)] for p in y.place(at_y)]
    up = [[(p, 0.0), (p, -y.length)] for p in x.place(at_x)]
    thin = rr.Radius.ui_points(0.5)
    stream.log(f"{path}/grid", rr.LineStrips2D(across + up, colors=GRID, radii=thin, draw_order=-2), static=True)
    frame = [[(0.0, -y.length), (0.0, 0.0), (x.length, 0.0)]]
    stream.log(f"{path}/frame", rr.LineStrips2D(frame, colors=FRAME, radii=rr.Radius.ui_points(0.8)), static=True)
    places = [(p, 0.035) for p in x.place(at_x)] + [(-0.07, -p) for p in y.place(at_y)]
    texts = [f"{value:.6g}" for value in (*at_x, *at_y)]
    labels = rr.Points2D(places, labels=texts, show_labels=True, colors=FRAME, radii=rr.Radius.ui_points(0))
    stream.log(f"{path}/ticks", labels, static=True)


def _log_loops(stream: rr.RecordingStream, path: str, family: "LoopFamily", points: Array) -> None:
    """Write at most MOST_LOOPS loops, spread evenly, coloured from the first to the last."""
    chosen = np.unique(np.linspace(0, len(family.loops) - 1, MOST_LOOPS).round().astype(int))
    strips = []
    for number in chosen:
        loop = family.loops[number]
        kept = _spread(loop.first, loop.last + 1, MOST_POINTS)
        strips.append(points[np.union1d(kept, [loop.peak])])
    colours = ramp(len(strips))
    lines = rr.LineStrips2D(strips, colors=colours, radii=rr.Radius.ui_points(0.8))
    stream.log(f"{path}/loops", lines, static=True)


def _log_mark(stream: rr.RecordingStream, path: str, time_s: Array, points: Array) -> None:
    kept = _spread(0, len(time_s), MOST_PLACES)
    style = rr.Points2D.from_fields(colors=MARK, radii=rr.Radius.ui_points(5), draw_order=40)
    stream.log(f"{path}/now", style, static=True)
    columns = rr.Points2D.columns(positions=points[kept])
    stream.send_columns(f"{path}/now", indexes=[stamps(time_s[kept])], columns=columns)


def _spread(first: int, end: int, most: int) -> "np.ndarray[tuple[int], np.dtype[np.int64]]":
    """Return at most `most` sample numbers from first to end - 1, evenly spread, both ends kept."""
    return np.unique(np.linspace(first, end - 1, min(most, end - first)).round().astype(np.int64))
