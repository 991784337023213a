"""The robot's bodies over time: tubes in 3D, and a side view to scale. Lengths shown in mm."""

from dataclasses import dataclass

import numpy as np
import rerun as rr

from catheter.gait import Gait
from catheter.lab.robot_run import Robot
from catheter.lab.views.clocks import TIMELINE
from catheter.lab.views.labels import BEST, FRAME, GRID, MARK, MEASURED, MODELS, TEXT, Colour
from catheter.posture import VALVE_M, Spiral, arc, spiral, swept
from data.signal import Array

MM = 1e3
POINTS, SIDES = 145, 10  # of a spiral's drawn line, and around every tube
BEFORE_M = 60e-3  # of cannula and tether, behind the robot's rearmost place
FREE, TOUCHES, HOLDS = (200, 196, 184), BEST, MODELS[1]
EXTENDER, BENDER, TWISTER, TIP = MEASURED, MODELS[0], MODELS[3], MARK
NAMES = {"act1": "Act 1", "act2": "Act 2", "act3": "Act 3", "twister": "end-effector"}
STRIPES = 4  # lines along the twister, which show its twist


@dataclass(frozen=True, eq=False)
class Placed:
    """One frame's parts by name: centre line (n, 3) [m] in the cannula, radius [m], colour, turn about the line."""

    line: Array
    radius: float
    colour: Colour
    turn: Array | float = 0.0


def placed(robot: Robot, frame: int) -> tuple[dict[str, Placed], dict[str, Spiral], float]:
    """Return the parts of one frame, its two spirals, and where the front spiral ends [m]."""
    gait, (rear, middle, front) = robot.gait, robot.segments
    back, ahead = (spiral(robot.task, one, v, POINTS) for one, v in zip((rear, front), gait.volume[frame, [0, 2]], strict=True))
    starts = float(gait.rear_m[frame]) - VALVE_M - back.reach_m, float(gait.front_m[frame]) + VALVE_M
    parts: dict[str, Placed] = {}
    for name, one, start, index in (("act1", back, starts[0], 0), ("act3", ahead, starts[1], 2)):
        parts[name] = Placed(one.line + [start, 0, 0], one.outer_m, _state(gait, frame, index))
    span = np.linspace(gait.rear_m[frame], gait.front_m[frame], 9)
    parts["act2"] = Placed(_straight(span), _extender_radius(robot, float(gait.volume[frame, 1])), EXTENDER)
    end = starts[1] + ahead.reach_m
    for number, at in enumerate((starts[0] - VALVE_M, float(gait.rear_m[frame]) - VALVE_M, float(gait.front_m[frame])), 1):
        flow = gait.flow_m3_s[:, number - 1]
        parts[f"valve{number}"] = Placed(_straight(np.array([at, at + VALVE_M])), 4.5e-3, _flows(flow, frame))
    if robot.bender is not None and robot.twister is not None:
        parts |= _end_effector(robot, frame, end)
    return parts, {"act1": back, "act3": ahead}, end


def _straight(x: Array) -> Array:
    return np.stack([x, 0 * x, 0 * x], axis=-1)


def _extender_radius(robot: Robot, volume_ratio: float) -> float:
    from catheter.free import inflate
    from catheter.robot import outer_radius

    middle = robot.segments[1]
    return float(outer_radius(robot.task, inflate(middle.alpha, middle.beta, volume_ratio)))


def _state(gait: Gait, frame: int, index: int) -> Colour:
    """Return a spiral's colour: it holds, it touches, it is free."""
    if gait.holds[frame, 0 if index == 0 else 1]:
        return HOLDS
    return TOUCHES if gait.volume[frame, index] >= gait.marks.contact else FREE


def _flows(flow: Array, frame: int) -> Colour:
    """Return a valve's colour: red while it fills what is ahead, pink while it empties it, grey at rest."""
    share = flow[frame] / np.abs(flow).max()
    return FRAME if abs(share) < 0.02 else MODELS[2] if share > 0 else MODELS[8]


def _end_effector(robot: Robot, frame: int, start: float) -> dict[str, Placed]:
    assert robot.bender is not None and robot.twister is not None
    bent, turned = robot.bender, robot.twister
    angle = float(bent.angle_rad[frame])
    first = arc(float(bent.length_m[frame]), angle) + [start, 0, 0]
    ahead = np.array([np.cos(angle), np.sin(angle), 0.0])
    share = np.linspace(0, 1, 17)
    second = first[-1] + float(turned.length_m[frame]) * share[:, None] * ahead
    tip = second[-1] + 8e-3 * np.linspace(0, 1, 5)[:, None] * ahead
    twist = float(turned.angle_rad[frame])
    return {
        "bender": Placed(first, bent.shape.outer_radius, BENDER),
        "twister": Placed(second, turned.shape.outer_radius, TWISTER, twist * share),
        "tip": Placed(tip, 4e-3, TIP, twist),
    }


def log_bodies(stream: rr.RecordingStream, robot: Robot, mouth_m: float, rear_m: float) -> None:
    """Write every frame's bodies in 3D below /world and from the side below /side."""
    _cannula(stream, robot, mouth_m, rear_m)
    for frame, time_s in enumerate(robot.gait.time_s):
        stream.set_time(TIMELINE, duration=np.timedelta64(round(float(time_s) * 1e9), "ns"))
        parts, spirals, end = placed(robot, frame)
        for name, part in parts.items():
            _tube(stream, f"/world/robot/{name}", part, indices=frame == 0)
        for name, one in spirals.items():
            fibre = MM * (one.limiter + [parts[name].line[0, 0], 0, 0])
            stream.log(f"/world/robot/{name}/fibre", rr.LineStrips3D([fibre], colors=MARK, radii=0.35))
        if "twister" in parts:
            _stripes(stream, parts["twister"])
        stream.log("/world/end", rr.Transform3D(translation=[MM * end, 0, 0]))
        tether = MM * np.array([[rear_m, 0, 0], [parts["valve1"].line[0, 0], 0, 0]])
        stream.log("/world/robot/tether", rr.LineStrips3D([tether], colors=FRAME, radii=2.0))
        _side(stream, parts, tether, MM * robot.task.diameter / 2 + 3)
    stream.reset_time()


def _tube(stream: rr.RecordingStream, path: str, part: Placed, *, indices: bool) -> None:
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


def _stripes(stream: rr.RecordingStream, twister: Placed) -> None:
    surface = MM * swept(twister.line, 1.02 * twister.radius, STRIPES, twister.turn)[:STRIPES]
    stream.log("/world/robot/stripes", rr.LineStrips3D(surface, colors=TEXT, radii=0.4))


def _cannula(stream: rr.RecordingStream, robot: Robot, mouth_m: float, rear_m: float) -> None:
    """Draw the cannula: rings every 50 mm and lines along it; from the side its two walls and a scale."""
    radius, x = MM * robot.task.diameter / 2, MM * np.array([rear_m, mouth_m])
    turn = np.linspace(0, 2 * np.pi, 49)
    circle = radius * np.stack([0 * turn, np.cos(turn), np.sin(turn)], axis=-1)
    rings = [circle + [at, 0, 0] for at in np.append(np.arange(np.ceil(x[0] / 50) * 50, x[1], 50), x[1])]
    walls = [np.array([[x[0], *circle[k, 1:]], [x[1], *circle[k, 1:]]]) for k in range(0, 48, 6)]
    stream.log("/world/cannula", rr.LineStrips3D([*rings, *walls], colors=[(105, 125, 150)], radii=0.25), static=True)
    sides = [np.array([[x[0], y], [x[1], y]]) for y in (-radius, radius)]
    stream.log("/side/cannula", rr.LineStrips2D(sides, colors=(105, 125, 150), radii=0.6), static=True)
    bar = np.array([[x[0], radius + 8], [x[0] + 100, radius + 8]])
    scale = rr.LineStrips2D([bar], colors=TEXT, radii=0.8, labels=["100 mm"], show_labels=True)
    stream.log("/side/scale", scale, static=True)


def _side(stream: rr.RecordingStream, parts: dict[str, Placed], tether: Array, below: float) -> None:
    strips = [tether[:, :2] * [1, -1], *(MM * part.line[:, :2] * [1, -1] for part in parts.values())]
    colours = [GRID, *(part.colour for part in parts.values())]
    radii = [2.0, *(MM * part.radius for part in parts.values())]
    stream.log("/side/robot", rr.LineStrips2D(strips, colors=colours, radii=radii))
    named = [(name, MM * part.line[:, 0].mean()) for name, part in parts.items() if name in NAMES]
    places = [(x, below) for _, x in named]
    labels = [NAMES[name] for name, _ in named]
    stream.log("/side/names", rr.Points2D(places, labels=labels, show_labels=True, radii=1e-9, colors=TEXT))
