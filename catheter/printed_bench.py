"""The twist experiment on a simulated bench (thesis 6.5.1): a printed tube under pressure, two cameras, one light.

The model stands still at every moment. The camera above the tip sees a marker, the one beside the
tube its outline; both see an LED, each has a clock of its own. All of it is simulation.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from catheter.inflatable import Path, Pattern, Shape, build, otherwise
from data.errors import BadInput
from data.options import check, option
from data.signal import Array

if TYPE_CHECKING:
    from fem.tube import Inflation, Tube
    from vision.fit import Picture

TOPICS = ("/pressure", "/led", "/camera/top", "/camera/side")  # of its recording
STEPS = 48  # equilibria along the ramp; between them a cubic spline
MARKER_SHARE = 0.39  # the pitch over the top picture's side
LED = (3, 3, 10, 10)  # x, y, width, height [px] of the light in either picture
FAR = np.array([[-99.0, -99.0], [-98.0, -99.0], [-98.0, -98.0], [-99.0, -98.0]])


@dataclass(frozen=True, kw_only=True)
class Ramp:
    """Pressure: 0 for `wait`, up to `most` within `time` (slowing down as the tube gives way), held for `wait`."""

    most: float = option(95e3, unit="Pa", least=1.0, most=1e7)
    time: float = option(16.0, unit="s", least=0.1, most=3600.0)
    wait: float = option(2.0, unit="s", least=0.0, most=600.0)

    @property
    def duration(self) -> float:
        """Of the whole run [s]."""
        return self.time + 2 * self.wait

    def at(self, time_s: Array) -> Array:
        """Return the pressure [Pa] at times (n,)."""
        along = np.clip((time_s - self.wait) / self.time, 0.0, 1.0)
        return np.asarray(self.most * along * (2 - along))


@dataclass(frozen=True, kw_only=True)
class Print:
    """What the printer made of the table's materials: soft and stiff moduli over theirs."""

    soft: float = option(1.05, least=0.1, most=10.0)
    stiff: float = option(0.95, least=0.1, most=10.0)


@dataclass(frozen=True, kw_only=True)
class Cameras:
    """Frames in a second, exposure, noise in grey levels, clocks: a camera's stamp + offset is the bench's time.

    top: side of the square picture of the marker. side: width and height of the picture of the
    tube, scale: its pixels to the metre. flashes: when the LED comes on, each time for `lit`.
    quality: of the JPEGs.
    """

    rate: float = option(10.0, unit="Hz", least=0.1, most=1e4)
    exposure: float = option(10e-3, unit="s", least=1e-6, most=10.0)
    noise: float = option(2.0, least=0.0, most=100.0)
    top: int = option(160, least=64, most=2000)
    side: tuple[int, ...] = option((112, 184), least=32, most=4000)
    scale: float = option(4400.0, unit="1/m", least=1.0, most=1e7)
    top_offset: float = option(0.0371, unit="s", least=-10.0, most=10.0)
    side_offset: float = option(-0.0524, unit="s", least=-10.0, most=10.0)
    flashes: tuple[float, ...] = option((0.437, 1.021, 18.463, 19.094), unit="s", least=0.0, most=1e5)
    lit: float = option(0.25, unit="s", least=1e-4, most=100.0)
    quality: int = option(92, least=30, most=100)

    def __post_init__(self) -> None:
        """Refuse what cannot be filmed."""
        check(self, "cameras")
        if self.exposure * self.rate > 1 or len(self.side) != 2:
            raise BadInput("cameras", f"exposure {self.exposure} s, side {self.side}", "expected a period at most, 2")


@dataclass(frozen=True, kw_only=True)
class Gauge:
    """The pressure sensor: samples in a second, noise as a share of the reading and at rest, the seed of all noise."""

    rate: float = option(50.0, unit="Hz", least=1.0, most=1e5)
    share: float = option(2.5e-3, least=0.0, most=1.0)
    floor: float = option(20.0, unit="Pa", least=0.0, most=1e6)
    seed: int = option(2019, least=0)

    def read(self, exact: Array) -> Array:
        """Return what it reads of true pressures (n,) [Pa]."""
        noise = np.random.default_rng((self.seed, 0)).standard_normal((2, len(exact)))
        return np.asarray(exact * (1 + self.share * noise[0]) + self.floor * noise[1])


@dataclass(frozen=True, kw_only=True)
class PrintedRun:
    """A simulated experiment: the actuator as printed, its true motion, and what sensors and cameras give of it."""

    run: "Inflation"
    ramp: Ramp
    cameras: Cameras
    gauge: Gauge

    @cached_property
    def time_s(self) -> Array:
        """The gauge's stamps (n,)."""
        return np.arange(round(self.ramp.duration * self.gauge.rate)) / self.gauge.rate

    @cached_property
    def pressure_pa(self) -> Array:
        """What the gauge reads (n,)."""
        return self.gauge.read(self.ramp.at(self.time_s))

    @cached_property
    def led(self) -> tuple[Array, Array]:
        """When the bench switched the LED (k,), and to what (k,): from off at the start."""
        on = np.array([time for time in self.cameras.flashes if time < self.ramp.duration])
        times = np.stack([on, on + self.cameras.lit], axis=1).ravel()
        return np.append(0.0, times), np.append(0.0, np.tile([1.0, 0.0], len(on)))

    @cached_property
    def _splines(self) -> tuple[Any, Any]:
        """Twist, and the outline's three columns (left, right, height) in each ring, over pressure."""
        from scipy.interpolate import CubicSpline

        run = self.run
        rest = run.system.body.mesh.nodes
        rings = [np.flatnonzero(np.abs(rest[:, 2] - z) < 1e-9) for z in np.unique(rest[:, 2].round(9))]
        rings = [ring for ring in rings if rest[ring, 2].max() <= run.tube.length * (1 + 1e-9)]
        shapes = [np.stack([rest, *(point.x for point in run.points)])[:, ring] for ring in rings]
        outline = np.stack(
            [np.stack([x[..., 0].min(1), x[..., 0].max(1), x[..., 2].mean(1)], axis=-1) for x in shapes], axis=1
        )
        pressure = np.append(0.0, run.pressure)
        return CubicSpline(pressure, np.append(0.0, run.twist)), CubicSpline(pressure, outline)

    def twist(self, time_s: Array) -> Array:
        """Return the true twist [rad] at times (n,), anticlockwise as seen from beyond the tip."""
        return np.asarray(self._splines[0](self.ramp.at(time_s)))

    def extension(self, time_s: Array) -> Array:
        """Return the true extension [m] at times (n,)."""
        return np.asarray(self._splines[1](self.ramp.at(time_s))[:, -1, 2] - self.run.tube.length)

    def frames(self, camera: str) -> "Iterator[tuple[float, Picture]]":
        """Yield (stamp on the camera's own clock, picture) of the camera "top" or "side"."""
        from vision.render import render

        cameras = self.cameras
        draw, offset = {
            "top": (self._top, cameras.top_offset),
            "side": (self._side, cameras.side_offset),
        }[camera]
        noise = np.random.default_rng((self.gauge.seed, 1 + ("top", "side").index(camera)))
        first = noise.uniform(0.2, 0.8) / cameras.rate
        for moment in np.arange(first, self.ramp.duration, 1 / cameras.rate):
            yield float(moment - offset), render(draw(float(moment)), noise)

    def _lamp(self, moment: float) -> tuple[Array, float]:
        """Return the LED's place in a picture and the grey that it adds in an exposure."""
        x, y, width, height = LED
        ends = moment - self.cameras.exposure / 2, moment + self.cameras.exposure / 2
        lit = sum(max(0.0, min(ends[1], on + self.cameras.lit) - max(ends[0], on)) for on in self.cameras.flashes)
        corners = np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]]) - 0.5
        return corners, -150 + 180 * lit / self.cameras.exposure

    def _top(self, moment: float) -> Any:
        from vision.render import Shot

        size, now = self.cameras.top, np.array([moment])
        turned = self.twist(now + self.cameras.exposure * np.array([-0.5, 0.0, 0.5]))
        return Shot(
            width_px=size, height_px=size, middle_px=(0.52 * size, 0.51 * size), pitch_px=MARKER_SHARE * size,
            angle_rad=float(turned[1]), spin_rad=float(turned[2] - turned[0]), noise_grey=self.cameras.noise,
            patches=(self._lamp(moment),),
        )  # fmt: skip

    def _side(self, moment: float) -> Any:
        from vision.render import Shot

        width, height = self.cameras.side
        left, right, z = (self._splines[1](self.ramp.at(np.array([moment])))[0] * self.cameras.scale).T
        middle = 0.55 * width
        outline = np.vstack([np.stack([middle + right, z], axis=1), np.stack([middle + left, z], axis=1)[::-1]])
        outline[[0, -1], 1] = -9.0  # it enters at the top
        return Shot(
            width_px=width, height_px=height, layout=((FAR, 1.0),), patches=((outline, -150.0), self._lamp(moment)),
            blur_px=0.8, noise_grey=self.cameras.noise,
        )  # fmt: skip


def printed_run(
    shape: Shape, pattern: Pattern, made: Print, *, ramp: Ramp, cameras: Cameras, gauge: Gauge
) -> PrintedRun:
    """Return a simulated experiment with a tube as it was printed.

    Raises BadInput for what makes no tube, DidNotConverge where the ramp goes beyond the limit point.
    """
    run = as_printed(shape, pattern, made).inflate(ramp.most * np.arange(1, STEPS + 1) / STEPS)
    return PrintedRun(run=run, ramp=ramp, cameras=cameras, gauge=gauge)


def as_printed(shape: Shape, pattern: Pattern, made: Print) -> "Tube":
    """Return the tube of a scene with the materials that the printer made. Raises BadInput for what makes no tube."""
    stiff = pattern.stiff_voxels(*shape.voxels)
    return otherwise(build(shape, pattern, Path()), stiff, made.soft, made.stiff)
