"""Dashboard of an inflation: the deformed tube by material and by stretch, its curves, and Newton's history."""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from catheter.lab.views.labels import BEST, FRAME, MEASURED, MODELS, literal, ramp, view_name
from catheter.lab.views.output import write
from data.recording import SIMULATED
from data.signal import Array
from fem.grid import Indices, skin
from fem.tube import Inflation

SHADES = 64
PANELS = (rrb.BlueprintPanel(state="collapsed"), rrb.SelectionPanel(state="collapsed"))
COLOURS = (MEASURED, BEST, *MODELS)
UNITS = {"twist": "deg", "bending": "deg", "extension": "mm", "volume": "of rest", "pressure": "kPa"}

Colours = NDArray[np.uint8]


def save_inflation(run: Inflation, title: str, path: Path) -> None:
    """Write the dashboard of an inflation to `path`, replaced; its timeline is the load.

    Under pressure control the timeline counts Pa, under volume control thousandths of the volume at rest.
    Raises CannotWrite for a place that cannot be written.
    """
    write("inflate", path, lambda stream: _log(stream, run, title))


def timeline_of(run: Inflation) -> str:
    """Return the name of the dashboard's timeline."""
    return "pressure_Pa" if run.control == "pressure" else "volume_ratio_1000"


def _log(stream: rr.RecordingStream, run: Inflation, title: str) -> None:
    mesh = run.system.body.mesh
    quads, part = skin(mesh)
    laws = list(dict.fromkeys(run.tube.material.ravel()))
    colours = np.array([COLOURS[k % len(COLOURS)] for k in range(len(laws))] + [FRAME], dtype=np.uint8)
    number = {law: k for k, law in enumerate(laws)}
    kind = np.array([*(number[law] for law in run.tube.material.ravel()), len(laws)])[part]  # part -1: the cap
    stretches = [run.stretch(k).ravel() for k in range(len(run.points))]
    most = max(float(each.max()) for each in stretches)
    shades = np.array(ramp(SHADES), dtype=np.uint8)
    timeline = timeline_of(run)
    ratio = run.volume / run.tube.rest_volume
    at = run.pressure if run.control == "pressure" else 1000 * ratio
    curves = {"twist": np.degrees(run.twist), "bending": np.degrees(run.bending), "extension": 1e3 * run.extension}
    curves |= {"volume": ratio} if run.control == "pressure" else {"pressure": run.pressure / 1e3}
    _moment(stream, timeline, 0 if run.control == "pressure" else 1000)
    for name in curves:
        stream.log(f"/curve/{name}", rr.Scalars(1.0 if name == "volume" else 0.0))
    stream.log("/newton", rr.BarChart([0.0]))
    _tube(stream, quads, mesh.nodes, colours[kind], shades[np.zeros(len(quads), dtype=int)])
    for k, point in enumerate(run.points):
        _moment(stream, timeline, round(float(at[k])))
        share = np.append(stretches[k], 1.0)[part] - 1
        levels = np.clip(share / max(most - 1, 1e-12) * (SHADES - 1), 0, SHADES - 1).astype(int)
        _tube(stream, quads, point.x, colours[kind], shades[levels])
        for name, values in curves.items():
            stream.log(f"/curve/{name}", rr.Scalars(round(float(values[k]), 9)))
        digits = -np.log10(np.maximum(point.residuals, 1e-16))
        stream.log("/newton", rr.BarChart(np.maximum(digits, 0.0)))
    stream.log("/text", rr.TextDocument(_text(run, title, most), media_type="text/markdown"), static=True)
    stream.send_recording_name(f"{SIMULATED}: {title}")
    end = 1e3 * np.vstack([mesh.nodes, run.points[-1].x])
    ends = (0 if run.control == "pressure" else 1000, round(float(at.max())))
    stream.send_blueprint(_blueprint(timeline, [*curves], most, ends, end), make_active=True)


def _moment(stream: rr.RecordingStream, timeline: str, count: int) -> None:
    stream.set_time(timeline, sequence=count)


def _tube(stream: rr.RecordingStream, quads: Indices, x: Array, kind: Colours, shade: Colours) -> None:
    """Log the skin twice, each face with four corners of its own, so that it has one colour [mm]."""
    corners = 1e3 * x[quads]
    across = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normal = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30)
    first = 4 * np.arange(len(quads))[:, None]
    triangles = (first + np.array([[0, 1, 2, 0, 2, 3]])).reshape(-1, 3).astype(np.uint32)
    for name, colour in (("material", kind), ("stretch", shade)):
        mesh = rr.Mesh3D(
            vertex_positions=corners.reshape(-1, 3).astype(np.float32),
            triangle_indices=triangles,
            vertex_normals=np.repeat(normal, 4, axis=0).astype(np.float32),
            vertex_colors=np.repeat(colour, 4, axis=0),
        )
        stream.log(f"/{name}", mesh)


def _text(run: Inflation, title: str, most: float) -> str:
    laws = list(dict.fromkeys(run.tube.material.ravel()))
    names = ("blue", "orange", "magenta", "green", "red", "violet", "teal", "yellow", "brown")
    lines = [f"**SIMULATED: {literal(title)}**", ""]
    lines += [
        f"- {names[k % len(names)]}: {literal(law.name or type(law).__name__)}, shear modulus {law.shear / 1e6:.3g} MPa"
        for k, law in enumerate(laws)
    ]
    lines += [
        "- grey: cap" * (run.tube.cap > 0),
        f"- stretch: violet 1 to yellow {most:.3f}, the largest in a voxel",
        f"- {len(run.system.free)} unknowns, {run.solver}, {int(run.iterations.sum())} Newton iterations",
        f"- stable under its pressure: {int(run.stable.sum())} of {len(run.points)} loads",
        f"- past their material's elongation at the last load: {int(run.overstretched().sum())} voxels",
        "- twist is anticlockwise as seen from +z, the tip's side; mesh in mm",
    ]
    return "\n".join(lines)


def _blueprint(timeline: str, curves: list[str], most: float, ends: tuple[int, int], nodes: Array) -> rrb.Blueprint:
    """Return the page; ends: of the timeline. nodes (n, 3) [mm] must be in the camera's sight."""
    first, last = (rrb.TimeRangeBoundary.absolute(seq=count) for count in ends)
    axis = rrb.TimeAxis(view_range=rr.TimeRange(start=first, end=last))
    middle, reach = (nodes.min(axis=0) + nodes.max(axis=0)) / 2, float(np.ptp(nodes, axis=0).max())
    eye = rrb.EyeControls3D(
        position=middle + reach * np.array([1.0, -1.0, 0.4]), look_target=middle, eye_up=(0.0, 0.0, 1.0)
    )
    plots = [
        rrb.TimeSeriesView(name=view_name(name, UNITS[name], SIMULATED), origin=f"/curve/{name}", axis_x=axis)
        for name in curves
    ]
    newton = rrb.BarChartView(name=view_name("Newton: digits of balance by iteration", "", SIMULATED), origin="/newton")
    text = rrb.TextDocumentView(name=view_name("inflation", "", SIMULATED), origin="/text")
    meshes = [
        rrb.Spatial3DView(name=view_name("materials", "", SIMULATED), origin="/material", eye_controls=eye),
        rrb.Spatial3DView(
            name=view_name(f"stretch 1 to {most:.2f}", "", SIMULATED), origin="/stretch", eye_controls=eye
        ),
    ]
    left = rrb.Vertical(rrb.Horizontal(*meshes), rrb.Horizontal(text, newton), row_shares=[2, 1])
    page = rrb.Horizontal(left, rrb.Vertical(*plots), column_shares=[5, 3])
    panel = rrb.TimePanel(state="collapsed", timeline=timeline)
    return rrb.Blueprint(page, panel, *PANELS, auto_layout=False, auto_views=False)
