"""The dashboard of an inverse design, written while it is sought: voxel map unwrapped, shape on target, misfit."""

from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from catheter.lab.invert_live import Sought
from catheter.lab.views.designs import PANELS
from catheter.lab.views.labels import literal, view_name
from catheter.lab.views.layout import eye_on
from catheter.lab.views.output import PENDING, Output
from catheter.reconstruction import Quality
from data.signal import Array
from fem.inverse import Iteration

TIMELINE = "iteration"
TARGET, FOUND = (150, 150, 150, 255), (230, 120, 40, 255)


class InverseView:
    """Writes the dashboard iteration by iteration; a context manager around the search.

    Each iteration is in the file once it is done: what an interrupted search has found is there to be looked at.
    Raises CannotWrite for a place that cannot be written.
    """

    def __init__(self, path: Path, sought: Sought) -> None:
        self._output, self._sought = Output("inverse", path), sought
        self._stream, self._count = self._output.stream, 0

    def __enter__(self) -> Self:
        """Open the file and write what is wanted."""
        self._output.__enter__()
        sought, kind = self._sought, self._sought.kind
        maps = [rrb.TensorView(name=view_name("data: map found", "log10 MPa", kind), origin="/map")]
        if len(sought.truth):
            self._stream.log("/truth", self._image(sought.truth), static=True)
            maps.append(rrb.TensorView(name=view_name("data: map behind them", "log10 MPa", kind), origin="/truth"))
        maps.append(rrb.TensorView(name=view_name("data: sd of log modulus, at the end", "", kind), origin="/sd"))
        middle = sought.wanted.mean(axis=0)
        eye = eye_on(1e3 * (middle + 1.4 * (sought.wanted - middle)), (0.7, -0.8, 0.3))  # room for what is found
        name = view_name("shape wanted (grey), found (orange)", "mm", kind)
        rest = (
            rrb.Spatial3DView(name=name, origin="/shape", eye_controls=eye, line_grid=False),
            rrb.TimeSeriesView(name=view_name("data: log10 of the misfit", "", kind), origin="/misfit"),
            rrb.TextDocumentView(name=view_name("data: notes", "", kind), origin="/notes"),
        )
        views = rrb.Vertical(rrb.Horizontal(*maps), rrb.Horizontal(*rest))
        self._stream.send_recording_name(f"{kind}: {sought.title}")
        self._stream.send_blueprint(rrb.Blueprint(views, *PANELS, rrb.TimePanel(timeline=TIMELINE, state="collapsed")))
        self._stream.set_time(TIMELINE, sequence=0)
        self.want(sought.wanted)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Finish the file."""
        self._output.__exit__(kind, error, trace)

    def want(self, wanted: Array) -> None:
        """Say what is wanted (k, 3) [m] from the next iteration on."""
        self._points("wanted", wanted, TARGET)

    def show(self, one: Iteration) -> None:
        """Add an iteration; they are counted here, those of one search after another."""
        self._stream.set_time(TIMELINE, sequence=self._count)
        self._count += 1
        self._stream.log("/map", self._image(np.exp(one.log)))
        self._stream.log("/misfit", rr.Scalars(float(np.log10(max(one.misfit, 1e-16)))))
        self._stream.log("/notes", rr.TextDocument(self._notes(one), media_type=rr.MediaType.MARKDOWN))
        self._points("found", one.shapes[-1], FOUND)
        self._output.settle(PENDING)

    def sure(self, sd: Array) -> None:
        """Add the posterior standard deviation of each log modulus (v,), as it is at the end."""
        self._stream.log("/sd", self._tensor(sd, (0.0, float(sd.max()))))

    def _notes(self, one: Iteration) -> str:
        """Return what is known at an iteration."""
        moduli, truth = np.exp(one.log) / 1e6, self._sought.truth
        lines = [
            f"{self._sought.kind}: {literal(self._sought.title)}",
            f"Iteration {one.number}, {one.seconds:.1f} s: misfit {one.misfit:.3g}, weight {one.weight:.2g}",
            f"Moduli {moduli.min():.3g} to {moduli.max():.3g} MPa, median {np.median(moduli):.3g}; the tip is on top",
        ]
        if len(truth):
            quality = Quality.of(np.exp(one.log), truth)
            lines.append(
                f"Beside the map behind the data: {100 * quality.right:.1f} % of voxels on the right side of"
                f" stiff and soft; error {quality.median:.2g} in the median, {quality.largest:.2g} at most"
            )
        return "\n".join(f"- {line}" for line in lines)

    def _points(self, name: str, places: Array, colour: tuple[int, int, int, int]) -> None:
        self._stream.log(f"/shape/{name}", rr.Points3D(1e3 * places, colors=colour, radii=0.12))

    def _image(self, moduli: Array) -> rr.Tensor:
        return self._tensor(np.log10(moduli / 1e6), (-1.3, 1.3))

    def _tensor(self, values: Array, span: tuple[float, float]) -> rr.Tensor:
        shape = (self._sought.grid[0], int(np.prod(self._sought.grid[1:])))
        flat = values.reshape(shape).T[::-1].astype(np.float32)  # the tip on top
        return rr.Tensor(flat, dim_names=("along, tip first", "around"), value_range=span)
