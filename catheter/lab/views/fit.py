"""The dashboard of a bender's fit: measured and model, residual, dropped terms, all subsets, spectrogram.

An .rrd like a replay's: a view, made anew when it is asked for.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from catheter.lab.views.clocks import TIMELINE, stamps
from catheter.lab.views.designs import PANELS
from catheter.lab.views.labels import BEST, MEASURED, MODELS, Colour, view_name
from catheter.lab.views.output import Output
from data.signal import Array

if TYPE_CHECKING:
    from sysid.identify import Identification

MOST_POINTS = 30_000


def save(found: "Identification", time_s: Array, x: Array, kind: str, path: Path) -> None:
    """Write the dashboard of a fit to `path`. time_s and x (n,): the whole input. Raises CannotWrite."""
    with Output("fit", path) as output:
        stream = output.stream
        views = [*_series(stream, found, time_s[found.used], kind), *_drawings(stream, found, time_s, x, kind)]
        stream.send_blueprint(
            rrb.Blueprint(
                rrb.Grid(*views, grid_columns=2), rrb.TimePanel(state="collapsed", timeline=TIMELINE), *PANELS
            )
        )


def _line(stream: rr.RecordingStream, path: str, time_s: Array, values: Array, look: tuple[Colour, str]) -> None:
    stride = max(1, len(time_s) // MOST_POINTS)
    colour, name = look
    stream.log(path, rr.SeriesLines(names=name, colors=colour), static=True)
    times = stamps(time_s[::stride])
    stream.send_columns(path, [times], rr.Scalars.columns(scalars=values[::stride]))


def _series(stream: rr.RecordingStream, found: "Identification", time_s: Array, kind: str) -> list[rrb.View]:
    """Log what goes over time: response, residual, each dropped term's cumulative error (thesis Fig 3.29, 3.31)."""
    from sysid.estimate import dropped

    _line(stream, "/response/measured", time_s, found.response, (MEASURED, kind))
    _line(stream, "/response/model", time_s, found.response - found.residual, (BEST, "model"))
    _line(stream, "/residual", time_s, found.residual, (BEST, "residual"))
    differences, percent = dropped(found.selection, found.columns, found.response)
    for index, (term, end) in enumerate(zip(found.selection.terms, percent, strict=True)):
        path = f"/dropped/{index}"
        look = MODELS[index % len(MODELS)], f"{term}: {end:+.3g} %"
        _line(stream, path, time_s, differences[:, index], look)
    titles = {"/response": "response and model", "/residual": "residual", "/dropped": "cumulative error, term dropped"}
    return [rrb.TimeSeriesView(name=view_name(title, "", kind), origin=path) for path, title in titles.items()]


def _drawings(
    stream: rr.RecordingStream, found: "Identification", time_s: Array, x: Array, kind: str
) -> list[rrb.View]:
    """Log what does not: every subset's error over its size (thesis Fig 3.30, 3.32), the input's spectrogram."""
    from scipy.signal import spectrogram

    selection = found.selection
    share = selection.rmse / (selection.rmse[0] or 1.0)
    fan = np.stack([selection.sizes, -10 * share], axis=1)
    stream.log("/subsets/all", rr.Points2D(fan, radii=0.05, colors=MEASURED), static=True)
    best = [" ".join(selection.names(int(mask))) or "constant" for mask in selection.best]
    stream.log("/subsets/best", rr.LineStrips2D([fan[selection.best]], colors=[BEST]), static=True)
    stream.log(
        "/subsets/best/names", rr.Points2D(fan[selection.best], labels=best, colors=BEST, radii=0.1), static=True
    )
    rate_hz = (len(time_s) - 1) / float(time_s[-1] - time_s[0])
    sound = np.where(np.isfinite(x), x, np.nanmean(x))
    segment = min(4096, len(x) // 4)
    power = spectrogram(sound, rate_hz, nperseg=segment, noverlap=segment // 2)[2]
    decibels = 10 * np.log10(np.maximum(power[: max(2, int(20 / rate_hz * segment))], 1e-20))[::-1]
    span = (float(decibels.max()) - 90, float(decibels.max()))
    picture = (255 * ((decibels - span[0]) / 90).clip(0, 1)).astype(np.uint8)
    stream.log("/spectrogram", rr.Image(picture, color_model="L"), static=True)
    fan_name = view_name("error of all subsets over their size", "10: constant only", kind)
    return [
        rrb.Spatial2DView(name=fan_name, origin="/subsets"),
        rrb.Spatial2DView(name=view_name("spectrogram of the input, 0 to 20 Hz", "dB", kind), origin="/spectrogram"),
    ]
