"""Dashboards of a design: a FREE with its fibres inflating, the cost over all angles, the map of the valves."""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from catheter.free import Array, inflate
from catheter.helix import Design, HelixState
from catheter.lab.views.layout import eye_on
from catheter.lab.views.output import write
from catheter.search import cost_field, half_steps
from catheter.task import DEGREE, Task
from catheter.valve import INCH, Cones, cone, measured

VOLUMES = 40
RINGS, SIDES = 241, 20  # of the tube's mesh
MOST_POINTS = 3000  # of one fibre: a steep one winds hundreds of times
TIMELINE = "volume_ratio_1000"  # a sequence: 1000 times V
PANELS = (rrb.BlueprintPanel(state="collapsed"), rrb.SelectionPanel(state="collapsed"))
COLOURS = {"alpha": (230, 120, 40), "beta": (60, 130, 220), "gamma": (210, 40, 60)}


def save_free(task: Task, spiral: Design, path: Path) -> None:
    """Write the dashboard of a spiral to `path`, replaced: it inflates from rest to the task's volume ratio.

    Beside it the cost of every grid cell, log10, on a grid of 2 deg or the task's if that is coarser.
    Raises CannotWrite for a place that cannot be written.
    """

    def log(stream: rr.RecordingStream) -> None:
        for volume in np.linspace(1.0, task.volume_ratio, VOLUMES + 1)[1:]:
            _log_tube(stream, task, spiral, float(volume))
        coarse = Task(**vars(task) | {"step": max(task.step, 2 * DEGREE)})
        cost = np.log10(cost_field(coarse)[1]).astype(np.float32)
        tensor = rr.Tensor(cost, dim_names=("alpha", "beta", "gamma"), value_range=(np.nanmin(cost), np.nanmax(cost)))
        stream.log("/cost", tensor, static=True)
        corners = np.array([(0.0, -1, -1), (np.sign(spiral.pitch_m) * spiral.length_ratio * task.length, 1, 1)])
        corners[:, 1:] *= 2 * spiral.radius_m
        eye = eye_on(corners, (0.7, -0.8, 0.4))
        views = [
            rrb.Spatial3DView(
                name="simulated spiral over volume ratio", origin="/spiral", eye_controls=eye, line_grid=False
            ),
            rrb.TensorView(
                name="log10 cost over alpha, beta, gamma, simulated",
                origin="/cost",
                slice_selection=rrb.TensorSliceSelection(
                    width=1,
                    height=0,
                    indices=[rr.TensorDimensionIndexSelection(dimension=2, index=_nearest(coarse, spiral.gamma_rad))],
                    slider=[2],
                ),
            ),
        ]
        time = rrb.TimePanel(timeline=TIMELINE, state="collapsed")
        stream.send_blueprint(rrb.Blueprint(rrb.Horizontal(*views), *PANELS, time))

    write("free", path, log)


def save_valves(path: Path) -> None:
    """Write the map of Prev/Pfwd - 1 over cone angle and thickness to `path`, replaced. Raises CannotWrite."""

    def log(stream: rr.RecordingStream) -> None:
        known = measured()
        angle = np.linspace(known.angle_rad[-1], known.angle_rad[0], 201)  # the steepest on top
        thick = np.linspace(known.thickness_m[0], known.thickness_m[-1], 201)
        ratio = cone(angle[:, None], thick).ratio.astype(np.float32)
        degrees, inches = np.degrees(known.angle_rad), known.thickness_m / INCH
        names = (
            f"cone angle, {degrees[-1]:.0f} to {degrees[0]:.0f} deg",
            f"thickness, {inches[0]:.3f} to {inches[-1]:.3f} in",
        )
        stream.log("/ratio", rr.Tensor(ratio, dim_names=names, value_range=(0.0, float(ratio.max()))), static=True)
        view = rrb.TensorView(name="Prev / Pfwd - 1, measured cones and between", origin="/ratio")
        stream.log("/table", rr.TextDocument(_cones(known), media_type=rr.MediaType.MARKDOWN), static=True)
        text = rrb.TextDocumentView(name="measured cracking pressures, thesis Table 3.5", origin="/table")
        page = rrb.Horizontal(view, text)
        stream.send_blueprint(rrb.Blueprint(page, *PANELS, rrb.TimePanel(state="hidden")))

    write("valves", path, log)


def _cones(known: Cones) -> str:
    """Return the measured cones in markdown."""
    lines = [
        "kPa forward / reverse (ratio)",
        "",
        f"| deg | {' | '.join(f'{t / INCH:.3f} in' for t in known.thickness_m)} |",
    ]
    lines.append("|---:|" + "---:|" * len(known.thickness_m))
    for angle, *row in zip(known.angle_rad, known.forward_pa, known.reverse_pa, known.ratio, strict=True):
        cells = [f"{f / 1e3:.1f} / {r / 1e3:.1f} ({x:.2f})" for f, r, x in zip(*row, strict=True)]
        lines.append(f"| {np.degrees(angle):.0f} | {' | '.join(cells)} |")
    return "\n".join(
        [*lines, "", "Violet: 0, equal both ways. Yellow: the largest ratio. Nothing beyond was measured."]
    )


def _nearest(task: Task, gamma_rad: float) -> int:
    """Return the index of a gamma on the grid's axis."""
    return round(gamma_rad / task.step) + half_steps(task)


def _log_tube(stream: rr.RecordingStream, task: Task, spiral: Design, volume: float) -> None:
    """Log a tube and its fibres at a volume ratio; nothing where its third fibre is slack or too short."""
    pair = inflate(spiral.alpha_rad, spiral.beta_rad, volume)
    helix = task.helix(pair, np.asarray(spiral.gamma_rad))
    if helix.state != HelixState.VALID:
        return
    stream.set_time(TIMELINE, sequence=round(1000 * volume))
    k, tau, l1 = float(helix.curvature), float(helix.torsion), float(pair.axial)
    radius = float(pair.radial) * task.radius

    def place(x: Array, around: Array) -> Array:
        """Return points (..., 3) on the tube at rest lengths x (m) and angles from the inside of the bend."""
        return surface(k, tau, l1 * x, around, radius).astype(np.float32)

    x = np.linspace(0, task.length, RINGS)
    sides = np.linspace(0, 2 * np.pi, SIDES, endpoint=False)
    vertices = place(x[:, None], sides).reshape(-1, 3)
    mesh = rr.Mesh3D(vertex_positions=vertices, triangle_indices=_triangles(), albedo_factor=(225, 222, 210, 255))
    stream.log("/spiral/tube", mesh)
    for name, angle in (("alpha", spiral.alpha_rad), ("beta", spiral.beta_rad), ("gamma", spiral.gamma_rad)):
        # The third fibre stays at the inside of the bend; the others wind relative to it.
        rate = (np.tan(angle) - np.tan(spiral.gamma_rad)) / task.radius
        points = int(np.clip(abs(rate) * task.length * 4, 300, MOST_POINTS))
        along = np.linspace(0, task.length, points)
        strip = rr.LineStrips3D([place(along, rate * along)], colors=COLOURS[name], radii=task.radius / 25)
        stream.log(f"/spiral/{name}", strip)


def surface(curvature: float, torsion: float, arc: Array, around: Array, radius: float) -> Array:
    """Return points (..., 3) on a tube around a helix along x, in its Frenet frame; arc (m) and around broadcast.

    `around` counts from the principal normal, which points at the axis of the helix.
    """
    omega = np.hypot(curvature, torsion)
    phase, arc = np.broadcast_arrays(omega * arc + 0 * around, arc + 0 * around)[0], arc + 0 * around
    c, s, zero = np.cos(phase), np.sin(phase), np.zeros_like(phase)
    big = curvature / omega**2
    centre = np.stack([torsion / omega * arc, big * c, big * s], axis=-1)
    normal = np.stack([zero, -c, -s], axis=-1)
    binormal = np.stack([zero + curvature / omega, torsion / omega * s, -torsion / omega * c], axis=-1)
    turned = np.cos(around)[..., None] * normal + np.sin(around)[..., None] * binormal
    return np.asarray(centre + radius * turned)


def _triangles() -> Array:
    """Return the triangles of the tube's mesh, (n, 3) indices."""
    ring, side = np.meshgrid(np.arange(RINGS - 1), np.arange(SIDES), indexing="ij")
    a, b = ring * SIDES + side, ring * SIDES + (side + 1) % SIDES
    quads = np.stack([a, b, b + SIDES, a, b + SIDES, a + SIDES], axis=-1)
    return np.asarray(quads.reshape(-1, 3), np.uint32)
