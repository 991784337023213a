"""The bench's linear actuator and cylinder: from command volts to the piston's volume.

A servo limited in speed and in force: small commands are followed with a first-order bandwidth,
large ones at the largest speed, and the force limit bounds the acceleration. Its limits are
assumed; the thesis prints bore, stroke and sampling only.
"""

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from data.errors import BadInput
from data.options import option
from data.signal import Array
from sysid.excitation import Chirp, Excitation, Sine, Staircase, Steps, sample_times

ML = 1e-6
STROKE_M = 2 * 0.0254
AREA_M2 = math.pi / 4 * (1.0625 * 0.0254) ** 2  # 5.720 cm^2; 1-1/16 in bore and 2 in stroke are the thesis's
MOST_STEPS = 2_000_000_000


@dataclass(frozen=True, kw_only=True)
class Servo:
    """The actuator's limits, as the piston's: assumed so that a 5 Hz chirp moves about a millilitre.

    full: the command that asks for all. bandwidth: of small commands for a place. lag: of the
    speed. rise: of the force, so of the acceleration. speed: the most it aims at (turns overshoot it by an
    eighth, for the force lags). acceleration: the most it does. step: of
    the integration, which is first order.
    """

    full: float = option(4.71, unit="V", least=1e-6)
    bandwidth: float = option(5.0, unit="Hz", least=0.01, most=1000.0)
    lag: float = option(0.02, unit="s", least=1e-3)
    rise: float = option(0.02, unit="s", least=1e-3)
    speed: float = option(0.035, unit="m/s", least=1e-9)
    acceleration: float = option(0.875, unit="m/s^2", least=1e-6)
    step: float = option(1e-4, unit="s", least=1e-6, most=1e-3)


@dataclass(frozen=True, eq=False)
class Motion:
    """What the piston did, sampled, each (n,): time s, command V, place m, speed m/s, acceleration m/s^2."""

    time_s: Array
    command_v: Array
    place_m: Array
    speed_m_s: Array
    acceleration_m_s2: Array

    @property
    def volume_m3(self) -> Array:
        """The volume it has pushed out, (n,)."""
        return AREA_M2 * self.place_m

    def until(self, samples: int) -> "Motion":
        """Return the first samples only."""
        columns = (self.time_s, self.command_v, self.place_m, self.speed_m_s, self.acceleration_m_s2)
        return Motion(*(column[:samples] for column in columns))


def _drive(command: Array, modes: tuple[bool, bool], substeps: int, limits: Array, out: Array) -> None:
    smooth, by_speed = modes
    step, gain, lag, rise, fastest, strongest, stroke = limits
    place = 0.0 if by_speed else command[0]
    speed = push = 0.0
    for index in range(command.shape[0]):
        slope = (command[min(index + 1, len(command) - 1)] - command[index]) / substeps if smooth else 0.0
        for inner in range(substeps):
            asked = command[index] + slope * inner
            wanted = asked if by_speed else gain * (asked - place)
            wanted = max(-fastest, min(fastest, wanted))
            if (place <= 0 and wanted < 0) or (place >= stroke and wanted > 0):
                wanted = 0.0
            force = max(-strongest, min(strongest, (wanted - speed) / lag))
            if inner == 0:
                out[index, 0], out[index, 1], out[index, 2] = place, speed, push
            place += speed * step + push * step * step / 2
            speed += push * step
            push += (force - push) * step / rise
            if place < 0 or place > stroke:
                place, speed, push = max(0.0, min(stroke, place)), 0.0, 0.0


@cache
def _compiled() -> Any:
    from numba import njit  # compiled when a run is asked for, not when a scene is read

    return njit(cache=True)(_drive)


def move(servo: Servo, excitation: Excitation, rate_hz: float) -> Motion:
    """Return the piston's motion, sampled at `rate_hz`.

    Staircases and steps ask for a speed (their share of `full`, of the fastest), a chirp for a
    place about the middle of the stroke, ramps and sines for one from its start. Raises BadInput
    for a signal that cannot be sampled, or for too many steps.
    """
    time_s = sample_times(excitation, rate_hz)
    substeps = max(1, math.ceil(1 / (rate_hz * servo.step) - 1e-9))
    if len(time_s) * substeps > MOST_STEPS:
        raise BadInput("[servo] step", f"{len(time_s) * substeps:g} steps", f"expected at most {MOST_STEPS:g}")
    volts = excitation.volts(time_s)
    share = volts / servo.full
    by_speed, chirp = isinstance(excitation, Staircase | Steps), isinstance(excitation, Chirp)
    command = share * servo.speed if by_speed else STROKE_M * (0.5 + 0.5 * share if chirp else share)
    step = 1 / (rate_hz * substeps)
    gain = 2 * math.pi * servo.bandwidth
    limits = np.array([step, gain, servo.lag, servo.rise, servo.speed, servo.acceleration, STROKE_M])
    out = np.empty((len(time_s), 3))
    _compiled()(command, (chirp or isinstance(excitation, Sine), by_speed), substeps, limits, out)
    return Motion(time_s, volts, *out.T)
