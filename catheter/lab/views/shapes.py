"""The dashboard of a shape: q from 0 to 1 inside the vessel, frames, and a queried voxel."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from catheter.curve import Along
from catheter.frames import rotation_minimising
from catheter.lab.views.designs import PANELS
from catheter.lab.views.labels import MARK
from catheter.lab.views.layout import eye_on
from catheter.lab.views.output import write
from catheter.motions import coarse_wall
from catheter.target import Query, query
from data.signal import Array

if TYPE_CHECKING:
    from catheter.lab.shape_view import Shaped

TIMELINE = "q_1000"  # a sequence: 1000 times q
FRAMES = 21
AROUND, ALONG = 48, 240
MM = 1e3
AWAY = (0.8, -1.0, 0.5)  # where the camera stands
VESSEL, WALL, VOXEL = (205, 70, 70, 60), (225, 222, 210, 255), (30, 60, 200, 255)
LINES = (120, 110, 90)
EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
AXES = ((90, 160, 240), (110, 200, 110), (240, 200, 80))
CORNERS = (0, 1, 3, 2, 4, 5, 7, 6)  # of a voxel (2, 2, 2), as its faces below count them
FACES = ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))


def save_shape(found: "Shaped", voxel: tuple[int, int] | None, path: Path) -> None:
    """Write the dashboard to `path`, replaced; lengths shown in mm. Raises CannotWrite."""

    def log(stream: rr.RecordingStream) -> None:
        wall = _log_vessel(stream, found)
        seen = MM * coarse_wall(found.shape, 1.0, AROUND, ALONG).positions[:, :, 1]
        for q in np.linspace(0, 1, FRAMES).tolist():
            stream.set_time(TIMELINE, sequence=round(1000 * q))
            _log_actuator(stream, found, q)
            if voxel is not None:
                asked = query(found.shape, found.actuator, voxel, q)
                _log_voxel(stream, asked)
                stream.log("/voxel", rr.TextDocument(_text(asked), media_type=rr.MediaType.MARKDOWN))
        word = "simulated" if found.vessel.simulated else "computed"
        views: list[rrb.View | rrb.Container] = [
            rrb.Spatial3DView(
                name=f"{word} {found.title}, mm, over q",
                origin="/shape",
                eye_controls=eye_on(np.concatenate([seen.reshape(-1, 3), wall.reshape(-1, 3)]), AWAY),
                line_grid=False,
            )
        ]
        if voxel is not None:
            asked = query(found.shape, found.actuator, voxel, 1.0)
            near = MM * np.concatenate([asked.rest.reshape(-1, 3), asked.moved.reshape(-1, 3)])
            zoom = rrb.Spatial3DView(
                name=f"{word} voxel {voxel[0]}, {voxel[1]}, mm",
                origin="/shape/voxel",
                eye_controls=eye_on(near, AWAY),
                line_grid=False,
            )
            views.append(rrb.Vertical(zoom, rrb.TextDocumentView(name=f"{word} deformation", origin="/voxel")))
        time = rrb.TimePanel(timeline=TIMELINE, state="collapsed")
        layout = rrb.Horizontal(*views, column_shares=[2.0, 1.0][: len(views)])
        stream.send_blueprint(rrb.Blueprint(layout, *PANELS, time))

    write("shape", path, log)


def _log_vessel(stream: rr.RecordingStream, found: "Shaped") -> Array:
    """Log the vessel's wall and return it, (around, along, 3) [mm]."""
    vessel = found.vessel
    w = np.linspace(0, vessel.length, ALONG + 1)
    along = Along(vessel.centre(w, 2), rotation_minimising(vessel.centre, w).normal)
    v = 2 * np.pi * np.arange(AROUND + 1)[:, None, None] / AROUND
    out = np.cos(v) * along.normal[0] + np.sin(v) * along.binormal[0]
    wall = along.curve[0] + vessel.radius(w, 0)[0][:, None] * out
    stream.log("/shape/vessel", _mesh(wall, VESSEL), static=True)
    return np.asarray(MM * wall)


def _log_actuator(stream: rr.RecordingStream, found: "Shaped", q: float) -> None:
    wall = coarse_wall(found.shape, q, AROUND, ALONG)
    stream.log("/shape/actuator", _mesh(wall.positions[:, :, 1], WALL))
    along, size = wall.centre.along, found.shape.outer
    outer = MM * wall.positions[:, :, 1]
    lines = [*outer[:: AROUND // 8], *np.swapaxes(outer, 0, 1)[:: ALONG // 24]]  # without them no twist is seen
    stream.log("/shape/lines", rr.LineStrips3D(lines, colors=[LINES], radii=MM * size / 120))
    stream.log("/shape/centreline", rr.LineStrips3D([MM * along.curve[0]], colors=[MARK], radii=MM * size / 40))
    every = slice(None, None, ALONG // 12)
    for axis, name, colour in zip((along.normal, along.binormal, along.tangent), ["N1", "N2", "T"], AXES, strict=True):
        origins = MM * along.curve[0][every]
        arrows = rr.Arrows3D(
            origins=origins, vectors=1.5 * MM * size * axis[0][every], colors=[colour], radii=MM * size / 50
        )
        stream.log(f"/shape/frames/{name}", arrows)


def _mesh(points: Array, colour: tuple[int, int, int, int]) -> rr.Mesh3D:
    """Return the surface over points (around, along, 3) [m]."""
    rows, columns = points.shape[:2]
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns - 1), indexing="ij")
    a, b = i * columns + j, (i + 1) * columns + j
    faces = np.stack([a, b, b + 1, a, b + 1, a + 1], axis=-1).reshape(-1, 3)
    normal = np.cross(np.gradient(points, axis=0), np.gradient(points, axis=1))
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-300)
    return rr.Mesh3D(
        vertex_positions=(MM * points).reshape(-1, 3).astype(np.float32),
        vertex_normals=normal.reshape(-1, 3).astype(np.float32),
        triangle_indices=faces.astype(np.uint32),
        albedo_factor=colour,
    )


def _log_voxel(stream: rr.RecordingStream, asked: Query) -> None:
    faces = np.array([(f[0], f[k], f[k + 1]) for f in FACES for k in (1, 2)], dtype=np.uint32)
    for name, corners, colour in (("rest", asked.rest, (*VOXEL[:3], 70)), ("now", asked.moved, VOXEL)):
        points = (MM * corners).reshape(8, 3)[list(CORNERS)].astype(np.float32)
        entity, thick = f"/shape/voxel/{name}", float(np.ptp(points, axis=0).max()) / 40
        edges = rr.LineStrips3D([points[list(edge)] for edge in EDGES], colors=[colour[:3]], radii=thick)
        stream.log(f"{entity}/edges", edges)  # they show through the wall's surface, which the voxel shares
        stream.log(entity, rr.Mesh3D(vertex_positions=points, triangle_indices=faces, albedo_factor=colour))


def _text(asked: Query) -> str:
    return (
        f"**Voxel {asked.voxel[0]}, {asked.voxel[1]} at q = {asked.q:.2f}**: its middle\n\nF\n\n"
        f"{_grid(asked.gradient)}\n\nLagrangian strain\n\n{_grid(asked.strain)}\n\n"
        f"det F - 1 = {asked.volume_ratio - 1:.1e}\n\nlargest stretch {asked.stretch:.4f}\n\n"
        "r outwards, v around, w along"
    )


def _grid(matrix: Array) -> str:
    rows = [
        f"| {name} | " + " | ".join(f"{x:.5f}" for x in row) + " |" for name, row in zip("rvw", matrix, strict=True)
    ]
    return "\n".join(["| | r | v | w |", "|---|---|---|---|", *rows])
