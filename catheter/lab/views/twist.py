"""The overlay of a twist: frames with blobs, angle, uncertainty and the region that is searched first."""

import math
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from catheter.lab.views.clocks import TIMELINE, stamps
from catheter.lab.views.labels import BEST, MARK, MEASURED, MODELS, view_name
from catheter.lab.views.output import Output
from data.files import check_free
from vision.frames import Frame, Source
from vision.twist import Row, region_px

MOST_SHOWN = 600  # pictures in a dashboard: of a longer video every second, third ... one


class TwistView:
    """Writes an overlay dashboard while frames are measured; a context manager around the measurement."""

    def __init__(self, path: Path, source: Source, *, replace: bool = False) -> None:
        check_free(path, replace)
        self._source, self._output = source, Output("twist", path)
        self._stream = self._output.stream
        self._every = max(1, math.ceil(source.count / MOST_SHOWN))
        self._times: list[float] = []
        self._values: list[tuple[float, float]] = []

    def __enter__(self) -> Self:
        """Return the view itself."""
        self._output.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Write the dashboard, unless the measurement failed."""
        try:
            if error is None:
                self._finish()
        finally:
            self._output.__exit__(kind, error, trace)

    def picture(self, frame: Frame) -> None:
        """Add a frame's picture, if it is one of those that are shown."""
        if frame.picture is None or frame.number % self._every:
            return
        import cv2

        shown = frame.picture if frame.picture.dtype == np.uint8 else (frame.picture >> 8).astype(np.uint8)
        jpeg = cv2.imencode(".jpg", shown, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes()
        columns = rr.EncodedImage.columns(blob=[jpeg], media_type=["image/jpeg"])
        self._stream.send_columns("/camera", indexes=[stamps(np.array([frame.time_s]))], columns=columns)
        self._output.settle(len(jpeg))

    def mark(self, row: Row) -> None:
        """Add what was found in a frame; a frame without a marker clears the one before."""
        self._times.append(row.time_s)
        self._values.append((math.degrees(row.angle_rad), math.degrees(row.sigma_rad)))
        if row.number % self._every:
            return
        self._stream.set_time(TIMELINE, duration=np.timedelta64(round(row.time_s * 1e9), "ns"))
        if row.fit is None:
            for name in ("blobs", "legs", "region"):
                self._stream.log(f"/camera/{name}", rr.Clear(recursive=False))
            self._stream.log("/reason", rr.TextDocument(f"missing: {row.reason}"))
            return
        blobs, side = row.fit.blobs_px, row.fit.size * row.fit.pitch_px
        names, colours = ["corner", "second", "third"], [MARK, BEST, MEASURED]
        self._stream.log("/camera/blobs", rr.Points2D(blobs, radii=side / 8, labels=names, colors=colours))
        angle, sigma = self._values[-1]
        text = f"{angle:.4f} +- {sigma:.1g} deg"
        self._stream.log(
            "/camera/legs", rr.LineStrips2D([blobs[[1, 0, 2]]], colors=[MODELS[1]], labels=[text], radii=side / 30)
        )
        x, y, width, height = region_px(row.fit)
        box = rr.Boxes2D(array=[[x, y, width, height]], array_format=rr.Box2DFormat.XYWH, colors=[MODELS[0]])
        self._stream.log("/camera/region", box)
        how = "followed" if row.followed else "searched in the whole frame"
        self._stream.log("/reason", rr.TextDocument(f"{text}, {how}, noise {row.fit.noise_grey:.2f} grey"))

    def _finish(self) -> None:
        kind = self._source.origin
        if self._times:
            values, clock = np.array(self._values), [stamps(np.array(self._times))]
            for name, column in (("angle", values[:, 0]), ("sigma", values[:, 1])):
                self._stream.send_columns(f"/{name}", indexes=clock, columns=rr.Scalars.columns(scalars=column))
        plots = [
            rrb.TimeSeriesView(name=view_name(name, "deg", kind), origin=f"/{name}") for name in ("angle", "sigma")
        ]
        camera = rrb.Spatial2DView(name=view_name("camera", "", kind), origin="/camera")
        text = rrb.TextDocumentView(name=view_name("frame", "", kind), origin="/reason")
        page = rrb.Horizontal(rrb.Vertical(camera, text, row_shares=[6, 1]), rrb.Vertical(*plots))
        folded = (rrb.BlueprintPanel(state="collapsed"), rrb.SelectionPanel(state="collapsed"))
        panel = rrb.TimePanel(state="collapsed", timeline=TIMELINE)
        self._stream.send_recording_name(f"twist of {self._source.path.name}")
        self._stream.send_blueprint(rrb.Blueprint(page, panel, *folded, auto_layout=False, auto_views=False))
