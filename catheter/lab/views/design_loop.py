"""The dashboard of a design loop: tube, cameras, curves and notes on one cursor, film beside model."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from catheter.lab.loop_files import error_picture
from catheter.lab.views.cameras import log_camera
from catheter.lab.views.clocks import TIMELINE, Clocks
from catheter.lab.views.labels import BEST, FRAME, MEASURED, MODELS, Colour, literal, view_name
from catheter.lab.views.layout import Pages
from catheter.lab.views.loops import Axis, Sheet
from catheter.lab.views.output import Output
from catheter.lab.views.plots import Line, plot
from data.recording import SIMULATED, Recording
from data.signal import Array
from fem.grid import skin

if TYPE_CHECKING:
    from catheter.design_loop import DesignLoop

DEG, MM, KPA = float(np.degrees(1.0)), 1e3, 1e-3
TABLE: Colour = MODELS[1]
AGAIN: Colour = MODELS[0]
SOFT, STIFF, CAP = (225, 215, 200), (60, 64, 80), (150, 170, 190)
POSES_HZ = 5.0
WIDTH, NAMES, LINE = 1.2, 1.0, 0.08  # of the drawing of Fig. 6.22, the names beside it, a line of text; in its heights


def save_loop(loop: "DesignLoop", title: str, path: Path) -> None:
    """Write the dashboard of a design loop to `path`, an .rrd file that is replaced. Raises CannotWrite."""
    clocks = Clocks()
    kind = loop.first.film.kind
    plots = _plots(loop, clocks)
    with Output("loop", path) as output, Recording(loop.first.film.path) as recording:
        clocks.send(output, lambda: None)
        body = _tube(output, loop)
        left_out: list[str] = []
        cameras = [
            log_camera(output, recording, f"/camera/{camera}", left_out, lambda: None, shift_s=shift)
            for camera in ("top", "side")
            for shift in (loop.first.film.clock(camera).offset_s,)
        ]
        curves, errors = _curves(output.stream, loop), _errors(output.stream, loop)
        notes = rr.TextDocument(_notes(loop, title, left_out), media_type=rr.MediaType.MARKDOWN)
        output.stream.log("/notes", notes, static=True)
        text = rrb.TextDocumentView(name=view_name("loop", "", kind), origin="/notes")
        pictures = rrb.Horizontal(body, *[view for view in cameras if view], column_shares=[5, 4, 4])
        right = rrb.Vertical(pictures, rrb.Horizontal(curves, text, column_shares=[5, 4]), errors, row_shares=[3, 4, 3])
        left = rrb.Vertical(*plots, row_shares=[0.8, 1.6, 0.9, 1.0, 1.5])
        page = rrb.Horizontal(left, right, column_shares=[3, 5], name=view_name("loop", "", kind))
        output.stream.send_recording_name(f"{title} ({kind})")
        output.stream.send_blueprint(
            rrb.Blueprint(
                Pages(page, duration_s=recording.duration_s),
                rrb.TimePanel(state="collapsed", timeline=TIMELINE),
                rrb.BlueprintPanel(state="collapsed"),
                rrb.SelectionPanel(state="collapsed"),
                auto_layout=False,
                auto_views=False,
            )
        )


def _plots(loop: "DesignLoop", clocks: Clocks) -> list[rrb.TimeSeriesView]:
    """Return the plots against time: pressure, twist, extension, and what the model leaves of the twist."""
    film, kind = loop.first.film, loop.first.film.kind
    load, seen = film.pressure, film.twist.time_s
    here = load.at(seen)

    def line(name: str, time_s: Array, values: Array, colour: Colour, width: float = 1.5) -> Line:
        return Line(clocks.add("Loop", f"{name} {len(clocks)} {width}", time_s, values), name, colour, width)

    band, table, found = DEG * loop.noise(here), loop.twin, loop.calibrated
    reach = film.extension.time_s
    twists = [  # on one clock, so that the thin lines are drawn over the thick one
        line(f"film ({kind})", seen, DEG * film.twist.value, MEASURED, 3.5),
        line(f"table's materials ({SIMULATED})", seen, DEG * table.response.at(here), TABLE),
        line(f"calibrated ({SIMULATED})", seen, DEG * found.response.at(here), BEST),
    ]
    extensions = [
        line(f"film ({kind})", reach, MM * film.extension.value, MEASURED, 3.5),
        line(f"calibrated ({SIMULATED})", reach, MM * found.response.at(load.at(reach), "extension"), BEST),
    ]
    left = [
        line("95 % by the noises, from", seen, -band, FRAME, 0.8),
        line("to", seen, band, FRAME, 0.8),
        line("calibrated minus film", seen, DEG * found.residual, BEST, 1.2),
    ]
    wrong = line("table's materials minus film", seen, DEG * table.residual, TABLE)
    before, after = (f"minus film, rms {DEG * one.rmse:.3g}" for one in (table, found))
    return [
        plot(view_name("pressure", "kPa", kind), [line("pressure", load.time_s, KPA * load.value, MEASURED)]),
        plot(view_name("twist", "deg", kind), twists, corner="LeftBottom"),
        plot(view_name("extension", "mm", kind), extensions),
        plot(view_name(f"twist by table's materials {before}", "deg", kind), [wrong]),
        plot(view_name(f"twist by calibrated model {after}", "deg", kind), left, corner="LeftBottom"),
    ]


def _tube(output: Output, loop: "DesignLoop") -> rrb.Spatial3DView:
    """Write the tube as the calibrated model has it under the recorded pressure [mm], and a hand for its tip's twist.

    Another hand above it is the film's twist.
    """
    stream, film, response = output.stream, loop.first.film, loop.calibrated.response
    mesh = response.mesh
    rest = mesh.nodes
    quads, part = skin(mesh)
    outside = np.hypot(*rest[quads].mean(axis=1)[:, :2].T) > loop.first.shape.outer_radius - loop.first.shape.wall
    quads, part = quads[outside], part[outside]
    stiff = np.append(loop.first.stiff.ravel().astype(int), 2)[part]  # part -1: the cap
    colours = np.repeat(np.array([SOFT, STIFF, CAP], dtype=np.uint8)[stiff], 4, axis=0)
    first = 4 * np.arange(len(quads))[:, None]
    triangles = (first + np.array([[0, 1, 2, 0, 2, 3]])).reshape(-1, 3).astype(np.uint32)
    stream.log("/body/tube", rr.Mesh3D.from_fields(triangle_indices=triangles, vertex_colors=colours), static=True)
    moments = np.arange(0.0, film.pressure.time_s[-1], 1 / POSES_HZ)
    moments = moments[np.isfinite(film.pressure.at(moments))]
    load = film.pressure.at(moments)
    shapes = MM * response.shape(load)
    for moment, x, pair in zip(moments.tolist(), shapes, _angles(loop, moments, load), strict=True):
        stream.set_time(TIMELINE, duration=np.timedelta64(round(moment * 1e9), "ns"))
        corners = x[quads]
        across = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        normal = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30)
        pose = rr.Mesh3D.from_fields(
            vertex_positions=corners.reshape(-1, 3).astype(np.float32),
            vertex_normals=np.repeat(normal, 4, axis=0).astype(np.float32),
        )
        stream.log("/body/tube", pose)
        stream.log("/body/tip", _arrows(x, pair, MM * loop.first.shape.outer_radius))
        output.settle(corners.nbytes)
    stream.reset_time()
    middle = MM * np.array([0.0, 0.0, loop.first.shape.length / 2])
    reach = MM * loop.first.shape.length
    eye = rrb.EyeControls3D(
        position=middle + reach * np.array([0.8, -0.8, 0.65]), look_target=middle, eye_up=(0.0, 0.0, 1.0)
    )
    name = view_name("tube, film's twist blue", "", SIMULATED)
    return rrb.Spatial3DView(name=name, origin="/body", eye_controls=eye)


def _angles(loop: "DesignLoop", moments: Array, load: Array) -> Array:
    """Return twists (m, 2) [rad]: the film's, the model's."""
    film = loop.first.film.twist
    return np.stack([np.interp(moments, film.time_s, film.value), loop.calibrated.response.at(load)], axis=1)


def _arrows(x: Array, angles: Array, radius: float) -> rr.Arrows3D:
    """Return hands above the tip at the angles of film and model."""
    top = float(x[:, 2].max()) + 1.0
    hands = 1.7 * radius * np.stack([np.cos(angles), np.sin(angles), np.zeros(2)], axis=1)
    origins = np.array([[0.0, 0.0, top], [0.0, 0.0, top + 0.8]])
    return rr.Arrows3D(vectors=hands, origins=origins, colors=[MEASURED, BEST], radii=0.3)


class _Figure(Sheet):
    """The drawing of thesis Fig. 6.22."""

    def model(self, name: str, pressure: Array, twist: Array, colour: Colour, width: float) -> None:
        """Draw a line."""
        self._lines(name, [self.points(pressure, twist)], [colour], width)

    def film(self, name: str, pressure: Array, twist: Array, colour: Colour) -> None:
        """Draw points."""
        dots = rr.Points2D(self.points(pressure, twist), colors=colour, radii=rr.Radius.ui_points(2.6), draw_order=-1)
        self.stream.log(f"{self.path}/{name}", dots, static=True)

    def bounds(self) -> rrb.VisualBounds2D:
        """Return what the view shows: the drawing and the names beside it."""
        y_range = (-1.07 - self.line, 0.06 + 2 * self.line)
        return rrb.VisualBounds2D(x_range=(-0.22, self.x.length + NAMES), y_range=y_range)

    def legend(self, entries: list[tuple[str, Colour]]) -> None:
        """Write the lines' names beside the drawing."""
        places = [(self.x.length + NAMES / 2 - 0.02, -0.9 + 1.5 * self.line * k) for k in range(len(entries))]
        self._texts("legend", places, [name for name, _ in entries], [colour for _, colour in entries])


def _curves(stream: rr.RecordingStream, loop: "DesignLoop") -> rrb.Spatial2DView:
    """Write the curves of thesis Fig. 6.22, with a point that follows the cursor."""
    curves = loop.curves
    middle = loop.calibrated.response
    around = loop.scatter(middle.pressure)
    lowest = min(float(one.twist.min()) for one in curves)
    low = DEG * min(lowest, float((middle.values["twist"] - around).min()))
    high = DEG * max(0.0, *(float(one.twist.max()) for one in curves))
    most = KPA * max(float(one.pressure.max()) for one in curves)
    x = Axis("pressure", "kPa", KPA, -0.03 * most, 1.03 * most, WIDTH)
    y = Axis("twist", "deg", DEG, 1.03 * low, high - 0.03 * low, 1.0)
    sheet = _Figure(stream, "/twist_over_pressure", x, y, LINE)
    sheet.axes()
    for side in (-1, 1):
        sheet.model(f"specimens{side}", middle.pressure, middle.values["twist"] + side * around, FRAME, 0.7)
    colours = {"drawn": TABLE, "design": BEST, "redesign": AGAIN}
    films = {"design": MEASURED, "redesign": (235, 235, 120)}
    legend: list[tuple[str, Colour]] = [("95 % of specimens (assumed)", FRAME)]
    for number, one in enumerate(curves):
        colour = films[one.map] if one.film else colours[one.map]
        if one.film:
            sheet.film(f"curve{number}", one.pressure, one.twist, colour)
        else:  # the redesign's is drawn on the design's, which it hardly leaves
            width = 1.8 if one.map == "design" else 0.8
            sheet.model(f"curve{number}", one.pressure, one.twist, colour, width)
        legend.append((one.name, colour))
    sheet.legend(legend)
    film = loop.first.film
    load, known = film.pressure.at(film.twist.time_s), np.isfinite(film.twist.value)
    sheet.mark(film.twist.time_s[known], sheet.points(load[known], film.twist.value[known]))
    return rrb.Spatial2DView(
        name=view_name("twist over pressure, thesis Fig. 6.22", "", film.kind),
        origin=sheet.path,
        visual_bounds=sheet.bounds(),
    )


def _errors(stream: rr.RecordingStream, loop: "DesignLoop") -> rrb.Spatial2DView:
    """Write the picture of the error maps (thesis Fig. 6.18)."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "errors.png"
        error_picture(loop, path)
        picture = rr.EncodedImage(contents=path.read_bytes(), media_type="image/png")
    stream.log("/errors", picture, static=True)
    name = view_name("redesign minus design in every voxel, thesis Fig. 6.18", "", SIMULATED)
    return rrb.Spatial2DView(name=name, origin="/errors", background=(255, 255, 255))


def _notes(loop: "DesignLoop", title: str, left_out: list[str]) -> str:
    """Return clocks, materials and redesign in markdown; its first word says where the data are from."""
    film, made, found = loop.first.film, loop.redesign, loop.calibration
    lines = [f"**{film.kind.upper()}: {literal(title)}.** Models: simulated, finite elements at rest.", ""]
    for camera in ("top", "side"):
        one = film.clock(camera)
        interval = f"{1e3 * one.low_s:.2f} to {1e3 * one.high_s:.2f}"
        lines.append(f"- camera {camera}: clock {1e3 * one.offset_s:+.2f} ms (95 %: {interval})")
    names, truth = (loop.first.pattern.soft, loop.first.pattern.stiff), loop.first.truth
    for k, name in enumerate(names):
        low, high = found.interval[k] / 1e6
        known = "" if truth is None else f", simulated {truth[k] / 1e6:.4f}"
        lines.append(
            f"- {literal(name)}: c1 {found.moduli[k] / 1e6:.4f} MPa (95 %: {low:.4f} to {high:.4f}); "
            f"table {loop.first.levels[k] / 1e6:.4f}{known}"
        )
    lines.append(f"- designed: {DEG * made.twist(made.case.whole[0]):.2f} deg at {KPA * loop.closing.pressure:.2f} kPa")
    for what, at, printed in made.rows:
        off = MM * made.errors(printed)
        rms = float(np.sqrt((off**2).mean()))
        lines.append(f"- {what}, {KPA * at:.2f} kPa: off by {rms:.3f} mm rms, {off.max():.3f} at most")
    if loop.again:
        again = loop.again.film.kind
        lines.append(f"- printed again ({again}): {DEG * loop.reached:.2f} deg at {KPA * made.pressure_pa:.2f} kPa")
    lines += [f"- left out: {literal(reason)}" for reason in left_out]
    return "\n".join(lines) + "\n"
