"""Pictures of the thesis's shapes: Figs. 4.4 to 4.7, made from the shipped scenes."""

import time
from typing import Any

import numpy as np

from catheter.curve import Along, Curve
from catheter.frames import STRAIGHT, frenet, rotation_minimising
from catheter.lab.report import Progress, Report, Row
from catheter.lab.shape_view import Shaped, shaped, volume_error
from catheter.motions import coarse_wall
from catheter.target import query
from data.errors import BadInput
from data.signal import Array

MM = 1e3
SCENES = {
    "renal_balloon": "Fig. 4.4, balloon in a renal-like branch",
    "renal_spiral": "Fig. 4.4, spiral in it",
    "inflection": "Fig. 4.5, straight to inflection, R(w)",
    "twisting": "Fig. 4.6, twisting, R(v, w), gamma(v)",
}
VOXEL = (3, 16)


def shape_pictures(*, quick: bool, progress: Progress) -> Report:
    """Draw the thesis's cases at rest and at q = 1, the frames where Frenet-Serret fails, and a queried voxel."""
    found, rows = {}, []
    for done, (name, what) in enumerate(SCENES.items()):
        started = time.perf_counter()
        found[name] = shaped(name)
        grid = (20, 20, 5) if quick else (100, 100, 10)
        error = float(np.abs(volume_error(found[name].shape, 1.0, grid)).max())
        rows.append(Row(method=what, level="q = 1", error=error, seconds=time.perf_counter() - started))
        progress((done + 1) / len(SCENES))
    return Report(
        name="shape-pictures",
        title="Shapes of thesis Figs. 4.4 to 4.7 (simulated)",
        level="shape",
        error="worst |det F - 1|",
        rows=rows,
        notes=["Vessel, angles, lobes and sway are ours: the thesis prints L, k, rho and the radii of Fig. 4.4 only."],
        draw=lambda figure: _draw(figure, found),
    )


def _draw(figure: Any, found: dict[str, Shaped]) -> None:
    figure.set_size_inches(13, 8.5)
    grid = [figure.add_subplot(2, 3, k + 1, projection="3d") for k in range(6)]
    for axes, name in zip(grid, SCENES, strict=False):
        draw_shape(axes, found[name], 1.0, SCENES[name])
    draw_frames(grid[4], found["inflection"])
    draw_voxel(grid[5], found["twisting"])
    figure.suptitle("Shapes of thesis Figs. 4.4 to 4.7, simulated; grey: at rest; mm", fontsize=11)


def draw_shape(axes: Any, case: Shaped, q: float, title: str) -> None:
    """Draw a wall at q, in its vessel or beside its straight self."""
    vessel = case.vessel
    if vessel.kind != "straight":
        w = np.linspace(0, vessel.length, 60)
        along = Along(vessel.centre(w, 2), rotation_minimising(vessel.centre, w).normal)
        v = np.linspace(0, 2 * np.pi, 25)[:, None, None]
        out = np.cos(v) * along.normal[0] + np.sin(v) * along.binormal[0]
        _surface(axes, along.curve[0] + vessel.radius(w, 0)[0][:, None] * out, "tab:red", 0.12)
    else:
        _surface(axes, coarse_wall(case.shape, 0.0, 24, 40).positions[:, :, 1], "grey", 0.2)
    wall = coarse_wall(case.shape, q, 36, 240).positions[:, :, 1]
    _surface(axes, wall, "wheat", 0.5)
    axes.plot_wireframe(*np.moveaxis(MM * wall, -1, 0), rcount=12, ccount=30, color="saddlebrown", linewidth=0.4)
    _finish(axes, title)


def _surface(axes: Any, points: Array, colour: str, alpha: float) -> None:
    x, y, z = np.moveaxis(MM * points, -1, 0)
    axes.plot_surface(x, y, z, color=colour, alpha=alpha, linewidth=0, rcount=40, ccount=240)


def draw_frames(axes: Any, case: Shaped) -> None:
    """Draw double-reflection normals along the final curve, and mark where Frenet-Serret has none."""
    w = np.linspace(0, case.shape.length, 41)
    curve = case.shape.final
    points = curve(w, 0)[0]
    axes.plot(*(MM * points).T, color="black", linewidth=1)
    frames = rotation_minimising(curve, w, case.shape.seed)
    axes.quiver(*(MM * points).T, *frames.normal.T, length=4, color="tab:green", linewidth=0.8)
    lost = _without_normal(curve, w)
    axes.scatter(*(MM * points[lost]).T, color="tab:red", s=14)
    axes.set_ylim(-4, 4)
    try:
        frenet(curve, w)
        said = "Frenet-Serret exists"
    except BadInput as error:
        said = f"Frenet-Serret {error.found.split(':')[0]}"
    _finish(axes, f"Fig. 4.5, frames of it (green); red: no normal N\n{said}")


def _without_normal(curve: Curve, w: Array) -> Any:
    """Return at which stations the curve is straight, or turns its normal over before the next one."""
    _, first, second = curve(w, 2)
    across = np.cross(first, second)
    size = np.linalg.norm(across, axis=1) * float(np.ptp(w))
    over = (across[1:] * across[:-1]).sum(axis=1) < 0
    return (size <= STRAIGHT) | np.append(over, False) | np.append(False, over)


def draw_voxel(axes: Any, case: Shaped) -> None:
    """Draw a voxel at rest and moved, with its strain."""
    asked = query(case.shape, case.actuator, VOXEL, 1.0)
    for corners, colour in ((asked.rest, "grey"), (asked.moved, "tab:blue")):
        flat = MM * corners.reshape(8, 3)
        for a in range(8):
            for bit in (1, 2, 4):
                if not a & bit:
                    axes.plot(*flat[[a, a | bit]].T, color=colour)
    strain = asked.strain
    text = f"E rr {strain[0, 0]:.3f}, vv {strain[1, 1]:.3f}, ww {strain[2, 2]:.3f}, rv {strain[0, 1]:.3f},"
    more = f"rw {strain[0, 2]:.3f}, vw {strain[1, 2]:.3f}, det F - 1 = {asked.volume_ratio - 1:.0e}"
    _finish(axes, f"Fig. 4.7, voxel {VOXEL} of the twisting tube\n{text}\n{more}")


def _finish(axes: Any, title: str) -> None:
    axes.set_title(title, fontsize=8, parse_math=False)
    axes.set_aspect("equal")
    axes.tick_params(labelsize=6)
