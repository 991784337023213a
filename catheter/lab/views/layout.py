"""How the views of a replay are arranged: a first page, every model, and what found no room."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from catheter.lab.views.clocks import TIMELINE
from catheter.lab.views.labels import view_name
from data.signal import Array

ROWS = 6  # plots that stand under each other on the first page
GRID = 12  # plots on each further page


class Pages(rrb.Tabs):
    """The dashboard's pages, and the range of time that all plots show until somebody zooms.

    Plots with a linked time axis take its range from a view of this fixed id (GLOBAL_VIEW_ID in
    rerun's sources), which rerun's blueprints cannot name. Without it they show one minute.
    """

    SHARED_AXIS = "view/5c0dca6a-e63f-9cf7-f657-2602590474cc/TimeAxis"

    def __init__(self, *pages: rrb.Container, duration_s: float) -> None:
        super().__init__(*pages, active_tab=0)
        self._duration_s = duration_s

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        super()._log_to_stream(stream)
        first, last = (rrb.TimeRangeBoundary.absolute(seconds=seconds) for seconds in (0.0, self._duration_s))
        stream.log(self.SHARED_AXIS, rrb.TimeAxis(view_range=rr.TimeRange(start=first, end=last)))


def eye_on(points: Array, direction: tuple[float, float, float]) -> rrb.EyeControls3D:
    """Return a camera that looks against `direction` and sees all of the points (..., 3), z upwards."""
    flat = points.reshape(-1, 3)
    low, high = flat.min(axis=0), flat.max(axis=0)
    middle, reach = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    away = np.array(direction) / np.linalg.norm(direction)
    return rrb.EyeControls3D(position=middle + 1.8 * reach * away, look_target=middle, eye_up=(0.0, 0.0, 1.0))


@dataclass
class Views:
    """The views of a dashboard by their part in it. The text is always there, the others may be missing."""

    text: rrb.TextDocumentView
    response: list[rrb.TimeSeriesView] = field(default_factory=list)
    residuals: list[rrb.TimeSeriesView] = field(default_factory=list)
    signals: list[rrb.TimeSeriesView] = field(default_factory=list)
    loops: list[rrb.Spatial2DView] = field(default_factory=list)
    cameras: list[rrb.Spatial2DView] = field(default_factory=list)
    every_response: list[rrb.TimeSeriesView] = field(default_factory=list)
    every_residual: list[rrb.TimeSeriesView] = field(default_factory=list)

    @property
    def timed(self) -> bool:
        """Whether anything moves with the cursor."""
        return bool(self.response or self.signals or self.cameras)


def blueprint(views: Views, kind: str, duration_s: float) -> rrb.Blueprint:
    """Return the dashboard: nothing is added or moved by the viewer, its panels are folded."""
    room = ROWS - len(views.response) - len(views.residuals)
    pages = [_first(views, views.signals[:room], view_name("replay", "", kind))]
    if views.every_residual:
        pages.append(_models(views, view_name("models", "", kind)))
    for number, start in enumerate(range(room, len(views.signals), GRID), 1):
        name = view_name(f"further signals {number}", "", kind)
        pages.append(rrb.Grid(*views.signals[start : start + GRID], grid_columns=2, name=name))
    return rrb.Blueprint(
        Pages(*pages, duration_s=duration_s),
        rrb.TimePanel(state="collapsed" if views.timed else "hidden", timeline=TIMELINE),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )


def picture_shape(loops: int, cameras: int) -> tuple[float, float]:
    """Return (width, height of a line of text) of a loop picture, in heights of its axes.

    Texts keep their size on the screen; what room they need depends on how large the picture is.
    """
    if _shared_row(loops, cameras) or not cameras:
        return (1.7 if loops + cameras == 1 else 0.9), 0.085
    return (2.4 if loops == 1 else 1.1), 0.13


def _shared_row(loops: int, cameras: int) -> bool:
    """Return whether loops and cameras stand side by side, rather than in a row each."""
    return loops + cameras <= 2


def _first(views: Views, signals: Sequence[rrb.View], name: str) -> rrb.Container:
    """Return the first page: plots on the left, the text on the right above loops and cameras."""
    rows = [[*views.loops, *views.cameras]]
    if not _shared_row(len(views.loops), len(views.cameras)):
        rows = [[*views.loops], [*views.cameras]]
    pictures = [_row(row) for row in rows if row]
    plots = [*views.response, *views.residuals, *signals]
    if not plots:
        return rrb.Horizontal(*pictures, views.text, name=name)
    shares = [1.5] * len(views.response) + [1.0] * (len(plots) - len(views.response))
    left = rrb.Vertical(*plots, row_shares=shares)
    right = rrb.Vertical(views.text, *pictures, row_shares=[1.25] + [1.0] * len(pictures))
    return rrb.Horizontal(left, right, column_shares=[5.0, 4.0 if pictures or views.response else 2.5], name=name)


def _row(views: Sequence[rrb.View]) -> rrb.Container | rrb.View:
    """Put pictures side by side, more than three in rows of three."""
    if len(views) == 1:
        return views[0]
    return rrb.Horizontal(*views) if len(views) <= 3 else rrb.Grid(*views, grid_columns=3)


def _models(views: Views, name: str) -> rrb.Container:
    residuals = rrb.Grid(*views.every_residual, grid_columns=3)
    return rrb.Vertical(*views.every_response, residuals, row_shares=[2.0, 3.0], name=name)
