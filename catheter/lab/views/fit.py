"""The dashboard of a bender's fit: measured and model, residual, dropped terms, all subsets, spectrogram, weights.

An .rrd like a replay's: a view, made anew when it is asked for.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from catheter.lab.views.benches import label, plotted, scatter, sheet_view, text_view
from catheter.lab.views.clocks import TIMELINE, Clocks
from catheter.lab.views.designs import PANELS
from catheter.lab.views.labels import BEST, MEASURED, MODELS, TEXT, Colour, literal, view_name
from catheter.lab.views.layout import Pages
from catheter.lab.views.loops import Axis, Sheet
from catheter.lab.views.output import Output
from data.signal import Array

if TYPE_CHECKING:
    from sysid.identify import Identification

MOST_POINTS = 30_000
MOST_HZ = 20.0  # of the spectrogram
DECIBELS = 90.0  # from its darkest to its brightest
PICTURE = (300, 560)  # of the spectrogram: rows, columns


def save(found: "Identification", time_s: Array, x: Array, kind: str, path: Path) -> None:
    """Write the dashboard of a fit to `path`. time_s and x (n,): the whole input. Raises CannotWrite."""
    clocks = Clocks()
    plots = _plots(found, time_s[found.used], kind, clocks)
    with Output("fit", path) as output:
        clocks.send(output, lambda: None)
        pictures = [_subsets(output.stream, found, kind), _spectrogram(output.stream, time_s, x, kind)]
        text = text_view(output.stream, _text(found), "force model", kind)
        page = rrb.Horizontal(
            rrb.Vertical(*plots),
            rrb.Vertical(text, *pictures),
            column_shares=[5.0, 4.0],
            name=view_name("fit of a force model", "", kind),
        )
        panel = rrb.TimePanel(state="collapsed", timeline=TIMELINE)
        pages = Pages(page, duration_s=float(time_s[-1]))
        output.stream.send_recording_name(view_name("fit of a force model", "", kind))
        output.stream.send_blueprint(rrb.Blueprint(pages, panel, *PANELS, auto_layout=False, auto_views=False))


def _plots(found: "Identification", time_s: Array, kind: str, clocks: Clocks) -> list[rrb.TimeSeriesView]:
    """Return what goes over time: response, residual, each dropped term's cumulative error (thesis Fig 3.29, 3.31)."""
    from sysid.estimate import dropped

    differences, percent = dropped(found.selection, found.columns, found.response)
    terms = [
        (f"{term}: {end:+.3g} %", differences[:, index], MODELS[index % len(MODELS)])
        for index, (term, end) in enumerate(zip(found.selection.terms, percent, strict=True))
    ]
    groups: dict[str, list[tuple[str, Array, Colour]]] = {
        "response and model": [(kind, found.response, MEASURED), ("model", found.response - found.residual, BEST)],
        "residual, data minus model": [("residual", found.residual, BEST)],
        "cumulative error when a term is dropped": terms,
    }
    kept = slice(None, None, max(1, len(time_s) // MOST_POINTS))
    thin = time_s[kept]
    return [
        plotted(title, [(name, values[kept], colour) for name, values, colour in lines], thin, kind, clocks)
        for title, lines in groups.items()
    ]


def _subsets(stream: rr.RecordingStream, found: "Identification", kind: str) -> rrb.Spatial2DView:
    """Draw every subset's error over its size, the best of each size joined (thesis Fig 3.30, 3.32)."""
    selection = found.selection
    share = 100 * selection.rmse / (selection.rmse[0] or 1.0)
    most = float(selection.sizes.max())
    x = Axis("terms", "number", 1.0, -0.3, most + 0.3, 2.4)
    sheet = Sheet(stream, "/subsets", x, Axis("error", "% of the constant alone", 1.0, -4.0, 108.0, 1.0), 0.13)
    sheet.axes()
    points = sheet.points(selection.sizes.astype(np.float64), share)
    scatter(sheet, points, MEASURED)
    line = rr.LineStrips2D([points[selection.best]], colors=BEST, radii=rr.Radius.ui_points(1.2))
    stream.log("/subsets/best", line, static=True)
    chosen = points[found.mask]
    ring = rr.Points2D([chosen], colors=BEST, radii=rr.Radius.ui_points(5))
    stream.log("/subsets/chosen", ring, static=True)
    label(sheet, (float(chosen[0]) + 0.1, float(chosen[1]) - 0.25), "chosen", BEST)
    return sheet_view(sheet, "error of every subset of terms", kind)


def _spectrogram(stream: rr.RecordingStream, time_s: Array, x: Array, kind: str) -> rrb.Spatial2DView:
    from scipy.signal import spectrogram

    rate_hz = (len(time_s) - 1) / float(time_s[-1] - time_s[0])
    sound = np.where(np.isfinite(x), x, np.nanmean(x))
    segment = min(4096, max(8, len(x) // 16))
    power = spectrogram(sound, rate_hz, nperseg=segment, noverlap=segment // 2)[2]
    top_hz = min(MOST_HZ, rate_hz / 2)
    shown = 10 * np.log10(np.maximum(power[: max(2, int(top_hz / rate_hz * segment))], 1e-20))[::-1]
    share = ((shown - shown.max()) / DECIBELS + 1).clip(0, 1)
    rows, columns = (np.arange(n) * have // n for n, have in zip(PICTURE, share.shape, strict=True))
    stream.log("/spectrogram", rr.Image((255 * share[np.ix_(rows, columns)]).astype(np.uint8), "L"), static=True)
    height, width = PICTURE
    places = [(30, 10), (30, height - 45), (width / 2, height - 20)]
    texts = [f"{top_hz:g} Hz", "0 Hz", f"0 to {time_s[-1] - time_s[0]:.4g} s"]
    named = rr.Points2D(places, labels=texts, colors=TEXT, radii=1e-9, show_labels=True)
    stream.log("/spectrogram/axes", named, static=True)
    name = view_name(f"input's spectrogram, {DECIBELS:g} dB", "", kind)
    bounds = rrb.VisualBounds2D(x_range=(0, width), y_range=(0, height))
    return rrb.Spatial2DView(name=name, origin="/spectrogram", visual_bounds=bounds)


def _text(found: "Identification") -> list[str]:
    chosen = found.chosen
    lines = ["| term | weight | low | high |", "|---|---:|---:|---:|"]
    for name, *numbers in zip(chosen.names, chosen.values, chosen.low, chosen.high, strict=True):
        lines.append(f"| {literal(name)} | {' | '.join(f'{number:.4g}' for number in numbers)} |")
    notes = [
        f"Chosen by {found.options.rule}; RMSE {chosen.rmse:.4g}, fit {chosen.fit_percent:.1f} %, held out"
        f" {found.held_out:.4g}; {chosen.samples} samples.",
        "Low and high: block bootstrap. x: the input, xd and xdd its rates.",
    ]
    return [*lines, "", *(f"- {literal(note)}" for note in notes)]
