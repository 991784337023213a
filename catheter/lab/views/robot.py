"""The dashboard of a walking robot: 3D in its cannula, side view, plots beside published values, notes."""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from catheter.gait import advanced, phases
from catheter.lab.robot_run import EVENTS_S, MEASURED_MM, SPREAD_MM, STROKE_MM, Robot, notes
from catheter.lab.views.bodies import BEFORE_M, MM, framed, log_bodies
from catheter.lab.views.clocks import TIMELINE, Clocks
from catheter.lab.views.designs import PANELS
from catheter.lab.views.labels import BEST, FRAME, MEASURED, MODELS, Colour, literal, view_name
from catheter.lab.views.layout import Pages
from catheter.lab.views.output import Output
from catheter.lab.views.plots import Line, plot
from data.recording import SIMULATED
from data.signal import Array

ACTS: tuple[Colour, ...] = (MODELS[2], MEASURED, MODELS[1])
PUBLISHED: Colour = BEST
ROOM = 0.16  # of a plot's values, above them, for each line of its legend
Point = tuple[float, float, float]
Plots = tuple[list[rrb.TimeSeriesView], list[rrb.TimeSeriesView]]
Groups = dict[str, list[tuple[str, Array, Colour]]]


def save_robot(robot: Robot, path: Path) -> None:
    """Write the dashboard to `path`, replaced. Raises CannotWrite."""
    frames = [framed(robot, number) for number in range(len(robot.gait.time_s))]
    ends = np.array([frame.end_m for frame in frames])
    works = np.any([one.pressure_pa > 0 for one in robot.ends.values()], axis=0)
    mouth_m = float(ends[works].min()) if robot.ends else float(ends.max()) + BEFORE_M
    span_m = min(frame.tether_m for frame in frames) - BEFORE_M, mouth_m
    clocks = Clocks()
    plots = _plots(robot, clocks)
    with Output("robot", path) as output:
        stream = output.stream
        clocks.send(output, lambda: None)
        log_bodies(stream, robot, frames, span_m)
        stream.log("/text", rr.TextDocument(_text(robot), media_type=rr.MediaType.MARKDOWN), static=True)
        stream.send_recording_name(f"{SIMULATED}: {robot.title}")
        stream.send_blueprint(_blueprint(robot, plots, (*span_m, float(ends.max()))))


def moment_of_interest(robot: Robot) -> float:
    """Return when to look, for a picture [s]: when the bender bends most, or the front spiral is fullest, at last."""
    if robot.ends:
        return float(robot.gait.time_s[int(np.argmax(robot.ends["bender"].pressure_pa))])
    volume = robot.gait.volume[:, 2]
    return float(robot.gait.time_s[np.flatnonzero(volume == volume.max())[-1]])


def _plots(robot: Robot, clocks: Clocks) -> Plots:
    """Return the plots of the first page and those of the second."""
    gait = robot.gait
    most = 1e6 * np.abs(gait.flow_m3_s).max(axis=0)
    times = np.array(list(EVENTS_S.values()))
    flat = np.ones_like(gait.time_s)
    first: Groups = {
        "volume [of rest]": [
            ("holds", gait.marks.anchored * flat, FRAME),
            ("touches", gait.marks.contact * flat, FRAME),
            *((f"Act {k + 1}", gait.volume[:, k], ACTS[k]) for k in range(3)),
        ],
        "valve flow [% of its largest]": [
            (f"valve {k + 1}, {most[k]:.3g} mL/s", 1e8 * gait.flow_m3_s[:, k] / most[k], ACTS[k]) for k in range(3)
        ],
        "front's advance [mm]": [
            (f"measured {MEASURED_MM:g} +- {SPREAD_MM:g} a cycle", MM * advanced(gait, times, MEASURED_MM / MM), FRAME),
            (f"predicted {STROKE_MM:g} a cycle", MM * advanced(gait, times, STROKE_MM / MM), PUBLISHED),
            ("simulated", MM * (gait.front_m - gait.front_m[0]), MEASURED),
        ],
    }
    second: Groups = {
        "pressure [kPa]": [
            ("source", gait.source_pa / 1e3, FRAME),
            *((f"Act {k + 1}", gait.pressure_pa[:, k] / 1e3, ACTS[k]) for k in range(3)),
        ],
        "extender pushes +1, pulls -1": [
            ("published (Fig 3.13)", phases(gait, times), PUBLISHED),
            ("simulated", phases(gait, np.array(list(vars(gait.happened).values()))), MEASURED),
        ],
        "length of Act 2 [mm]": [("extender", MM * (gait.front_m - gait.rear_m), ACTS[1])],
    }
    if robot.ends:
        ends = [(name, robot.ends[name], colour) for name, colour in (("bender", MODELS[0]), ("twister", MODELS[3]))]
        first["end-effector [deg]"] = [(name, np.degrees(one.angle_rad), colour) for name, one, colour in ends]
        second["end-effector [kPa]"] = [(name, one.pressure_pa / 1e3, colour) for name, one, colour in ends]
    return [_plotted(title, lines, gait.time_s, clocks) for title, lines in first.items()], [
        _plotted(title, lines, gait.time_s, clocks) for title, lines in second.items()
    ]


def _plotted(title: str, lines: list[tuple[str, Array, Colour]], time_s: Array, clocks: Clocks) -> rrb.TimeSeriesView:
    """Return a plot with room above its lines for its legend."""
    values = np.concatenate([values for _, values, _ in lines])
    low, high = float(values.min()), float(values.max())
    span = (low - 0.05 * (high - low), high + (0.05 + ROOM * (len(lines) if len(lines) > 1 else 0)) * (high - low))
    group = title.replace(" ", "_")
    drawn = [Line(clocks.add(group, name, time_s, column), name, colour, exact=True) for name, column, colour in lines]
    return plot(view_name(title, "", SIMULATED), drawn, span)


def _text(robot: Robot) -> str:
    gait = robot.gait
    rows = [
        (name, f"{1e3 * found:.1f}", f"{1e3 * known:.0f}", "ms")
        for (name, known), found in zip(EVENTS_S.items(), vars(gait.happened).values(), strict=True)
    ]
    published = f"{STROKE_MM:g}, measured {MEASURED_MM:g} +- {SPREAD_MM:g}"
    rows.append(("push B-C", f"{MM * gait.made.stroke_m:.1f}", published, "mm"))
    rows.append(("pull E-F", f"{MM * gait.made.pull_m:.1f}", "-", "mm"))
    lines = ["| | simulated | published | |", "|---|---:|---:|---|", *(f"| {' | '.join(row)} |" for row in rows), ""]
    colours = "Spirals: green holds, orange touches. Valves: red fill, pink empty. Red line: third fibre."
    return "\n".join([*lines, *(f"- {literal(one, 600)}" for one in (colours, *notes(robot)))])


def _blueprint(robot: Robot, plots: Plots, span: tuple[float, float, float]) -> rrb.Blueprint:
    """Return the page. span: where the drawn cannula begins and ends, and the front spiral's foremost end [m]."""
    rear, mouth, end = (MM * x for x in span)
    half = MM * robot.task.diameter / 2
    ahead = 90.0 if robot.ends else 0.0
    bounds = rrb.VisualBounds2D(x_range=(rear - 5, max(mouth, end + ahead) + 5), y_range=(-half - 4, half + 16))
    side = rrb.Spatial2DView(
        name=view_name("robot in its cannula from the side, to scale", "", SIMULATED),
        origin="/side",
        visual_bounds=bounds,
    )
    eye, target = (end + 95, -62, 44), (end - 60, 3, -8)
    if not robot.ends:
        eye, target = (end + 20, -105, 55), (end - 160, 20, -15)
    views: list[rrb.View] = [_solid("robot in its cannula", "/world", eye, target)]
    if robot.ends:
        views.append(_solid("end-effector", "/world/end", (70, -20, 95), (32, 5, 0), (0.0, 1.0, 0.0)))
    text = rrb.TextDocumentView(name=view_name(robot.title, "", SIMULATED), origin="/text")
    page = rrb.Vertical(
        side,
        rrb.Horizontal(*views, text, column_shares=[*[1.0] * len(views), 1.15]),
        rrb.Horizontal(*plots[0]),
        row_shares=[1.05, 4.0, 3.2],
        name=view_name("robot", "", SIMULATED),
    )
    further = rrb.Grid(*plots[1], grid_columns=2, name=view_name("pressures and phases", "", SIMULATED))
    return rrb.Blueprint(
        Pages(page, further, duration_s=float(robot.gait.time_s[-1])),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        *PANELS,
        auto_layout=False,
        auto_views=False,
    )


def _solid(title: str, origin: str, eye: Point, target: Point, up: Point = (0.0, 0.0, 1.0)) -> rrb.Spatial3DView:
    """Return a 3D view of everything, which moves with `origin`; eye and target in mm from there."""
    look = rrb.EyeControls3D(position=eye, look_target=target, eye_up=up)
    name = view_name(title, "", SIMULATED)
    return rrb.Spatial3DView(name=name, origin=origin, contents="/world/**", eye_controls=look, line_grid=False)
