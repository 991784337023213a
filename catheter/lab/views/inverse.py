"""The dashboard of an inverse design: voxel map unwrapped, deformed shape on the target, misfit over iterations."""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from catheter.lab.views.designs import PANELS
from catheter.lab.views.output import write
from catheter.reconstruction import Case
from data.signal import Array
from fem.inverse import Reconstruction

TIMELINE = "iteration"
TARGET, FOUND = (150, 150, 150, 255), (230, 120, 40, 255)


def save_inverse(case: Case, found: Reconstruction, title: str, path: Path) -> None:
    """Write the dashboard to `path`, replaced: log10 of the moduli [MPa] and the misfit at each iteration.

    Beside them the outer surface as found (orange) and as wanted (grey), the last pressure, in mm. Raises CannotWrite.
    """
    shape = (case.grid[0], int(np.prod(case.grid[1:])))

    def image(moduli: Array) -> rr.Tensor:
        values = np.log10(moduli.reshape(shape) / 1e6).T[::-1].astype(np.float32)  # the tip on top
        return rr.Tensor(values, dim_names=("along, tip first", "around"), value_range=(-1.3, 1.3))

    def log(stream: rr.RecordingStream) -> None:
        for one in found.history:
            stream.set_time(TIMELINE, sequence=one.number)
            stream.log("/map", image(np.exp(one.log)))
            stream.log("/misfit", rr.Scalars(float(np.log10(max(one.misfit, 1e-16)))))
        stream.log("/truth", image(case.truth), static=True)
        rest = case.voxels.mesh.nodes
        for name, standing, colour in (("wanted", case.whole[-1], TARGET), ("found", found.standings[-1], FOUND)):
            points = rr.Points3D(1e3 * standing.state.x[: len(rest)], colors=colour, radii=0.12)
            stream.log(f"/shape/{name}", points, static=True)
        views = rrb.Grid(
            rrb.TensorView(name="log10 modulus [MPa], unwrapped, found from simulated data", origin="/map"),
            rrb.TensorView(name="log10 modulus [MPa] that made the data, simulated", origin="/truth"),
            rrb.Spatial3DView(name="shape [mm]: found (orange) on wanted (grey), simulated", origin="/shape"),
            rrb.TimeSeriesView(name=f"log10 misfit, {title}, simulated", origin="/misfit"),
        )
        stream.send_blueprint(rrb.Blueprint(views, *PANELS, rrb.TimePanel(timeline=TIMELINE, state="collapsed")))

    write("inverse", path, log)
