"""How the views of a replay are arranged: a first page, every model, and what found no room."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import rerun.blueprint as rrb

from catheter.lab.views.labels import view_name

ROWS = 6  # plots that stand under each other on the first page
GRID = 12  # plots on each further page


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


def blueprint(views: Views, kind: str) -> rrb.Blueprint:
    """Return the dashboard: nothing is added or moved by the viewer, its panels are folded."""
    room = ROWS - len(views.response) - bool(views.residuals)
    pages = [_first(views, views.signals[:room], view_name("replay", "", kind))]
    if views.every_residual:
        pages.append(_models(views, view_name("every model", "", kind)))
    for number, start in enumerate(range(room, len(views.signals), GRID), 1):
        name = view_name(f"further signals {number}", "", kind)
        pages.append(rrb.Grid(*views.signals[start : start + GRID], grid_columns=2, name=name))
    return rrb.Blueprint(
        pages[0] if len(pages) == 1 else rrb.Tabs(*pages, active_tab=0),
        rrb.TimePanel(state="collapsed", timeline="t"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )


def _first(views: Views, signals: Sequence[rrb.View], name: str) -> rrb.Container:
    plots: list[rrb.Container | rrb.View] = [*views.response]
    if views.residuals:
        plots.append(rrb.Horizontal(*views.residuals))
    plots += signals
    shares = [3.0] * len(views.response) + [2.0] * (len(plots) - len(views.response))
    left = rrb.Vertical(*plots, row_shares=shares) if plots else None
    pictures = [_row(row) for row in (views.loops, views.cameras) if row]
    right = rrb.Vertical(views.text, *pictures, row_shares=[4.0] + [3.5] * len(pictures))
    if left is None:
        return rrb.Horizontal(*pictures, views.text, name=name) if pictures else rrb.Vertical(views.text, name=name)
    return rrb.Horizontal(left, right, column_shares=[5.0, 4.0], name=name)


def _row(views: Sequence[rrb.View]) -> rrb.Container | rrb.View:
    """Put pictures side by side, more than three in rows of three."""
    if len(views) == 1:
        return views[0]
    return rrb.Horizontal(*views) if len(views) <= 3 else rrb.Grid(*views, grid_columns=3)


def _models(views: Views, name: str) -> rrb.Container:
    residuals = rrb.Grid(*views.every_residual, grid_columns=3)
    return rrb.Vertical(*views.every_response, residuals, row_shares=[2.0, 3.0], name=name)
