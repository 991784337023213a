"""A quasi-static twin: a recorded pressure drives the model of a printed tube, beside the twist that was measured.

The model has no memory and no inertia: what it leaves of the twist is friction, relaxation,
delay, and what is wrong with the materials. Twist is positive anticlockwise as seen from the tip's
side: a camera that looks at the tip measures it with that sign.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from catheter.response import Fineness, Response, respond
from data.errors import BadInput
from data.options import option
from data.signal import Array, Signal

if TYPE_CHECKING:
    from fem.tube import Tube


@dataclass(frozen=True, kw_only=True)
class Twinning:
    """ambient: what a recorded pressure is where the tube is at rest [Pa]; lag: by how much twist follows it [s]."""

    ambient: float = option(0.0, unit="Pa")
    lag: float = option(0.0, unit="s", least=-10.0, most=10.0)


@dataclass(frozen=True, eq=False)
class Twin:
    """The model beside a recording: twist at the pressure's times (n,) [rad], extension (n,) [m], and the residual.

    measured (m,) at measured_s, residual (m,) = model minus measured there [rad], NaN where either is
    missing; both empty without a measured twist.
    """

    time_s: Array
    pressure: Array
    twist: Array
    extension: Array
    measured_s: Array
    measured: Array
    residual: Array
    response: Response

    @property
    def compared(self) -> int:
        """Samples that have a residual."""
        return int(np.isfinite(self.residual).sum())

    @property
    def offset(self) -> float:
        """Mean residual [rad], NaN without any."""
        return float(np.nanmean(self.residual)) if self.compared else float("nan")

    @property
    def rmse(self) -> float:
        """Root mean square residual [rad], NaN without any."""
        return float(np.sqrt(np.nanmean(self.residual**2))) if self.compared else float("nan")

    @property
    def spread(self) -> float:
        """Root mean square residual about its mean [rad], NaN without any."""
        return float(np.nanstd(self.residual)) if self.compared else float("nan")


def twin(
    tube: "Tube",
    pressure: Signal,
    measured: Signal | None = None,
    *,
    options: Twinning | None = None,
    fineness: Fineness | None = None,
    progress: Callable[[float], None] | None = None,
) -> Twin:
    """Return what a tube does under a recorded pressure [Pa], beside a measured twist [rad] as it was recorded.

    Raises BadInput for signals in other units, or without a number; DidNotConverge where the pressure
    leaves the stable path.
    """
    chosen = options or Twinning()
    for signal, unit in ((pressure, "Pa"), (measured, "rad")):
        if signal is not None and (signal.unit != unit or signal.value.ndim != 1):
            raise BadInput(signal.name, f"is in {signal.unit}, {signal.value.ndim} dimension(s)", f"expected 1, {unit}")
    load = pressure.value - chosen.ambient
    sound = load[np.isfinite(load)]
    if not sound.size:
        raise BadInput(pressure.name, "has no number", "name another topic")
    found = respond(tube, float(sound.min()), float(sound.max()), fineness, progress)
    return beside(found, pressure, measured, options=chosen)


def beside(
    found: Response, pressure: Signal, measured: Signal | None = None, *, options: Twinning | None = None
) -> Twin:
    """Return a tube's response to a recorded pressure [Pa], beside a measured twist [rad], as `twin` does."""
    chosen = options or Twinning()
    load = pressure.value - chosen.ambient
    twist = found.at(load)
    at, value = (measured.time_s, measured.value) if measured is not None else (np.empty(0), np.empty(0))
    there = found.at(Signal(pressure.time_s, load, "Pa").at(at - chosen.lag))
    return Twin(
        time_s=pressure.time_s,
        pressure=pressure.value,
        twist=twist,
        extension=found.at(load, "extension"),
        measured_s=at,
        measured=value,
        residual=there - value,
        response=found,
    )
