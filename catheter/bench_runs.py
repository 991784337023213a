"""The simulated bench's experiments: chirp, ramp and staircase of a bender, accumulator, valve, cracking.

Each takes options and gives the topics that its recording holds. Sensor noise is stated as signal
to noise: the clean signal's standard deviation over the noise's, in decibels. All is simulation:
published where the thesis prints a number, assumed where it does not.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from catheter.actuator import AREA_M2, ML, Motion, Servo, move
from catheter.bench import Plant
from data.errors import BadInput
from data.options import option
from data.signal import Array
from sysid.excitation import Chirp, Ramp, Sine, Staircase, Steps

MOST_RAMP = 25_000_000  # samples of one of the two ramps over a cracking valve
UNCONSTRAINED = Plant(slip_ml=(), stiffness=(), pressure_stiffness=())
CONSTRAINED = Plant(
    cubic=6.52e-4, square=0.0, inertia=0.0, constant=2.42e-3, slip_ml=(), stiffness=(), pressure_stiffness=()
)


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """Sampling rate, signal to noise of each sensor in dB (34 dB: 2 % of the standard deviation), seed."""

    rate: float = option(83.0, unit="Hz", least=1.0, most=1e5)
    force_db: float = option(40.0, least=-20.0, most=300.0)
    volume_db: float = option(60.0, least=-20.0, most=300.0)
    pressure_db: float = option(50.0, least=-20.0, most=300.0)
    flow_db: float = option(40.0, least=-20.0, most=300.0)
    seed: int = option(2019, least=0)


@dataclass(frozen=True, kw_only=True)
class Relaxation:
    """A standard linear solid: `share` of the static force and pressure fades with the time constant `time`."""

    share: float = option(0.1, least=0.0, most=0.99)
    time: float = option(20.0, unit="s", least=1e-2)


@dataclass(frozen=True, kw_only=True)
class AccumulatorBench:
    """An accumulator on the cylinder: of Table 3.3, or of `coefficients` c1 .. cn, as a fit writes them.

    The rest volume is assumed.
    """

    actuator: str = "Act 1"
    coefficients: tuple[float, ...] = option((), unit="Pa")
    rest_volume: float = option(20 * ML, unit="m^3", least=1e-9)


@dataclass(frozen=True, kw_only=True)
class ValveBench:
    """An orifice between two pressure sensors in a closed circuit; K of Table 3.4's valve 2 by default."""

    coefficient: float = option(3.05e-7, unit="m^3 Pa^-0.5 s^-1", least=1e-12)
    circuit_pressure: float = option(20e3, unit="Pa")


@dataclass(frozen=True, kw_only=True)
class ConeValve:
    """A conical valve of Table 3.5 that opens from its cracking pressure on: q = K sqrt(p) (1 - p_c / p).

    The opening law and K are assumed; the thesis prints the pressures only.
    """

    valve: str = "30 deg, 0.075 in"
    coefficient: float = option(3e-8, unit="m^3 Pa^-0.5 s^-1", least=1e-12)


@dataclass(frozen=True, kw_only=True)
class PressureRamp:
    """Up to `overshoot` times the cracking pressure and back, then the same the other way."""

    seconds: float = option(60.0, unit="s", least=1.0)
    overshoot: float = option(1.6, least=1.05, most=10.0)


@dataclass(frozen=True, eq=False)
class BenchRun:
    """What one experiment's sensors print: time (n,) s, a signal (n,) for each (topic, component).

    truth: what the plant was made of, beyond the scene's own options.
    """

    time_s: Array
    signals: Mapping[tuple[str, str], Array]
    truth: Mapping[str, str] = field(default_factory=dict)


def bender(
    drive: Chirp | Ramp | Staircase, servo: Servo, plant: Plant, relaxation: Relaxation, sensors: Sensors
) -> BenchRun:
    """Run a bender on the cylinder: drive, volume, stroke, pressure and force.

    A ramp ends when the pressure reaches the plant's full pressure (thesis: 101.3 kPa).
    """
    motion = move(servo, drive, sensors.rate)
    force, pressure = respond(motion, plant, relaxation, sensors.rate)
    if isinstance(drive, Ramp) and (pressure >= plant.full_pressure).any():
        samples = int(np.argmax(pressure >= plant.full_pressure)) + 1
        motion, force, pressure = motion.until(samples), force[:samples], pressure[:samples]
    return _run(motion, {("/pressure", "pressure"): pressure, ("/force", "force"): force}, sensors)


def respond(motion: Motion, plant: Plant, relaxation: Relaxation, rate_hz: float) -> tuple[Array, Array]:
    """Return the bender's force [N] and pressure [Pa] without noise, each (n,)."""
    from scipy.signal import lfilter

    from sysid.hysteresis import stop

    x, xdd = motion.volume_m3 / ML, AREA_M2 * motion.acceleration_m_s2 / ML
    full = motion.place_m / motion.place_m.max(initial=1e-9)
    force = plant.cubic * x**3 + plant.square * x**2
    pressure = plant.full_pressure * (full + full**3) / 2
    keep = math.exp(-1 / (rate_hz * relaxation.time))
    if relaxation.share:
        force, pressure = (
            one - relaxation.share * (lfilter([1 - keep], [1, -keep], one - one[0]) + one[0])
            for one in (force, pressure)
        )
    if plant.slip_ml:
        springs = stop(x, plant.slip_ml)
        force = force + springs @ np.array(plant.stiffness)
        pressure = pressure + springs @ np.array(plant.pressure_stiffness)
    return force + plant.inertia * xdd**2 + plant.constant, pressure


def accumulator(drive: Sine, servo: Servo, accumulator: AccumulatorBench, sensors: Sensors) -> BenchRun:
    """Run a volume sine on an accumulator: drive, volume (and its ratio), stroke, pressure."""
    from data.table import table

    published = [table("3.3").value(accumulator.actuator, f"c{n}") for n in (1, 2, 3, 4)]
    coefficients = accumulator.coefficients or published
    motion = move(servo, drive, sensors.rate)
    x = motion.volume_m3 / accumulator.rest_volume
    pressure = np.polynomial.polynomial.polyval(x, [0.0, *coefficients])
    truth = {f"accumulator.c{n}": f"{c!r} Pa" for n, c in enumerate(coefficients, start=1)}
    return _run(motion, {("/pressure", "pressure"): pressure}, sensors, accumulator.rest_volume, truth)


def valve(drive: Steps, servo: Servo, valve: ValveBench, sensors: Sensors) -> BenchRun:
    """Push water through an orifice by steps of voltage: drive, volume, stroke, two pressures."""
    motion = move(servo, drive, sensors.rate)
    flow = AREA_M2 * motion.speed_m_s
    drop = np.sign(flow) * (flow / valve.coefficient) ** 2
    pressures = {
        ("/pressure/1", "pressure"): valve.circuit_pressure + drop / 2,
        ("/pressure/2", "pressure"): valve.circuit_pressure - drop / 2,
    }
    return _run(motion, pressures, sensors)


def cracking(drive: PressureRamp, valve: ConeValve, sensors: Sensors) -> BenchRun:
    """Raise the pressure over a conical valve slowly, forward and then in reverse: pressure drop and flow."""
    from data.table import table

    limits = [table("3.5").value(valve.valve, name) for name in ("forward", "reverse")]
    wanted = drive.seconds * sensors.rate
    if not 100 <= wanted <= MOST_RAMP:
        raise BadInput("[drive] seconds", f"{wanted:g} samples a ramp", f"expected 100 to {MOST_RAMP:g}")
    samples = int(wanted)
    triangle = 1 - np.abs(np.linspace(-1, 1, 2 * samples))
    drop = np.concatenate([sign * drive.overshoot * p * triangle for sign, p in zip((1, -1), limits, strict=True)])
    limit = np.repeat(limits, 2 * samples)
    size = np.abs(drop)
    opening = np.maximum(0.0, 1 - limit / np.maximum(size, 1e-9))
    flow = np.sign(drop) * valve.coefficient * np.sqrt(size) * opening
    truth = {"valve.forward": f"{limits[0]!r} Pa", "valve.reverse": f"{limits[1]!r} Pa"}
    clean = {("/pressure", "pressure"): drop, ("/flow", "flow"): flow}
    return BenchRun(np.arange(len(drop)) / sensors.rate, _noisy(clean, sensors), truth)


def _run(
    motion: Motion,
    signals: Mapping[tuple[str, str], Array],
    sensors: Sensors,
    rest_volume: float | None = None,
    truth: Mapping[str, str] | None = None,
) -> BenchRun:
    noisy = _noisy({("/stroke", "displacement"): motion.place_m, **signals}, sensors)
    measured = AREA_M2 * noisy["/stroke", "displacement"]
    found = {("/drive", "command"): motion.command_v, ("/volume", "volume"): measured, **noisy}
    if rest_volume is not None:
        found["/volume", "ratio"] = 1 + measured / rest_volume
    return BenchRun(motion.time_s, found, truth or {})


def _noisy(clean: Mapping[tuple[str, str], Array], sensors: Sensors) -> dict[tuple[str, str], Array]:
    """Return every signal with its sensor's noise, drawn in order."""
    draw = np.random.default_rng(sensors.seed)
    decibels = {"force": sensors.force_db, "displacement": sensors.volume_db, "pressure": sensors.pressure_db}
    found = {}
    for (topic, component), values in clean.items():
        deviation = float(values.std()) * 10 ** (-decibels.get(component, sensors.flow_db) / 20)
        found[topic, component] = values + deviation * draw.standard_normal(len(values))
    return found
