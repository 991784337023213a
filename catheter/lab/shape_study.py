"""The study of shapes: frames on curves with known answers, and how well the wall keeps its volume."""

import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from catheter.curve import Offset, line
from catheter.frames import Frames, double_reflection, frenet, parallel_transport, rotation_minimising, total_twist
from catheter.lab.report import Progress, Report, Row, measure
from catheter.lab.shape_view import QS, Shaped, shaped, volume_error
from data.errors import CatheterError
from data.signal import Array
from fem.print_files import write_prints
from fem.slices import Resolution, write_slices
from fem.voxel_map import Sizes, VoxelMap


@dataclass(frozen=True)
class Helix:
    """A helix about z, w its arc length; a circle where pitch is 0. radius, pitch a radian [m]."""

    radius: float
    pitch: float

    def __call__(self, w: Array, order: int) -> Array:
        """Return the derivatives."""
        size = float(np.hypot(self.radius, self.pitch))
        rises = [self.pitch * w / size, self.pitch / size + 0 * w, *[0 * w] * max(order - 1, 0)]
        out = []
        for k in range(order + 1):
            phase, r = w / size + k * np.pi / 2, self.radius / size**k
            out.append(np.stack([r * np.cos(phase), r * np.sin(phase), rises[k]], axis=-1))
        return np.stack(out)

    def minimising(self, w: Array) -> Array:
        """Return the exact rotation-minimising N1, from the principal normal at w = 0: it lags by the torsion."""
        size = float(np.hypot(self.radius, self.pitch))
        turned = -self.pitch / size**2 * w[:, None]
        frame = frenet(self, w)
        return np.asarray(np.cos(turned) * frame.normal + np.sin(turned) * frame.binormal)


@dataclass(frozen=True)
class Swerve:
    """A plane curve (x, 0, z), straight up to w = 0.3 L, then a smooth step sideways with an inflection."""

    length: float
    sway: float

    def __call__(self, w: Array, order: int) -> Array:
        """Return the derivatives, at most the third."""
        from catheter.motions import Bend, Motions, offsets

        bend = Motions(bend=Bend(sway=self.sway, straight=0.3))
        straight = line(np.zeros(3), np.array([0.0, 0.0, 1.0]))
        normal = np.tile([1.0, 0, 0], (len(w), 1))
        return Offset(straight, lambda w: offsets(bend, self.length, None, w), lambda _: normal)(w, order)

    def minimising(self, w: Array) -> Array:
        """Return the exact rotation-minimising N1: in the plane, square to the tangent."""
        slope = self(w, 1)[1]
        across = np.stack([slope[:, 2], 0 * w, -slope[:, 0]], axis=-1)
        return np.asarray(across / np.linalg.norm(across, axis=-1)[:, None])


HELIX, CIRCLE, SWERVE = Helix(2e-3, 1e-3), Helix(3e-3, 0.0), Swerve(0.04, 0.01)
CURVES: dict[str, tuple[Helix | Swerve, float]] = {
    "helix": (HELIX, 6 * np.pi * float(np.hypot(2e-3, 1e-3))),
    "circle": (CIRCLE, 6e-3 * np.pi),
    "inflection": (SWERVE, 0.04),
}


def shape(*, quick: bool, progress: Progress) -> Report:
    """Frames against the exact rotation-minimising ones, and det F of the shipped spiral at 100,000 places."""
    rows = []
    counts = (16, 64, 256, 1024) if quick else (16, 32, 64, 128, 256, 512, 1024, 4096, 16384)
    for done, count in enumerate(counts):
        for name, (curve, length) in CURVES.items():
            rows += list(_frame_rows(name, curve, np.linspace(0, length, count + 1)))
        progress(0.6 * (done + 1) / len(counts))
    rows += _volume_rows(shaped("renal_spiral"))
    progress(0.8)
    rows += _print_rows((32, 64) if quick else (32, 64, 128))
    progress(1.0)
    return Report(
        name="shape",
        title="Frames along curves, volume of a wall, files for a printer: error against run time",
        level="stations, q, voxels",
        error="error of N1 [rad], |det F - 1|, volume",
        rows=rows,
        notes=[*_order_notes(rows), *_twist_notes(), *_gradient_notes()],
    )


def _frame_rows(name: str, curve: Helix | Swerve, w: Array) -> Iterator[Row]:
    exact = curve.minimising(w)

    def error(found: object) -> float:
        assert isinstance(found, Frames)
        return float(np.linalg.norm(found.normal - exact, axis=1).max())

    ways: dict[str, Callable[[], object]] = {
        "double reflection": partial(double_reflection, curve, w, exact[0]),
        "parallel transport": partial(parallel_transport, curve, w, exact[0]),
        "Frenet-Serret": partial(frenet, curve, w),
    }
    for way, solve in ways.items():
        yield measure(f"{way}: {name}", f"{len(w) - 1}", solve, error)


def _order_notes(rows: list[Row]) -> list[str]:
    """Return the slopes of log error over log stations on the helix, where rounding does not show."""
    notes = []
    for way in ("double reflection", "parallel transport"):
        found = [r for r in rows if r.method == f"{way}: helix" and 1e-9 < r.error < 0.1]
        order = -np.polyfit(np.log([float(r.level) for r in found]), np.log([r.error for r in found]), 1)[0]
        notes.append(f"{way}: order {order:.2f} on the helix.")
    return [
        *notes,
        "Curves: a helix of 3 turns; a circle; a plane curve, straight for 0.3 of its length, then with an inflection.",
        "Linear: one line in u across the wall, of the right volume as a whole; the thesis fits it at every place.",
        "Frenet-Serret's error is its own turn about the tangent: it follows the curve, not the least turn.",
    ]


def _twist_notes() -> list[str]:
    notes = []
    for name, (curve, length) in CURVES.items():
        twist = total_twist(rotation_minimising(curve, np.linspace(0, length, 401)))
        notes.append(f"Total twist of the rotation-minimising frame, {name}: {np.degrees(twist):.4f} deg.")
    return notes


def _volume_rows(found: Shaped) -> list[Row]:
    rows = []
    for q in QS:
        rows.append(
            measure(
                "wall exact, 100,000 places",
                f"q = {q:g}",
                partial(volume_error, found.shape, q),
                lambda error: float(np.abs(np.asarray(error)).max()),
            )
        )
        rows.append(
            measure(
                "wall linear in u, 2,000 places",
                f"q = {q:g}",
                partial(linear_wall_error, found, q),
                lambda error: float(np.abs(np.asarray(error)).max()),
            )
        )
    return rows


def _print_rows(counts: tuple[int, ...]) -> list[Row]:
    """Write random maps of three materials, each file read back; the error is of the sum of their volumes."""
    rows = []
    for count in counts:
        voxels = np.random.default_rng(0).integers(0, 3, (count, count))
        made = VoxelMap(title="random", sizes=Sizes(), materials=("Agilus30", "FLX9740", "FLX9785"), voxels=voxels)
        for name, write in (("STL and 3MF", _prints), ("1,333 slices", _slices)):
            with tempfile.TemporaryDirectory() as folder:
                started = time.perf_counter()
                try:
                    error, failed = write(made, Path(folder)), ""
                except CatheterError as refused:
                    error, failed = np.nan, f"failed: {refused}"[:200]
                spent = time.perf_counter() - started
            rows.append(Row(method=name, level=f"{count} x {count}", error=error, seconds=spent, failed=failed))
    return rows


def _prints(made: VoxelMap, folder: Path) -> float:
    return abs(write_prints(made, folder, "map").closure)


def _slices(made: VoxelMap, folder: Path) -> float:
    """Return the share of voxels that the layers show as another material."""
    found = write_slices(made, folder / "slices", Resolution())
    wanted = np.bincount(made.voxels.ravel(), minlength=len(made.materials))
    return float(sum(abs(found.voxels[m] - n) for m, n in zip(made.materials, wanted, strict=True)) / wanted.sum())


def linear_wall_error(found: Shaped, q: float) -> Array:
    """Return det F - 1 (20, 20, 5) of a wall whose distance is linear in u, of the right volume as a whole."""
    made = found.shape
    u = np.linspace(made.inner, made.outer, 5)
    wall = made.wall(q, u, 2 * np.pi * np.arange(20) / 20, np.linspace(0, made.length, 20))
    low, high = wall.h[..., :1], wall.h[..., -1:]
    slope = (high - low) / (made.outer - made.inner)
    h = low + slope * (u - made.inner)
    exact_slope, exact = wall.gradient[..., 0, 0], wall.h
    s, b = (p.value[..., None] for p in wall.parts[2:4])
    return np.asarray(wall.volume_ratio * (slope * h * (s - h * b)) / (exact_slope * exact * (s - exact * b)) - 1)


def difference_gradient(found: Shaped, q: float) -> tuple[Array, Array]:
    """Return det F at a few places in closed form, and by central differences of positions alone."""
    made = found.shape
    u = made.inner + (made.outer - made.inner) * np.array([0.2, 0.7])
    v, w = np.array([0.3, 2.0, 4.0]), made.length * np.array([0.1, 0.37, 0.5, 0.82])
    steps = (1e-5 * made.outer, 1e-4, 1e-5 * made.length)

    def jacobian(at: float) -> Array:
        columns = []
        for k, step in enumerate(steps):
            du, dv, dw = step * np.eye(3)[k]
            after, before = (made.wall(at, u + x * du, v + x * dv, w + x * dw).positions for x in (1, -1))
            columns.append((after - before) / (2 * step))
        return np.asarray(np.linalg.det(np.stack(columns, axis=-1)))

    return made.wall(q, u, v, w).volume_ratio, jacobian(q) / jacobian(0.0)


def _gradient_notes() -> list[str]:
    notes = []
    for name in ("renal_spiral", "twisting"):
        started = time.perf_counter()
        try:
            exact, difference = difference_gradient(shaped(name), 1.0)
        except CatheterError as error:
            notes.append(f"{name}: {error}")
            continue
        worst = float(np.abs(exact - difference).max())
        spent = time.perf_counter() - started
        notes.append(f"{name}, q = 1: det F against central differences of positions: {worst:.1e} ({spent:.2f} s).")
    return notes
