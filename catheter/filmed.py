"""What the cameras of a printed actuator's recording tell, on the bench's clock (thesis 6.5.1): twist and extension.

The LED that the bench switches is seen by both cameras and puts their clocks on the bench's. The camera
above the marker looks at the tip from beyond: what it sees turn anticlockwise, turns anticlockwise about z.
"""

import math
from collections.abc import Iterator
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from catheter.printed_bench import LED, Cameras
from data.recording import Recording
from data.signal import Array, Signal
from vision.clock import Flash, Offset, brightness, flashes, of_known_length, offset, on_clock
from vision.fit import NoMarker
from vision.frames import Frame, open_source
from vision.side import side
from vision.twist import MISSING, Tracker, Twist, assemble, rows


@dataclass(frozen=True, eq=False)
class Filmed:
    """A recording with /pressure, /led, /camera/top and /camera/side, measured when asked for.

    cameras: exposure, length of the flashes and scale of the side view, as the bench was set up.
    reading: the same film, whose frames another process reads; what they show is then waited for.
    """

    path: Path
    cameras: Cameras
    reading: "Future[Filmed] | None" = None

    def ahead(self, executor: Executor) -> "Filmed":
        """Return the film while its frames begin to be read in an executor's process."""
        return replace(self, reading=executor.submit(self.watched))

    def watched(self) -> "Filmed":
        """Return it with every frame read, so that a process may hand it to another."""
        _ = self._read, self._top_clock, self._side_clock, self._marker, self._tips
        return self

    @cached_property
    def _read(self) -> tuple[Signal, Signal, str, dict[str, str]]:
        with Recording(self.path) as recording:
            pressure, led = recording.signal("/pressure", "pressure"), recording.signal("/led", "state")
            return pressure, led, recording.kind, recording.metadata.get("truth", {})

    @property
    def kind(self) -> str:
        """'measured', 'simulated' or 'unstated'."""
        return self._read[2]

    @property
    def truth(self) -> dict[str, str]:
        """What was simulated, by name; empty for a measurement."""
        return self._read[3]

    @property
    def pressure(self) -> Signal:
        """As the gauge read it [Pa]."""
        return self._read[0]

    @cached_property
    def flashes(self) -> list[Flash]:
        """When the bench switched the LED."""
        led = self._read[1]
        changed = np.flatnonzero(np.diff(led.value) != 0) + 1
        return [Flash(float(led.time_s[k]), float(led.time_s[k]), 1e-5, bool(led.value[k])) for k in changed]

    def clock(self, camera: str) -> Offset:
        """Return what is added to the stamps of the camera "top" or "side" to read the bench's clock.

        Raises BadInput where the light is not seen, DidNotConverge where it contradicts itself.
        """
        return self._source._top_clock if camera == "top" else self._source._side_clock

    def _frames(self, camera: str) -> Iterator[Frame]:
        return open_source(self.path, topic=f"/camera/{camera}").frames()

    def _offset(self, camera: str) -> Offset:
        steps = flashes(brightness(self._frames(camera), LED), self.cameras.exposure)
        return offset(*(of_known_length(found, self.cameras.lit) for found in (self.flashes, steps)))

    @property
    def _source(self) -> "Filmed":
        """The film whose frames were, or will be, read: another process's, if one reads them."""
        return self.reading.result() if self.reading else self

    @cached_property
    def _top_clock(self) -> Offset:
        return self._offset("top")

    @cached_property
    def _side_clock(self) -> Offset:
        return self._offset("side")

    @cached_property
    def _marker(self) -> Twist:
        return assemble(list(rows(self._frames("top"), Tracker())))

    @cached_property
    def _tips(self) -> Signal:
        time_s, tips = np.array([(frame.time_s, _tip(frame)) for frame in self._frames("side")]).T
        return Signal(time_s, (tips - tips[0]) / self.cameras.scale, "m", name="extension")

    @cached_property
    def twist(self) -> Signal:
        """Twist [rad] since the first frame, anticlockwise as seen from beyond the tip; NaN without a marker."""
        seen = self._source._marker
        return on_clock(Signal(seen.time_s, seen.angle_rad, "rad", name="twist"), self.clock("top"))

    @cached_property
    def twist_sigma(self) -> Array:
        """Standard deviation of each angle (n,) [rad]; the first frame's, which is subtracted, included."""
        sigma = self._source._marker.sigma_rad
        first = sigma[np.flatnonzero(np.isfinite(sigma))[:1]]
        return np.hypot(sigma, first[0] if first.size else math.nan)

    @property
    def missing(self) -> int:
        """Frames of the camera above without a marker."""
        return self._source._marker.status.count(MISSING)

    @cached_property
    def extension(self) -> Signal:
        """How far the tip moved along the axis since the first frame [m]; NaN where no tube was seen."""
        return on_clock(self._source._tips, self.clock("side"))

    @property
    def seen(self) -> "Seen":
        """Its pressure and twist, and how sure the twist is."""
        return Seen(self.pressure, self.twist, float(np.nanmedian(self.twist_sigma)), self.kind)


@dataclass(frozen=True, eq=False)
class Seen:
    """A recording's pressure [Pa] and twist [rad], the twist's standard deviation (NaN: not known), and whose."""

    pressure: Signal
    twist: Signal | None
    sigma: float
    kind: str

    def pairs(self) -> tuple[Array, Array]:
        """Return pressures and twists (n,) at the twist's times, where both are known; empty without a twist."""
        if self.twist is None:
            return np.empty(0), np.empty(0)
        there = self.pressure.at(self.twist.time_s)
        good = np.isfinite(self.twist.value) & np.isfinite(there)
        return there[good], self.twist.value[good]


def seen(path: Path, cameras: Cameras | None = None, *, pressure: str = "/pressure", twist: str = "/twist") -> Seen:
    """Return what a recording says of pressure and twist: as recorded, or else as its cameras saw it.

    Raises BadInput without a pressure, and for a film whose light tells no clock.
    """
    with Recording(path) as recording:
        load = recording.signal(pressure)
        if twist in recording.channels:
            components = recording.channels[twist].topic.components
            angle = recording.signal(twist, "angle" if "angle" in components else None)
            return Seen(load, angle, math.nan, recording.kind)
        filmed = {"/camera/top", "/led"} <= recording.channels.keys()
        kind = recording.kind
    if not filmed:
        return Seen(load, None, math.nan, kind)
    return replace(Filmed(path, cameras or Cameras()).seen, pressure=load)


def _tip(frame: Frame) -> float:
    """Return how far the tube reaches into a picture [px], NaN where there is none."""
    if frame.picture is None:
        return math.nan
    try:
        return side(frame.picture).extension_px
    except NoMarker:
        return math.nan
