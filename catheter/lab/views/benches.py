"""What the dashboards of the valve benches share: plots, flow drawn over pressure drop, the page."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from catheter.lab.views.clocks import TIMELINE, Clocks
from catheter.lab.views.designs import PANELS
from catheter.lab.views.labels import Colour, view_name
from catheter.lab.views.layout import Pages
from catheter.lab.views.loops import Axis, Sheet
from catheter.lab.views.plots import Line, plot
from data.signal import Array

ML, KPA = 1e6, 1e-3
MOST_POINTS = 4000  # of flow over drop
WIDTH, TEXT_LINE = 1.5, 0.085  # of the drawing, in heights of its axes


def plotted(
    title: str, lines: list[tuple[str, Array, Colour]], time_s: Array, kind: str, clocks: Clocks
) -> rrb.TimeSeriesView:
    """Return a plot of named columns (n,) over time_s (n,), which are put on the clocks."""
    group = title.replace(" ", "_")
    drawn = [Line(clocks.add(group, name, time_s, values), name, colour) for name, values, colour in lines]
    return plot(view_name(title, "", kind), drawn)


def flow_sheet(stream: rr.RecordingStream, drop_pa: Array, flow_m3_s: Array) -> Sheet:
    """Return the drawing of flow [mL/s] over drop [kPa], with its axes."""
    axes = []
    for name, unit, factor, values, length in (
        ("pressure drop", "kPa", KPA, drop_pa, WIDTH),
        ("flow", "mL/s", ML, flow_m3_s, 1.0),
    ):
        low, high = factor * float(np.nanmin(values)), factor * float(np.nanmax(values))
        margin = 0.06 * (high - low) or 1.0
        axes.append(Axis(name, unit, factor, low - margin, high + margin, length))
    sheet = Sheet(stream, "/flow_over_drop", axes[0], axes[1], TEXT_LINE)
    sheet.axes()
    return sheet


def scatter(sheet: Sheet, points: Array, colour: Colour) -> None:
    """Draw at most MOST_POINTS of the points (n, 2), spread evenly."""
    kept = np.unique(np.linspace(0, len(points) - 1, MOST_POINTS).astype(int))
    drawn = rr.Points2D(points[kept], colors=colour, radii=rr.Radius.ui_points(1.0), draw_order=-1)
    sheet.stream.log(f"{sheet.path}/data", drawn, static=True)


def label(sheet: Sheet, place: tuple[float, float], text: str, colour: Colour) -> None:
    """Write a text that hangs from a place on the drawing, (0, 0) to (width, -1)."""
    name = "".join(each if each.isalnum() else "_" for each in text)
    drawn = rr.Points2D([place], labels=[text], colors=colour, radii=1e-9, show_labels=True)
    sheet.stream.log(f"{sheet.path}/label/{name}", drawn, static=True)


def sheet_view(sheet: Sheet, title: str, kind: str) -> rrb.Spatial2DView:
    """Return the view of the drawing."""
    return rrb.Spatial2DView(name=view_name(title, "", kind), origin=sheet.path, visual_bounds=sheet.bounds())


def text_view(stream: rr.RecordingStream, lines: Sequence[str], title: str, kind: str) -> rrb.TextDocumentView:
    """Log the notes, lines of markdown, and return their view."""
    stream.log("/text", rr.TextDocument("\n".join(lines), media_type=rr.MediaType.MARKDOWN), static=True)
    return rrb.TextDocumentView(name=view_name(title, "", kind), origin="/text")


def send(
    stream: rr.RecordingStream, name: str, above: Sequence[rrb.View], plots: Sequence[rrb.View], duration_s: float
) -> None:
    """Send the page: pictures and text above, plots below. name: as the viewer lists it."""
    page = rrb.Vertical(rrb.Horizontal(*above), rrb.Grid(*plots, grid_columns=2), row_shares=[5.0, 4.0], name=name)
    stream.send_recording_name(name)
    panel = rrb.TimePanel(state="collapsed", timeline=TIMELINE)
    pages = Pages(page, duration_s=duration_s)
    stream.send_blueprint(rrb.Blueprint(pages, panel, *PANELS, auto_layout=False, auto_views=False))
