"""A simulated experiment with surface markers: a printed tube at rising pressures, held for a while at each.

The model stands still at every moment; markers on its outer surface are followed as motion capture follows
them, in the base's frame, with noise. All of it is simulation.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from catheter.inflatable import Pattern, Shape
from catheter.printed_bench import Gauge, Print, as_printed
from data.errors import BadInput
from data.options import option
from data.signal import Array

if TYPE_CHECKING:
    from fem.tube import Inflation

STEPS = 12  # equilibria from rest to the highest pressure, beside the levels; between them a cubic spline
MOST = 333  # markers: three components each in one topic


@dataclass(frozen=True, kw_only=True)
class Stairs:
    """Pressures in turn, each risen to within `rise` and held for `hold`; before the first, 0 for `hold`."""

    levels: tuple[float, ...] = option((20e3, 40e3, 60e3, 0.0), unit="Pa", least=0.0, most=1e7)
    rise: float = option(1.0, unit="s", least=0.01, most=3600.0)
    hold: float = option(2.0, unit="s", least=0.1, most=3600.0)

    def __post_init__(self) -> None:
        """Check that there is something to see."""
        if not self.levels or not max(self.levels) > 0:
            raise BadInput("stairs, levels", f"are {self.levels}", "expected one above 0 at least")

    @property
    def duration(self) -> float:
        """Of the whole run [s]."""
        return self.hold + len(self.levels) * (self.rise + self.hold)

    def at(self, time_s: Array) -> Array:
        """Return the pressure [Pa] at times (n,)."""
        ends = self.hold + (self.rise + self.hold) * np.arange(len(self.levels))
        knots = np.stack([ends, ends + self.rise], axis=1).ravel()
        values = np.repeat([0.0, *self.levels], 2)[1:-1]
        return np.asarray(np.interp(time_s, knots, values))


@dataclass(frozen=True, kw_only=True)
class Markers:
    """Rings of markers on the outer surface: how many around and along, noise of each coordinate, samples in a second.

    Every other ring is turned by half a gap. fine: how much finer than the scene's the simulated mesh
    is in each direction: beyond 1 the reconstruction does not have the mesh that made its data.
    """

    around: int = option(12, least=1, most=MOST)
    along: int = option(12, least=1, most=MOST)
    noise: float = option(30e-6, unit="m", least=0.0, most=1e-2)
    rate: float = option(20.0, unit="Hz", least=0.1, most=1e4)
    fine: int = option(1, least=1, most=4)

    def __post_init__(self) -> None:
        """Check that one topic holds them."""
        if self.around * self.along > MOST:
            raise BadInput("markers", f"{self.around} x {self.along}", f"a recording holds {MOST} at most")

    def places(self, shape: Shape) -> Array:
        """Return where they are glued (m, 3) [m]: at heights that share the length, in the base's frame."""
        j, i = np.divmod(np.arange(self.around * self.along), self.around)
        angle = 2 * np.pi * (i + 0.5 * (j % 2)) / self.around
        z = shape.length * (j + 0.5) / self.along
        return np.stack([shape.outer_radius * np.cos(angle), shape.outer_radius * np.sin(angle), z], axis=1)

    def components(self) -> tuple[str, ...]:
        """Return the names of the coordinates: m1_x, m1_y, m1_z, m2_x ..."""
        return tuple(f"m{k}_{axis}" for k in range(1, self.around * self.along + 1) for axis in "xyz")


@dataclass(frozen=True, kw_only=True)
class MarkedRun:
    """A simulated experiment: the actuator as printed, its true motion, and what gauge and cameras give of it."""

    run: "Inflation"
    stairs: Stairs
    markers: Markers
    gauge: Gauge
    rest: Array

    @cached_property
    def time_s(self) -> Array:
        """The gauge's stamps (n,)."""
        return np.arange(round(self.stairs.duration * self.gauge.rate)) / self.gauge.rate

    @cached_property
    def pressure_pa(self) -> Array:
        """What the gauge reads (n,)."""
        return self.gauge.read(self.stairs.at(self.time_s))

    @cached_property
    def seen_s(self) -> Array:
        """The markers' stamps (k,)."""
        return np.arange(round(self.stairs.duration * self.markers.rate)) / self.markers.rate

    @cached_property
    def places(self) -> Array:
        """Where the markers are seen (k, 3m) [m], with noise."""
        noise = np.random.default_rng((self.gauge.seed, 1)).standard_normal((len(self.seen_s), self.rest.size))
        return np.asarray(self._spline(self.stairs.at(self.seen_s)) + self.markers.noise * noise)

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import CubicSpline

        from fem.attached import attached

        on = attached(self.run.system.body.mesh, self.rest)
        shapes = [on.at(x).ravel() for x in (self.run.system.body.mesh.nodes, *(p.x for p in self.run.points))]
        return CubicSpline(np.append(0.0, self.run.pressure), np.stack(shapes))


def marked_run(
    shape: Shape, pattern: Pattern, made: Print, *, stairs: Stairs, markers: Markers, gauge: Gauge
) -> MarkedRun:
    """Return a simulated experiment with a tube as it was printed.

    Raises BadInput for what makes no tube, DidNotConverge where the pressures go beyond the limit point.
    """
    finer = replace(shape, divisions=tuple(markers.fine * count for count in shape.divisions))
    most = max(stairs.levels)
    loads = np.unique([*stairs.levels, *(most * np.arange(1, STEPS + 1) / STEPS)])
    run = as_printed(finer, pattern, made).inflate(loads[loads > 0])
    return MarkedRun(run=run, stairs=stairs, markers=markers, gauge=gauge, rest=markers.places(shape))


def printed_moduli(shape: Shape, pattern: Pattern, made: Print) -> Array:
    """Return c1 of each voxel (v,) as the printer made it [Pa]."""
    around, along = shape.voxels
    stiff = pattern.stiff_voxels(around, along)
    return np.asarray(pattern.moduli(around, along) * np.where(stiff, made.stiff, made.soft)).ravel()
