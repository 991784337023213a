"""Directions, signs and frames of a printed tube in one picture, and the symmetries that prove them."""

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catheter.lab.report import Progress, Report, Row
from data.signal import Array
from fem.grid import skin
from fem.material import printable
from fem.tube import Inflation, Tube

KPA, MM = 1e3, 1e-3
VOXELS = 16
SOFT, STIFF = "Agilus30", "FLX9785"
COLOURS = np.array([(0.96, 0.80, 0.58), (0.27, 0.45, 0.70)])
TWISTING, BENDING = (40 * KPA, 60 * KPA), (40 * KPA, 60 * KPA)


def tube(stiff: NDArray[np.bool_]) -> Tube:
    """Return a tube with a rigid cap, stiff (around, along) where it is said."""
    material = np.full(stiff.shape, printable(SOFT), dtype=object)
    material[stiff] = printable(STIFF)
    divisions = (stiff.shape[0], stiff.shape[1], 1)
    return Tube(length=32 * MM, outer_radius=5 * MM, wall=1 * MM, divisions=divisions, material=material)


def directions(*, quick: bool, progress: Progress) -> Report:
    """Show which way is positive, and that mirrored and turned tubes answer mirrored and turned."""
    i, j = np.indices((VOXELS, VOXELS))
    maps = {
        "i - j": (i - j) % 8 < 2,
        "i + j": (i + j) % 8 < 2,
        "strip": i < 4,
        "strip, 4 voxels on": (i - 4) % VOXELS < 4,
    }
    runs: dict[str, Inflation] = {}
    seconds: dict[str, float] = {}
    for done, (name, stiff) in enumerate(maps.items()):
        started = time.perf_counter()
        runs[name] = tube(stiff).inflate(TWISTING if "j" in name else BENDING)
        seconds[name] = time.perf_counter() - started
        progress((done + 1) / len(maps))
    right, left = (float(runs[name].twist[-1]) for name in ("i - j", "i + j"))
    first, on = (float(runs[name].bending_direction[-1]) for name in ("strip", "strip, 4 voxels on"))
    middle = np.pi / 4  # of voxels 0 to 3 of 16
    errors = {
        "i - j": (
            "a right-handed wrap twists clockwise, by as much as its mirror image anticlockwise",
            abs(right / left + 1),
        ),
        "strip": ("a stiff strip i = 0 .. 3 of 16 bends the tip towards 45 deg", abs(first - middle)),
        "strip, 4 voxels on": ("4 voxels on, it bends towards 90 deg more", abs(on - first - np.pi / 2)),
    }
    rows = [Row(method=text, level=name, error=e, seconds=seconds[name]) for name, (text, e) in errors.items()]
    return Report(
        name="directions",
        title="Directions and signs of a printed tube (simulated)",
        level="map",
        error="departure [1, rad]",
        rows=rows,
        notes=[
            "z runs from the fixed base to the tip; x and y lie in the base's plane, right-handed.",
            "Voxel [i, j]: i-th anticlockwise from the x axis as seen from +z (from the tip), j-th from the base.",
            f"At 60 kPa a right-handed wrap, (i - j) mod 8 < 2, twists by {np.degrees(right):+.2f} deg, a left-handed "
            f"one, (i + j) mod 8 < 2, by {np.degrees(left):+.2f} deg.",
            f"Twist is positive anticlockwise as seen from +z. Bending is the angle between the end ring's axis and z, "
            f"its direction the way the tip leans, from x towards y: {np.degrees(first):.1f} deg for the strip.",
        ],
        draw=lambda figure: _draw(figure, runs["i + j"], runs["strip"]),
    )


def _draw(figure: Any, twisting: Inflation, bending: Inflation) -> None:
    figure.set_size_inches(12, 5)
    figure.set_layout_engine("none")
    places = [(0.21 * k - 0.085, -0.02, 0.42, 1.0) for k in range(3)]  # squares, of which the middle is drawn on
    views = [figure.add_axes(place, projection="3d", computed_zorder=False) for place in places]
    rest = twisting.system.body.mesh.nodes
    _solid(views[0], twisting, rest)
    _voxels(views[0])
    figure.text(
        0.125 + 0.21 * 0,
        0.92,
        "at rest, stiff blue: (i + j) mod 8 < 2,\nleft-handed; i red around, j black along",
        fontsize=9,
        ha="center",
    )
    _solid(views[1], twisting, twisting.points[-1].x)
    twist = float(twisting.twist[-1])
    _arc(views[1], twist, 36.0, 9.0, f"twist {np.degrees(twist):+.1f} deg")
    figure.text(0.125 + 0.21 * 1, 0.92, "60 kPa: twist > 0 is\nanticlockwise as seen from +z", fontsize=9, ha="center")
    _solid(views[2], bending, bending.points[-1].x)
    angle, way = float(bending.bending[-1]), float(bending.bending_direction[-1])
    _bend(views[2], bending, angle, way)
    figure.text(
        0.125 + 0.21 * 2, 0.92, "60 kPa: the tip leans towards\nthe stiff strip, i = 0 .. 3", fontsize=9, ha="center"
    )
    for view in views:
        _frame(view)
    figure.text(0.98, 0.03, "simulated; deformed shapes to scale", fontsize=8, ha="right")
    _from_above(figure.add_axes((0.66, 0.03, 0.33, 0.88)), bending, way)


def _solid(view: Any, run: Inflation, x: Array) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    quads, part = skin(run.system.body.mesh)
    stiff = np.array([law.name == STIFF for law in run.tube.material.ravel()])
    corners = x[quads] / MM
    across = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    light = 0.7 + 0.3 * across @ (np.array([1.0, -1.0, 0.7]) / np.sqrt(2.49))
    shades = np.clip(COLOURS[stiff[part].astype(int)] * light[:, None], 0, 1)
    view.add_collection3d(Poly3DCollection(corners, facecolors=shades, edgecolors=(0, 0, 0, 0.15), linewidths=0.3))


def _frame(view: Any) -> None:
    for name, end in (("x", (12, 0, 0)), ("y", (0, 12, 0)), ("z", (0, 0, 42))):
        start = (0, 0, 34) if name == "z" else [0.45 * e for e in end]  # inside the tube it would not be seen
        view.plot(*([a, e] for a, e in zip(start, end, strict=True)), color="k", linewidth=1.2, zorder=9)
        view.text(*(1.1 * e for e in (end if name != "z" else (0, 0, 40))), name, fontsize=11, zorder=9)
    view.set(xlim=(-9, 9), ylim=(-9, 9), zlim=(-1, 46))
    view.set_box_aspect((18, 18, 47), zoom=0.98)
    view.view_init(elev=25, azim=20)
    view.patch.set_visible(False)  # the squares overlap
    view.set_axis_off()


def _voxels(view: Any) -> None:
    """Number the first voxels around the base, and along from it."""
    style: dict[str, Any]
    for i in range(-2, 5):
        angle, style = 2 * np.pi * (i + 0.5) / VOXELS, {"fontsize": 7, "color": "C3", "ha": "center", "zorder": 9}
        view.text(5.2 * np.cos(angle), 5.2 * np.sin(angle), -1.6, f"{i % VOXELS}", **style)
    for j in range(0, VOXELS, 2):
        angle, height = 2 * np.pi * 0.5 / VOXELS, 32 * (j + 0.2) / VOXELS
        view.text(
            5.2 * np.cos(angle), 5.2 * np.sin(angle), height, f"{j}", fontsize=7, color="k", ha="center", zorder=9
        )


def _arc(view: Any, turn: float, height: float, radius: float, text: str) -> None:
    angle = np.linspace(0, turn, 40)
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    view.plot(x, y, np.full(40, height), color="C3", linewidth=2)
    along = np.array([x[-1] - x[-4], y[-1] - y[-4], 0.0])
    view.quiver(x[-1], y[-1], height, *along, color="C3", arrow_length_ratio=5, linewidth=2)
    for end in (0, turn):
        view.plot([0, radius * np.cos(end)], [0, radius * np.sin(end)], [height, height], color="C3", linewidth=0.8)
    view.text(0, 2, height + 3, text, fontsize=9, color="C3")


def _bend(view: Any, run: Inflation, angle: float, way: float) -> None:
    line = run.centreline[-1] / MM
    view.plot(*line.T, color="C3", linewidth=2, zorder=9)
    axis = np.array([np.sin(angle) * np.cos(way), np.sin(angle) * np.sin(way), np.cos(angle)])
    view.quiver(*line[-1], *(10 * axis), color="C3", linewidth=2, arrow_length_ratio=0.2)
    view.plot([line[-1, 0]] * 2, [line[-1, 1]] * 2, [line[-1, 2], line[-1, 2] + 10], color="k", linestyle=":")
    view.text(*(line[-1] + 7 * axis + [0, 1.5, 0]), f"bending {np.degrees(angle):.1f} deg", fontsize=9, color="C3")


def _from_above(view: Any, run: Inflation, way: float) -> None:
    """Draw the base as seen from +z: the voxels' numbers, and the bending's direction."""
    for i in range(VOXELS):
        angle = 2 * np.pi * np.linspace(i, i + 1, 8) / VOXELS
        ring = np.concatenate([np.exp(1j * angle) * 5, np.exp(1j * angle[::-1]) * 4])
        stiff = run.tube.material[i, 0].name == STIFF
        view.fill(ring.real, ring.imag, color=COLOURS[int(stiff)], edgecolor="0.4", linewidth=0.5)
        middle = np.exp(1j * angle.mean()) * 4.5
        view.text(middle.real, middle.imag, str(i), fontsize=7, ha="center", va="center")
    view.annotate("", (3.4 * np.cos(way), 3.4 * np.sin(way)), (0, 0), arrowprops={"color": "C3", "width": 1.5})
    turn = np.linspace(0, way, 30)
    view.plot(1.5 * np.cos(turn), 1.5 * np.sin(turn), color="C3")
    view.text(-2.2, -1.6, f"bending direction\n{np.degrees(way):.0f} deg, from x to y", fontsize=8, color="C3")
    turn = np.linspace(-0.9, 0.9, 40) + np.pi
    tip, before = (5.9 * np.array([np.cos(turn[k]), np.sin(turn[k])]) for k in (-1, -4))
    view.annotate("", tip, before, arrowprops={"arrowstyle": "->", "color": "C0"})
    view.plot(5.9 * np.cos(turn), 5.9 * np.sin(turn), color="C0")
    view.text(-7.6, 4.8, "i, twist > 0", fontsize=8, color="C0")
    for name, end in (("x", (7, 0)), ("y", (0, 7))):
        view.annotate("", end, (0, 0), arrowprops={"arrowstyle": "->"})
        view.text(end[0] * 1.04, end[1] * 1.04, name, fontsize=11)
    view.set(xlim=(-8, 8), ylim=(-8, 8), aspect="equal")
    view.set_title("as seen from +z (from the tip): voxel numbers i", fontsize=9)
    view.set_axis_off()
