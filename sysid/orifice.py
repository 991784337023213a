"""Valves from bench recordings: the orifice coefficient K, and the pressure at which a valve cracks."""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput
from data.options import option
from sysid.derivative import noise_robust_derivative
from sysid.nonnegative import solve

Array = NDArray[np.float64]

DONE = 0.02  # thesis: the set screw is turned until K is within 2 % of its target
BINS = 400


@dataclass(frozen=True, kw_only=True)
class ValveProtocol:
    """How a stroke becomes flow and pressure drop (thesis 3.1.1)."""

    cutoff: float = option(10.0, unit="Hz", least=1e-3)
    order: int = option(4, least=1, most=10)
    discard: float = option(1 / 3, least=0.0, most=0.9)
    half: int = option(4, least=1, most=100)


@dataclass(frozen=True, eq=False)
class ValveFit:
    """q = K sgn(dp) sqrt|dp|: K and its standard error [m^3 s^-1 Pa^-1/2], from `strokes` strokes.

    The standard error comes from the scatter of whole strokes (their residuals are alike within
    one), so it holds for filtered data. each (strokes,): K of every stroke alone.
    """

    coefficient: float
    standard_error: float
    strokes: int
    each: Array
    rmse_m3_s: float
    samples: int

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """Return K's interval by Student's t with strokes - 1 degrees of freedom."""
        from scipy.stats import t

        reach = float(t.ppf((1 + level) / 2, self.strokes - 1)) * self.standard_error
        return self.coefficient - reach, self.coefficient + reach

    def deviation(self, target: float) -> float:
        """Return (K - target) / target."""
        return self.coefficient / target - 1

    def advice(self, target: float) -> str:
        """Return what to do with the set screw: "tighten" for a K above the target, "loosen", or "done"."""
        off = self.deviation(target)
        return "done" if abs(off) <= DONE else "tighten" if off > 0 else "loosen"


def low_pass(value: Array, rate_hz: float, cutoff_hz: float, order: int = 4) -> Array:
    """Return a zero-phase Butterworth low-pass of (n,), 3 dB down at cutoff_hz after both passes.

    Each pass alone has its 3 dB point at cutoff / (sqrt 2 - 1)^(1 / 2 order), 11.2 Hz for 10 Hz
    and order 4. Raises BadInput for a cutoff beyond half the sampling rate or too few samples.
    """
    from scipy.signal import butter, sosfiltfilt

    once = cutoff_hz / (np.sqrt(2) - 1) ** (1 / (2 * order))
    if once >= rate_hz / 2:
        raise BadInput("low pass", f"{cutoff_hz:g} Hz at {rate_hz:g} Hz sampling", "sample faster or filter lower")
    if len(value) < 6 * order + 4:
        raise BadInput("low pass", f"{len(value)} samples", f"at least {6 * order + 4} are needed")
    return np.asarray(sosfiltfilt(butter(order, once, fs=rate_hz, output="sos"), value))


@dataclass(frozen=True, eq=False)
class Settled:
    """What a fit uses of n samples: the filtered drop (n,) [Pa], and the flow (n,) [m^3/s], NaN outside the parts.

    parts: the settled part of each stroke.
    """

    drop_pa: Array
    flow_m3_s: Array
    parts: tuple[slice, ...]


def settle(
    time_s: Array,
    place_m: Array,
    drop_pa: Array,
    command_v: Array,
    *,
    area_m2: float,
    options: ValveProtocol | None = None,
) -> Settled:
    """Return the settled strokes of a run of voltage steps: piston place, pressure drop and command, each (n,).

    Filtered without phase, cut where the voltage changes, the first third of every stroke dropped
    (acceleration), flow = area d(place)/dt. Raises BadInput for fewer than 3 usable strokes.
    """
    chosen = options or ValveProtocol()
    rate_hz = (len(time_s) - 1) / float(time_s[-1] - time_s[0])
    place = low_pass(place_m, rate_hz, chosen.cutoff, chosen.order)
    drop = low_pass(drop_pa, rate_hz, chosen.cutoff, chosen.order)
    flow, parts = np.full(len(time_s), np.nan), []
    for stroke in _strokes(command_v, chosen.half):
        settled = _settled(place[stroke], chosen.discard)
        part = slice(settled, len(place[stroke]) - chosen.half)  # the filter smears the next voltage into the end
        if part.stop - part.start > 4 * chosen.half:
            whole = slice(stroke.start + part.start, stroke.start + part.stop)
            flow[whole] = area_m2 * noise_robust_derivative(time_s[stroke], place[stroke], chosen.half)[part]
            parts.append(whole)
    if len(parts) < 3:
        raise BadInput("valve", f"{len(parts)} usable strokes", "at least 3 are needed: step the voltage more often")
    return Settled(drop, flow, tuple(parts))


def fit_orifice(
    time_s: Array,
    place_m: Array,
    drop_pa: Array,
    command_v: Array,
    *,
    area_m2: float,
    options: ValveProtocol | None = None,
) -> ValveFit:
    """Fit K to the settled strokes of a run; arguments and errors as `settle`."""
    return fit_settled(settle(time_s, place_m, drop_pa, command_v, area_m2=area_m2, options=options))


def fit_settled(run: Settled) -> ValveFit:
    """Fit K to settled strokes. Raises BadInput where the drop is 0 throughout."""
    root = np.sign(run.drop_pa) * np.sqrt(np.abs(run.drop_pa))
    return _pooled([run.flow_m3_s[part] for part in run.parts], [root[part] for part in run.parts])


def _pooled(flows: list[Array], roots: list[Array]) -> ValveFit:
    power = np.array([float(root @ root) for root in roots])
    cross = np.array([float(root @ flow) for root, flow in zip(roots, flows, strict=True)])
    if not power.sum() > 0:
        raise BadInput("valve", "the pressure drop is 0 throughout", "connect both pressure sensors")
    coefficient = float(cross.sum() / power.sum())
    scores, count = cross - coefficient * power, len(flows)
    error = float(np.sqrt(np.sum(scores**2) * count / (count - 1))) / float(power.sum())
    square = sum(float(np.sum((q - coefficient * s) ** 2)) for q, s in zip(flows, roots, strict=True))
    samples = sum(map(len, flows))
    return ValveFit(coefficient, error, count, cross / power, float(np.sqrt(square / samples)), samples)


def _strokes(command_v: Array, half: int) -> list[slice]:
    """Return the stretches of one voltage that is not zero."""
    edges = np.flatnonzero(np.diff(command_v)) + 1
    bounds = np.concatenate([[0], edges, [len(command_v)]])
    pieces = [slice(int(a), int(b)) for a, b in itertools.pairwise(bounds)]
    return [piece for piece in pieces if command_v[piece.start] != 0 and piece.stop - piece.start > 8 * half]


def _settled(place: Array, discard: float) -> int:
    """Return the sample at which `discard` of the stroke's length is behind."""
    done = np.abs(place - place[0])
    return int(np.argmax(done >= discard * done[-1]))


@dataclass(frozen=True)
class Cracking:
    """The pressure of the first flow [Pa], with an interval at `level`; direction: "forward" or "reverse"."""

    pressure_pa: float
    low_pa: float
    high_pa: float
    level: float
    direction: str


def fit_cracking(drop_pa: Array, flow_m3_s: Array, *, level: float = 0.95) -> list[Cracking]:
    """Find the first flow in each direction of a slow ramp: pressure drop and flow, each (n,).

    Flow before: a constant (the sensor's zero). After pressure c: a jump and a straight line of
    (p - c), not negative, and its square and cube for the curvature further on. The c of least
    squares on 400 means of neighbouring samples; its interval is where the squares stay below the
    least times 1 + F(level; 1, m - 6) / (m - 6), with a bin either side. Raises BadInput for a
    ramp without flow, or without rest before it.
    """
    found = []
    for direction, sign in (("forward", 1.0), ("reverse", -1.0)):
        pressure, flow = sign * drop_pa, sign * flow_m3_s
        peak = int(np.argmax(pressure))
        start = int(np.flatnonzero(pressure[: peak + 1] <= 0.02 * pressure[peak])[-1:].sum()) if peak else 0
        if peak - start >= 2 * BINS and pressure[peak] > 0.1 * float(np.abs(drop_pa).max()):
            found.append(_crack(pressure[start:peak], flow[start:peak], level, direction))
    if not found:
        raise BadInput("cracking", f"no rise of the pressure over {2 * BINS} samples", "ramp it slowly, 500 Hz")
    return found


def _crack(pressure: Array, flow: Array, level: float, direction: str) -> Cracking:
    from scipy.stats import f

    size = len(pressure) // BINS
    p, q = (one[: size * BINS].reshape(BINS, size).mean(axis=1) for one in (pressure, flow))
    squares = np.full(BINS, np.inf)
    for at in range(4, BINS - 8):
        past = np.maximum(p - p[at], 0.0)
        columns = np.stack([np.ones(BINS), past**2, past**3, (np.arange(BINS) > at) * 1.0, past], axis=1)
        squares[at] = solve(columns, q, 3).residual_norm ** 2
    best, spare = int(np.argmin(squares)), BINS - 6
    whole = float(np.sum((q - q.mean()) ** 2))
    if not squares[best] < 0.9 * whole:
        raise BadInput(f"cracking, {direction}", "the flow never leaves its zero", "raise the pressure further")
    near = np.flatnonzero(squares <= squares[best] * (1 + float(f.ppf(level, 1, spare)) / spare))
    if near[0] <= 4:
        raise BadInput(f"cracking, {direction}", "it flows from the start", "begin the ramp below the first flow")
    return Cracking(float(p[best]), float(p[near[0] - 1]), float(p[near[-1] + 1]), level, direction)
