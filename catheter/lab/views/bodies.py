"""The robot's bodies over time: tubes in 3D, and a side view to scale. Lengths shown in mm."""

from dataclasses import dataclass

import numpy as np
import rerun as rr

from catheter.free import inflate
from catheter.gait import Gait
from catheter.lab.robot_run import Robot
from catheter.lab.views.clocks import TIMELINE
from catheter.lab.views.labels import BEST, FRAME, GRID, MARK, MEASURED, MODELS, TEXT, Colour
from catheter.posture import VALVE_M, arc, spiral, swept
from catheter.robot import outer_radius
from data.signal import Array

MM = 1e3
POINTS, SIDES = 145, 10  # of a spiral's drawn line, and around every tube
BEFORE_M = 60e-3  # of cannula and tether, behind the robot's rearmost place
FREE, TOUCHES, HOLDS = (200, 196, 184), BEST, MODELS[1]
CANNULA: Colour = (105, 125, 150)
EXTENDER, BENDER, TWISTER, TIP = MEASURED, MODELS[0], MODELS[3], MARK
NAMES = {"act1": "Act 1", "act2": "Act 2", "act3": "Act 3", "twister": "end-effector"}
VALVE_RADIUS_M, TIP_M = 4.5e-3, 8e-3  # as drawn
STRIPES = 4  # lines along the twister, which show its twist


@dataclass(frozen=True, eq=False)
class Part:
    """One body: centre line (n, 3) [m] in the cannula, radius [m], colour, how far its rings are turned [rad]."""

    line: Array
    radius: float
    colour: Colour
    turn: Array | float = 0.0


@dataclass(frozen=True, eq=False)
class Frame:
    """One instant: bodies by name, each spiral's third fibre (n, 3), where tether and front spiral end on x [m]."""

    time_s: float
    parts: dict[str, Part]
    fibres: dict[str, Array]
    tether_m: float
    end_m: float


def framed(robot: Robot, number: int) -> Frame:
    """Return one of a gait's frames."""
    gait, task, (rear, _, front) = robot.gait, robot.task, robot.segments
    volume, flow = gait.volume[number], gait.flow_m3_s[number] / np.abs(gait.flow_m3_s).max(axis=0)
    back, ahead = spiral(task, rear, float(volume[0]), POINTS), spiral(task, front, float(volume[2]), POINTS)
    between = float(gait.rear_m[number]), float(gait.front_m[number])
    first, last = between[0] - VALVE_M - back.reach_m, between[1] + VALVE_M
    end = last + ahead.reach_m
    parts = {
        "act1": Part(_moved(back.line, first), back.outer_m, _state(gait, number, 0)),
        "act2": Part(_straight(*between, 9), _extender_radius(robot, float(volume[1])), EXTENDER),
        "act3": Part(_moved(ahead.line, last), ahead.outer_m, _state(gait, number, 1)),
    }
    for valve, at in enumerate((first - VALVE_M, between[0] - VALVE_M, between[1])):
        parts[f"valve{valve + 1}"] = Part(_straight(at, at + VALVE_M), VALVE_RADIUS_M, _flows(float(flow[valve])))
    if robot.ends:
        parts |= _end_effector(robot, number, end)
    fibres = {"act1": _moved(back.limiter, first), "act3": _moved(ahead.limiter, last)}
    return Frame(float(gait.time_s[number]), parts, fibres, first - VALVE_M, end)


def _moved(line: Array, x: float) -> Array:
    return np.asarray(line + np.array([x, 0.0, 0.0]))


def _straight(first: float, last: float, points: int = 2) -> Array:
    x = np.linspace(first, last, points)
    return np.stack([x, 0 * x, 0 * x], axis=-1)


def _extender_radius(robot: Robot, volume_ratio: float) -> float:
    middle = robot.segments[1]
    return float(outer_radius(robot.task, inflate(middle.alpha, middle.beta, volume_ratio)))


def _state(gait: Gait, number: int, spiral_number: int) -> Colour:
    """Return a spiral's colour: it holds, it touches, it is free."""
    if gait.holds[number, spiral_number]:
        return HOLDS
    return TOUCHES if gait.volume[number, (0, 2)[spiral_number]] >= gait.marks.contact else FREE


def _flows(share: float) -> Colour:
    """Return a valve's colour: red while it fills what is ahead, pink while it empties it, grey at rest."""
    return FRAME if abs(share) < 0.02 else MODELS[2] if share > 0 else MODELS[8]


def _end_effector(robot: Robot, number: int, start: float) -> dict[str, Part]:
    bent, turned = robot.ends["bender"], robot.ends["twister"]
    angle, twist = float(bent.angle_rad[number]), float(turned.angle_rad[number])
    first = _moved(arc(float(bent.length_m[number]), angle), start)
    ahead = np.array([np.cos(angle), np.sin(angle), 0.0])
    share = np.linspace(0, 1, 17)
    second = first[-1] + float(turned.length_m[number]) * share[:, None] * ahead
    tip = second[-1] + TIP_M * np.linspace(0, 1, 5)[:, None] * ahead
    return {
        "bender": Part(first, bent.end.shape.outer_radius, BENDER),
        "twister": Part(second, turned.end.shape.outer_radius, TWISTER, twist * share),
        "tip": Part(tip, VALVE_RADIUS_M, TIP, twist),
    }


def log_bodies(stream: rr.RecordingStream, robot: Robot, frames: list[Frame], span_m: tuple[float, float]) -> None:
    """Write every frame's bodies in 3D below /world and from the side below /side. span_m: of the cannula on x."""
    _cannula(stream, robot, span_m)
    for frame in frames:
        stream.set_time(TIMELINE, duration=np.timedelta64(round(frame.time_s * 1e9), "ns"))
        for name, part in frame.parts.items():
            _tube(stream, f"/world/robot/{name}", part, indices=frame is frames[0])
        for name, fibre in frame.fibres.items():
            stream.log(f"/world/robot/{name}/fibre", rr.LineStrips3D([MM * fibre], colors=MARK, radii=0.35))
        if "twister" in frame.parts:
            _stripes(stream, frame.parts["twister"])
        stream.log("/world/end", rr.Transform3D(translation=[MM * frame.end_m, 0, 0]))
        tether = MM * _straight(span_m[0], frame.tether_m)
        stream.log("/world/robot/tether", rr.LineStrips3D([tether], colors=FRAME, radii=2.0))
        _side(stream, frame.parts, tether, MM * robot.task.diameter / 2 + 3)
    stream.reset_time()


def _tube(stream: rr.RecordingStream, path: str, part: Part, *, indices: bool) -> None:
    points = MM * swept(part.line, part.radius, SIDES, part.turn)
    if indices:
        rows, columns = points.shape[:2]
        i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns - 1), indexing="ij")
        a, b = i * columns + j, (i + 1) * columns + j
        faces = np.stack([a, b, b + 1, a, b + 1, a + 1], axis=-1).reshape(-1, 3).astype(np.uint32)
        stream.log(path, rr.Mesh3D.from_fields(triangle_indices=faces), static=True)
    normal = points - MM * part.line
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    moved = rr.Mesh3D.from_fields(
        vertex_positions=points.reshape(-1, 3).astype(np.float32),
        vertex_normals=normal.reshape(-1, 3).astype(np.float32),
        albedo_factor=part.colour,
    )
    stream.log(path, moved)


def _stripes(stream: rr.RecordingStream, twister: Part) -> None:
    surface = MM * swept(twister.line, 1.02 * twister.radius, STRIPES, twister.turn)[:STRIPES]
    stream.log("/world/robot/stripes", rr.LineStrips3D(list(surface), colors=TEXT, radii=0.4))


def _cannula(stream: rr.RecordingStream, robot: Robot, span_m: tuple[float, float]) -> None:
    """Draw the cannula: rings every 50 mm and lines along it; from the side its two walls and a scale."""
    radius, x = MM * robot.task.diameter / 2, MM * np.array(span_m)
    turn = np.linspace(0, 2 * np.pi, 49)
    circle = radius * np.stack([0 * turn, np.cos(turn), np.sin(turn)], axis=-1)
    rings = [_moved(circle, at) for at in np.append(np.arange(np.ceil(x[0] / 50) * 50, x[1], 50), x[1])]
    walls = [np.array([[x[0], *circle[k, 1:]], [x[1], *circle[k, 1:]]]) for k in range(0, 48, 6)]
    stream.log("/world/cannula", rr.LineStrips3D([*rings, *walls], colors=[CANNULA], radii=0.25), static=True)
    sides = [np.array([[x[0], y], [x[1], y]]) for y in (-radius, radius)]
    stream.log("/side/cannula", rr.LineStrips2D(sides, colors=CANNULA, radii=0.6), static=True)
    bar = np.array([[x[0], radius + 8], [x[0] + 100, radius + 8]])
    scale = rr.LineStrips2D([bar], colors=TEXT, radii=0.8, labels=["100 mm"], show_labels=True)
    stream.log("/side/scale", scale, static=True)


def _side(stream: rr.RecordingStream, parts: dict[str, Part], tether: Array, below: float) -> None:
    strips = [tether[:, :2] * [1, -1], *(MM * part.line[:, :2] * [1, -1] for part in parts.values())]
    colours = [GRID, *(part.colour for part in parts.values())]
    radii = [2.0, *(MM * part.radius for part in parts.values())]
    stream.log("/side/robot", rr.LineStrips2D(strips, colors=colours, radii=radii))
    named = [(name, MM * part.line[:, 0].mean()) for name, part in parts.items() if name in NAMES]
    places = [(x, below) for _, x in named]
    labels = [NAMES[name] for name, _ in named]
    stream.log("/side/names", rr.Points2D(places, labels=labels, show_labels=True, radii=1e-9, colors=TEXT))
