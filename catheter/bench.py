"""The simulated bench: a linear actuator fills a soft bender, whose tip presses on a load cell.

Volume, pressure and force are what the laboratory's sensors would print. The bender's force is
the published polynomial (thesis eq. 3.35, volume in mL) with springs that slip for its
hysteresis; the plant from command to piston is a lagging, speed-limited servo. All of it is
simulation: published where the thesis prints a number, assumed where it does not.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from data.errors import BadInput
from data.options import option
from data.signal import Array

ML = 1e-6
MOST_STEPS = 10_000_000


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """What the command does: a chirp, then a staircase of fillings (thesis Fig 3.25, eq. 3.25).

    The thesis's staircase rises by 47 mV a cycle to 4.71 V and its chirp lasts 1800 s; `levels`
    and `chirp` shorten both for a recording that fits in the repository.
    """

    amplitude: float = option(4.71, unit="V", least=0.0)
    levels: int = option(5, least=0, most=1000)
    fill: float = option(12.0, unit="s", least=0.1)
    drain: float = option(3.0, unit="s", least=0.1)
    chirp: float = option(45.0, unit="s", least=0.0)
    chirp_from: float = option(0.05, unit="Hz", least=1e-4)
    chirp_to: float = option(2.0, unit="Hz", least=1e-4)


@dataclass(frozen=True, kw_only=True)
class Bench:
    """Cylinder, servo and sampling: 1-1/16 in bore, 2 in stroke, 83 Hz are the thesis's.

    bandwidth and lag (of the servo's position and speed) and speed (the most it pushes) are
    assumed, so that a 5 Hz chirp moves about a millilitre.
    """

    stroke_volume: float = option(29.06 * ML, unit="m^3", least=1e-9)
    rate: float = option(83.0, unit="Hz", least=1.0, most=1e5)
    bandwidth: float = option(5.0, unit="Hz", least=0.01)
    lag: float = option(0.02, unit="s", least=1e-3)
    speed: float = option(10 * ML, unit="m^3/s", least=1e-9)


@dataclass(frozen=True, kw_only=True)
class Plant:
    """Force and pressure of the bender over its volume x in mL.

    force = cubic x^3 + square x^2 + inertia (d2x/dt2)^2 + constant + sum k_i stop_i(x), in N: the
    polynomial is the thesis's F_unc; slip limits (mL) and stiffnesses (N/mL) are assumed. Pressure
    rises to `full_pressure` at full stroke, half linearly and half with the cube of the volume,
    and carries the slipping springs' share as `pressure_stiffness` (Pa/mL); assumed too.
    """

    cubic: float = 7.88e-4
    square: float = 3.47e-3
    inertia: float = 4.73e-7
    constant: float = 1.22e-2
    slip_ml: tuple[float, ...] = (0.3, 1.5, 5.0)
    stiffness: tuple[float, ...] = (0.4, 0.2, 0.1)
    full_pressure: float = option(101.3e3, unit="Pa", least=0.0)
    pressure_stiffness: tuple[float, ...] = (1500.0, 800.0, 300.0)


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Standard deviations of the sensors and the steps of their converters; seed of the draw."""

    volume: float = option(0.01 * ML, unit="m^3", least=0.0)
    pressure: float = option(150.0, unit="Pa", least=0.0)
    force: float = option(0.02, unit="N", least=0.0)
    volume_step: float = option(0.005 * ML, unit="m^3", least=1e-15)
    pressure_step: float = option(100.0, unit="Pa", least=1e-6)
    force_step: float = option(0.005, unit="N", least=1e-9)
    seed: int = option(2019, least=0)


@dataclass(frozen=True, eq=False)
class Run:
    """One simulated run, sampled: time (n,) s, command V, volume m^3, pressure Pa, force N."""

    time_s: Array
    command_v: Array
    volume_m3: Array
    pressure_pa: Array
    force_n: Array


def command_v(schedule: Schedule, time_s: float) -> tuple[float, bool]:
    """Return (volts, whether they ask for a speed) at a time; else they ask for a position.

    Chirp: a sin(2 pi f_i L [exp(t/L) - 1]), L = t_f / ln(f_f / f_i) (thesis eq. 3.25, 3.26).
    """
    if time_s < schedule.chirp:
        if schedule.chirp_to == schedule.chirp_from:
            phase = 2 * math.pi * schedule.chirp_from * time_s
        else:
            length = schedule.chirp / math.log(schedule.chirp_to / schedule.chirp_from)
            phase = 2 * math.pi * schedule.chirp_from * length * math.expm1(time_s / length)
        return schedule.amplitude * math.sin(phase), False
    level, within = divmod(time_s - schedule.chirp, schedule.fill + schedule.drain)
    volts = schedule.amplitude * (level + 1) / max(1, schedule.levels)
    return (volts, True) if within < schedule.fill else (-schedule.amplitude, True)


def _motion(schedule: Schedule, bench: Bench, substeps: int, samples: int) -> Iterator[tuple[float, float, float]]:
    """Yield (command, volume, its second derivative) at every sample, by semi-implicit Euler.

    speed' = (wanted speed - speed) / lag, volume' = speed; the wanted speed is the command's share
    of `speed` in a staircase, and towards the command's place in a chirp; the cylinder's ends stop it.
    """
    step = 1 / (bench.rate * substeps)
    volume = speed = 0.0
    for index in range(samples * substeps):
        volts, asks_speed = command_v(schedule, index * step)
        if asks_speed:
            full = volts / schedule.amplitude if schedule.amplitude else 0.0
            wanted = bench.stroke_volume / schedule.fill * full if volts > 0 else -bench.speed
        else:
            target = bench.stroke_volume * (0.5 + 0.5 * volts / schedule.amplitude if schedule.amplitude else 0.5)
            wanted = 2 * math.pi * bench.bandwidth * (target - volume)
        wanted = max(-bench.speed, min(bench.speed, wanted))
        at_end = (volume <= 0 and wanted < 0) or (volume >= bench.stroke_volume and wanted > 0)
        acceleration = ((0.0 if at_end else wanted) - speed) / bench.lag
        if index % substeps == 0:
            yield volts, volume, acceleration
        speed += acceleration * step
        volume = max(0.0, min(bench.stroke_volume, volume + speed * step))


def _check(schedule: Schedule, bench: Bench, plant: Plant) -> int:
    """Return how many samples a run has; raise BadInput for a run that cannot be."""
    springs = len(plant.slip_ml), len(plant.stiffness), len(plant.pressure_stiffness)
    if len(set(springs)) > 1 or min(plant.slip_ml, default=1.0) <= 0:
        raise BadInput("[plant]", f"{springs} slip limits, stiffnesses and pressure stiffnesses", "give as many, > 0")
    if max(schedule.chirp_from, schedule.chirp_to) > bench.rate / 2:
        raise BadInput("[drive]", f"chirp up to {schedule.chirp_to:g} Hz", f"at most half of {bench.rate:g} Hz")
    seconds = schedule.levels * (schedule.fill + schedule.drain) + schedule.chirp
    substeps = _substeps(bench)
    if not 2 <= seconds * bench.rate * substeps <= MOST_STEPS:
        what = f"{seconds:g} s at {bench.rate:g} Hz in {substeps} steps a sample"
        raise BadInput("[drive]", what, f"expected at least 2 samples and at most {MOST_STEPS:g} steps")
    return int(seconds * bench.rate)


def _substeps(bench: Bench) -> int:
    """Return how many steps a sample needs: explicit steps stay below a quarter of the fastest time constant."""
    fastest = min(bench.lag, 1 / (2 * math.pi * bench.bandwidth))
    return max(12, math.ceil(4 / (bench.rate * fastest)))


def _response(plant: Plant, bench: Bench, x: Array, acceleration: Array) -> tuple[Array, Array]:
    """Return the bender's force and pressure over its volume x (mL) and d2x/dt2 (mL/s^2)."""
    from sysid.hysteresis import stop

    slipping = stop(x, plant.slip_ml)
    force = plant.cubic * x**3 + plant.square * x**2 + plant.inertia * acceleration**2 + plant.constant
    full = x * ML / bench.stroke_volume
    pressure = plant.full_pressure * (full + full**3) / 2
    return force + slipping @ np.array(plant.stiffness), pressure + slipping @ np.array(plant.pressure_stiffness)


def simulate(schedule: Schedule, bench: Bench, plant: Plant, noise: Noise, substeps: int | None = None) -> Run:
    """Return the sampled run: servo motion, the bender's force and pressure, noise, converter steps.

    Raises BadInput for options that do not fit together, too many steps, or a result that is not finite.
    """
    samples = _check(schedule, bench, plant)
    volts, volume, acceleration = np.fromiter(
        _motion(schedule, bench, substeps or _substeps(bench), samples), dtype=np.dtype((float, 3)), count=samples
    ).T
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused below
        force, pressure = _response(plant, bench, volume / ML, acceleration / ML)
    if not all(np.isfinite(clean).all() for clean in (volume, force, pressure)):
        raise BadInput("[plant] or [bench]", "force, volume or pressure is not finite", "choose smaller values")
    draw = np.random.default_rng(noise.seed)

    def measured(clean: Array, deviation: float, step: float) -> Array:
        with np.errstate(over="ignore"):  # refused below
            return np.asarray(np.rint((clean + deviation * draw.standard_normal(samples)) / step) * step)

    run = Run(
        np.arange(samples) / bench.rate,
        np.rint(volts * 1e3) / 1e3,
        measured(volume, noise.volume, noise.volume_step),
        measured(pressure, noise.pressure, noise.pressure_step),
        measured(force, noise.force, noise.force_step),
    )
    if not all(np.isfinite(column).all() for column in (run.volume_m3, run.pressure_pa, run.force_n)):
        raise BadInput("[noise]", "makes values that are not finite", "choose a smaller deviation or a larger step")
    return run
