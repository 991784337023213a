"""The gait: where the robot's parts are over several cycles, from the circuit's periodic state.

The thesis has no model of traction. What is drawn between its four events is therefore a rule, stated in
`walk`; lengths, volumes, pressures and flows are those of the models.
"""

from dataclasses import dataclass

import numpy as np

from catheter.circuit import Circuit
from catheter.drive import SquareWave
from catheter.free import Array, extension
from catheter.hydraulics import Solver
from catheter.locomotion import Events, Stroke, at_events, events, stroke
from catheter.periodic import periodic
from catheter.robot import Extender
from catheter.tuning import EXTENDER, Marks, check_robot
from data.errors import BadInput
from data.options import option

FINE = 4001  # samples of one cycle in which its events are sought: good to 1e-6 s on the thesis's
SUDDEN_S = 0.25  # after each switch of the source, of a cycle of 2 s, frames stand closer


@dataclass(frozen=True, kw_only=True)
class Walk:
    """How long is walked, and into how many frames each cycle is divided."""

    cycles: int = option(3, least=1, most=100)
    frames: int = option(48, least=8, most=2000)


@dataclass(frozen=True, eq=False)
class Gait:
    """n frames of Act 1 to 3 and of valves 1 to 3.

    time_s, within_s (of the cycle), source_pa (n,); volume (V/V_rest), pressure_pa, flow_m3_s (n, 3).
    rear_m, front_m (n,): the extender's ends, the rear one at 0 at first. holds (n, 2): whether the rear and
    the front spiral hold. happened and made: events and stroke of one cycle; advance_m: what a cycle gains.
    """

    time_s: Array
    within_s: Array
    source_pa: Array
    volume: Array
    pressure_pa: Array
    flow_m3_s: Array
    rear_m: Array
    front_m: Array
    holds: Array
    happened: Events
    made: Stroke
    marks: Marks
    period_s: float

    @property
    def advance_m(self) -> float:
        """The smaller of push and pull: what a cycle gains without slip of the spiral that holds alone."""
        return min(self.made.stroke_m, self.made.pull_m)


def walk(circuit: Circuit, source: SquareWave, marks: Marks, extender: Extender, options: Walk | None = None) -> Gait:
    """Return the periodic gait, repeated. Raises CatheterError for an event that does not happen, or out of order.

    The extender is as long as its fibres make it at every instant. The rear spiral holds from B to E, the
    front one from C to F. Is the push (B to C) the smaller travel, the front moves between B and C only,
    by the stroke; is the pull (E to F), the rear moves between E and F only. What the extender still
    gains or loses while both hold, or neither, is given to the other end: slip, of which no model is known.
    """
    check_robot(circuit)
    chosen = options or Walk()
    run = periodic(circuit, source.drive(), solver=Solver(tolerance=1e-9)).run
    fine = np.linspace(0.0, source.period, FINE)
    volume = run.at(fine)
    happened = events(fine, volume, marks)
    times = np.array(list(vars(happened).values()))
    if not (np.diff(times) > 0).all():
        found = ", ".join(f"{name} {t:.4f} s" for name, t in zip("BCEF", times, strict=True))
        raise BadInput("gait", f"its events come as {found}", "B, C, E, F in turn (thesis Fig 3.3); tune the valves")
    made = stroke(at_events(fine, volume[:, EXTENDER], happened), extender)
    once = _frames(source, times, chosen.frames)
    time_s = (once + source.period * np.arange(chosen.cycles)[:, None]).ravel()
    cycle = np.repeat(np.arange(chosen.cycles), len(once))
    tiled = np.tile(once, chosen.cycles)
    state = run.at(tiled)
    length = extender.length * extension(extender.angle, state[:, EXTENDER])
    rear, front = _places(tiled, length, times, made)
    advance = cycle * min(made.stroke_m, made.pull_m)
    return Gait(
        time_s=time_s,
        within_s=tiled,
        source_pa=source.drive().at(tiled),
        volume=state,
        pressure_pa=run.pressure_pa(tiled),
        flow_m3_s=run.flow_m3_s(tiled),
        rear_m=rear + advance - rear[0],
        front_m=front + advance - rear[0],
        holds=np.stack([_within(tiled, times[0], times[2]), _within(tiled, times[1], times[3])], axis=1),
        happened=happened,
        made=made,
        marks=marks,
        period_s=source.period,
    )


def _frames(source: SquareWave, times: Array, count: int) -> Array:
    """Return the times of one cycle's frames, its end left out: a third evenly, the rest where things are quick."""
    quick = SUDDEN_S * source.period / 2 * np.linspace(0, 1, count // 3) ** 2
    starts = (0.0, source.duty * source.period)
    even = np.linspace(0, source.period, count - 2 * len(quick), endpoint=False)
    before = np.array([starts[1], source.period]) - 1e-5 * source.period  # plots draw straight lines between frames
    found = np.unique(np.concatenate([even, times, before, *(start + quick for start in starts)]))
    apart = np.append(True, np.diff(found) > 1e-9 * source.period)
    return np.asarray(found[apart & (found < source.period)])


def _places(time_s: Array, length: Array, times: Array, made: Stroke) -> tuple[Array, Array]:
    """Return the extender's rear and front end (n,) [m] in one cycle, by the rule of `walk`."""
    b, c, e, f = (made.extender.length * l1 for l1 in made.stretch)
    if made.stroke_m <= made.pull_m:
        front = np.where(time_s < times[0], b, np.where(time_s <= times[1], length, c))
        return front - length, front
    rear = -np.where(time_s < times[2], e, np.where(time_s <= times[3], length, f))
    return rear, rear + length


def _within(time_s: Array, first: float, last: float) -> Array:
    return np.asarray((time_s >= first) & (time_s < last))


def phases(gait: Gait, times: Array) -> Array:
    """Return +1 where the extender pushes, from B to C of `times` (4,) [s], -1 where it pulls, from E to F, else 0."""
    return _within(gait.within_s, *times[:2]) * 1.0 - _within(gait.within_s, *times[2:])


def advanced(gait: Gait, times: Array, step_m: float) -> Array:
    """Return how far a robot has got that moves `step_m` in each cycle, evenly between `times` B and C (2,) [s]."""
    cycle = np.rint((gait.time_s - gait.within_s) / gait.period_s)
    return np.asarray(step_m * (cycle + np.clip((gait.within_s - times[0]) / (times[1] - times[0]), 0, 1)))
