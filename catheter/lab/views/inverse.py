"""The dashboard of an inverse design, written while it is sought: voxel map unwrapped, shape on target, misfit."""

from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from catheter.lab.invert_live import Sought
from catheter.lab.views.designs import PANELS
from catheter.lab.views.labels import view_name
from catheter.lab.views.output import PENDING, Output
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
        map_name = f"log10 modulus [MPa], unwrapped, found from {kind} data"
        maps = [rrb.TensorView(name=map_name, origin="/map")]
        if len(sought.truth):
            self._stream.log("/truth", self._image(sought.truth), static=True)
            maps.append(rrb.TensorView(name=f"log10 modulus [MPa] that made the data, {kind}", origin="/truth"))
        maps.append(rrb.TensorView(name=f"posterior sd of log modulus, at the end, {kind} data", origin="/sd"))
        shape_name = view_name("shape, found (orange) on wanted (grey)", "mm", kind)
        views = rrb.Grid(
            *maps,
            rrb.Spatial3DView(name=shape_name, origin="/shape"),
            rrb.TimeSeriesView(name=view_name(f"log10 misfit, {sought.title}", "", kind), origin="/misfit"),
        )
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
        self._points("found", one.shapes[-1], FOUND)
        self._output.settle(PENDING)

    def sure(self, sd: Array) -> None:
        """Add the posterior standard deviation of each log modulus (v,), as it is at the end."""
        self._stream.log("/sd", self._tensor(sd, (0.0, float(sd.max()))))

    def _points(self, name: str, places: Array, colour: tuple[int, int, int, int]) -> None:
        self._stream.log(f"/shape/{name}", rr.Points3D(1e3 * places, colors=colour, radii=0.12))

    def _image(self, moduli: Array) -> rr.Tensor:
        return self._tensor(np.log10(moduli / 1e6), (-1.3, 1.3))

    def _tensor(self, values: Array, span: tuple[float, float]) -> rr.Tensor:
        shape = (self._sought.grid[0], int(np.prod(self._sought.grid[1:])))
        flat = values.reshape(shape).T[::-1].astype(np.float32)  # the tip on top
        return rr.Tensor(flat, dim_names=("along, tip first", "around"), value_range=span)
