"""The dashboard of a replay: signals, models, loops and pictures on one timeline, in one .rrd.

The .rrd is a view, made anew when it is asked for; the recording stays the record. Only the
release of rerun that wrote a .rrd, and the next, are promised to read it.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import rerun as rr
import rerun.blueprint as rrb

from catheter.lab.views.cameras import log_camera
from catheter.lab.views.clocks import Clocks
from catheter.lab.views.columns import Columns, collect
from catheter.lab.views.labels import view_name
from catheter.lab.views.layout import Views, blueprint, picture_shape
from catheter.lab.views.loops import log_loops
from catheter.lab.views.output import Output
from catheter.lab.views.pages import few, residual_plots, residuals_plot, response_plot, signal_plots
from catheter.lab.views.summary import summary

if TYPE_CHECKING:
    from catheter.lab.replay import Replay


def save(replay: "Replay", path: Path, *, progress: Callable[[float], None] | None = None) -> None:
    """Write the dashboard of a replay to `path`, an .rrd file that is replaced.

    progress is called with the share that is written, rising to 1. Numbers are logged by column,
    pictures one at a time, and written as they come: memory holds the numbers and few pictures.
    Raises CannotWrite for a place that cannot be written, BadInput for a recording whose pictures
    cannot be read.
    """
    clocks = Clocks()
    columns = collect(replay, clocks)
    with Output("replay", path) as output:
        _write(output, replay, clocks, columns, _steps(replay, clocks, progress))
    if progress:
        progress(1.0)


def _steps(replay: "Replay", clocks: Clocks, progress: Callable[[float], None] | None) -> Callable[[], None]:
    """Return what is to be called after each clock and each picture; the end is one step more."""
    total = len(clocks) + sum(replay.recording.channels[name].messages for name in replay.cameras) + 1
    done = 0

    def step() -> None:
        nonlocal done
        done += 1
        if progress:
            progress(done / total)

    return step


def _write(output: Output, replay: "Replay", clocks: Clocks, columns: Columns, step: Callable[[], None]) -> None:
    kind, stream = replay.recording.kind, output.stream
    clocks.send(output, step)
    views = Views(rrb.TextDocumentView(name=view_name("recording", "", kind), origin="/summary"))
    families = [family for family in replay.loops if family.loops]
    shape = picture_shape(len(families), len(replay.cameras))
    views.loops = [log_loops(stream, family, replay.signals, kind, shape) for family in families]
    left_out: list[str] = []
    cameras = [log_camera(output, replay.recording, topic, left_out, step) for topic in replay.cameras]
    views.cameras = [view for view in cameras if view]
    views.signals = signal_plots(replay, columns, left_out)
    _models(replay, columns, views)
    # Last, because it lists what was left out on the way.
    document = rr.TextDocument(summary(replay, left_out), media_type=rr.MediaType.MARKDOWN)
    stream.log("/summary", document, static=True)
    stream.send_recording_name(replay.title)
    stream.send_blueprint(blueprint(views, kind, replay.recording.duration_s))


def _models(replay: "Replay", columns: Columns, views: Views) -> None:
    shown = few(replay, columns)
    if shown:
        views.response = [response_plot(replay, columns, shown)]
        views.residuals = [residuals_plot(replay, shown)]
        views.every_response = [response_plot(replay, columns, columns.candidates[::-1])]
        views.every_residual = residual_plots(replay, columns.candidates)
