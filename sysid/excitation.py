"""Test signals for the bench: what the actuator is told over time, and the table its Arduino plays.

Each signal is an options object with `duration_s` and `volts(time_s)`; times before its start or
after its end give 0 V. Amplitudes, periods and steps are the thesis's (Fig 3.25, eq. 3.25, 3.26).
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data.errors import BadInput
from data.files import fresh
from data.options import option
from data.signal import Array


@dataclass(frozen=True, kw_only=True)
class Chirp:
    """s(t) = a sin(2 pi f_i L [exp(t/L) - 1]), L = t_f / ln(f_f / f_i) (thesis eq. 3.25, 3.26).

    Equal start and end frequencies are the limit L -> infinity, a plain sine.
    """

    amplitude: float = option(4.71, unit="V", least=0.0)
    start: float = option(0.01, unit="Hz", least=1e-6)
    end: float = option(5.0, unit="Hz", least=1e-6)
    duration_s: float = option(1800.0, unit="s", least=1e-3)

    def phase(self, time_s: Array) -> Array:
        """Return the phase [rad], (n,)."""
        growth = math.log(self.end / self.start) / self.duration_s
        if growth == 0:
            return 2 * math.pi * self.start * time_s
        return 2 * math.pi * self.start / growth * np.expm1(growth * time_s)

    def frequency_hz(self, time_s: Array) -> Array:
        """Return the momentary frequency, (n,): f_i exp(t / L)."""
        return np.asarray(self.start * (self.end / self.start) ** (time_s / self.duration_s))

    def volts(self, time_s: Array) -> Array:
        """Return the command [V] at times (n,)."""
        return np.where(_within(self.duration_s, time_s), self.amplitude * np.sin(self.phase(time_s)), 0.0)


@dataclass(frozen=True, kw_only=True)
class Ramp:
    """The quasi-static ramp: up by `step` every `hold_s` (47 mV every 8 s), until `most` is reached."""

    step: float = option(0.047, unit="V", least=1e-6)
    hold_s: float = option(8.0, unit="s", least=1e-3)
    most: float = option(4.71, unit="V", least=0.0)

    @property
    def levels(self) -> int:
        """How many levels there are until `most`."""
        return max(1, math.ceil(self.most / self.step - 1e-9))

    @property
    def duration_s(self) -> float:
        """Seconds until the last level ends."""
        return self.levels * self.hold_s

    def volts(self, time_s: Array) -> Array:
        """Return the command [V] at times (n,)."""
        level = np.floor(time_s / self.hold_s + 1e-9) + 1
        return np.where(_within(self.duration_s, time_s), np.minimum(level * self.step, self.most), 0.0)


@dataclass(frozen=True, kw_only=True)
class Staircase:
    """Cycles of filling at the level's rate and draining at full power; the level rises each cycle.

    Thesis: 12 s and 3 s, 47 mV a cycle. Volts here ask for a speed; draining is -`most`.
    """

    step: float = option(0.047, unit="V", least=1e-6)
    most: float = option(4.71, unit="V", least=1e-6)
    fill_s: float = option(12.0, unit="s", least=1e-3)
    drain_s: float = option(3.0, unit="s", least=1e-3)

    @property
    def levels(self) -> int:
        """How many cycles there are until `most`."""
        return max(1, math.ceil(self.most / self.step - 1e-9))

    @property
    def duration_s(self) -> float:
        """Seconds until the last cycle ends."""
        return self.levels * (self.fill_s + self.drain_s)

    def volts(self, time_s: Array) -> Array:
        """Return the command [V] at times (n,)."""
        level, within = np.divmod(time_s + 1e-9, self.fill_s + self.drain_s)
        filling = np.minimum((level + 1) * self.step, self.most)
        return np.where(_within(self.duration_s, time_s), np.where(within < self.fill_s, filling, -self.most), 0.0)


@dataclass(frozen=True, kw_only=True)
class Sine:
    """A raised cosine from 0 to `amplitude`: a filling that starts and ends at rest, `cycles` times.

    The accumulators' excitation (thesis 3.1.1); its frequency is not printed, 0.1 Hz is assumed.
    """

    amplitude: float = option(4.71, unit="V", least=0.0)
    frequency: float = option(0.1, unit="Hz", least=1e-6)
    cycles: int = option(6, least=1, most=1_000_000)

    @property
    def duration_s(self) -> float:
        """Seconds until the last cycle ends."""
        return self.cycles / self.frequency

    def volts(self, time_s: Array) -> Array:
        """Return the command [V] at times (n,)."""
        wave = self.amplitude / 2 * (1 - np.cos(2 * np.pi * self.frequency * time_s))
        return np.where(_within(self.duration_s, time_s), wave, 0.0)


@dataclass(frozen=True, kw_only=True)
class Steps:
    """Cascading steps for the valves: out at each level and back, with rests at 0 V between.

    Volts ask for a speed. Levels rise evenly to `most`; each stroke lasts `stroke_s` at the
    highest level and longer at lower ones, so that every stroke is as long. Values are assumed.
    """

    most: float = option(4.71, unit="V", least=1e-6)
    levels: int = option(6, least=1, most=1000)
    stroke_s: float = option(2.0, unit="s", least=1e-3)
    rest_s: float = option(1.0, unit="s", least=0.0)

    def plan(self) -> tuple[Array, Array]:
        """Return (start of each piece [s], its volts), with the end and 0 V last."""
        volts, lasts = [], []
        for level in range(1, self.levels + 1):
            for sign in (1.0, -1.0):
                volts += [sign * self.most * level / self.levels, 0.0]
                lasts += [self.stroke_s * self.levels / level, self.rest_s]
        return np.concatenate([[0.0], np.cumsum(lasts)]), np.array([*volts, 0.0])

    @property
    def duration_s(self) -> float:
        """Seconds until the last rest ends."""
        return float(self.plan()[0][-1])

    def volts(self, time_s: Array) -> Array:
        """Return the command [V] at times (n,)."""
        starts, volts = self.plan()
        piece = np.searchsorted(starts, time_s + 1e-9, side="right") - 1
        return np.where(_within(self.duration_s, time_s), volts[piece.clip(0)], 0.0)


Excitation = Chirp | Ramp | Staircase | Sine | Steps


def _within(duration_s: float, time_s: Array) -> Array:
    return np.asarray((time_s >= 0) & (time_s < duration_s))


def sample_times(excitation: Excitation, rate_hz: float, most: int = 100_000_000) -> Array:
    """Return the sampling times 0, 1/rate ... before the end, (n,): the 1800 s chirp at 83 Hz has 149,400.

    Raises BadInput for fewer than 2 or more than `most` samples, or a chirp beyond half the rate.
    """
    wanted = excitation.duration_s * rate_hz
    if not 2 <= wanted <= most:
        what = f"{excitation.duration_s:g} s at {rate_hz:g} Hz"
        raise BadInput("[drive]", f"{what} is {wanted:g} samples", f"expected 2 to {most:g}")
    fastest = max(excitation.start, excitation.end) if isinstance(excitation, Chirp) else 0.0
    if fastest > rate_hz / 2:
        raise BadInput("[drive]", f"chirp up to {fastest:g} Hz", f"at most half of {rate_hz:g} Hz")
    return np.arange(math.ceil(wanted - 1e-6)) / rate_hz


def write_pwm_csv(
    path: Path, excitation: Excitation, *, rate_hz: float, supply_v: float = 5.0, bits: int = 8, replace: bool = False
) -> int:
    """Write time_s, pwm for the bench's Arduino; return the rows. pwm: signed counts of supply_v.

    The sign is the direction. A row is written when the count changes, and one at the end; the
    step is supply_v / (2^bits - 1) (19.6 mV at 5 V and 8 bits: finer than the thesis's 47 mV).
    Raises BadInput when the signal asks for more than supply_v, CannotWrite for the place.
    """
    time_s = sample_times(excitation, rate_hz)
    volts = excitation.volts(time_s)
    full = (1 << bits) - 1
    if np.abs(volts).max() > supply_v:
        raise BadInput("PWM", f"{np.abs(volts).max():g} V is asked for", f"the supply gives {supply_v:g} V")
    counts = np.rint(volts / supply_v * full).astype(np.int64)
    changed = np.flatnonzero(np.diff(counts, prepend=counts[0] + 1))
    rows = [f"{time_s[at]:.4f},{counts[at]}" for at in changed] + [f"{excitation.duration_s:.4f},0"]
    with fresh(path, replace) as temporary:
        temporary.write_text("\n".join(["time_s,pwm", *rows, ""]), encoding="ascii")
    return len(rows)
