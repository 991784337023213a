"""Where the next equilibrium of a path is expected: Hermite's cubic through the last two and their tangents."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from data.signal import Array
from fem import rigid
from fem.equilibrium import Balance, State, System, Tangent

FARTHEST = 2.5  # how far a cubic is trusted, in steps that it was found from
MOST_BEND = 0.5  # the most that it may leave the tangent by, over the tangent's own way


@dataclass(frozen=True, eq=False)
class Mark:
    """A converged state at a parameter, the pressure [Pa] or the volume [m^3], and its slopes over that.

    x, velocity (n, 3); load, rise; held, change (e, g, 7): the stresses that a tangent there holds.
    """

    parameter: float
    x: Array
    velocity: Array
    load: float
    rise: float
    held: Array
    change: Array


@dataclass(frozen=True, eq=False)
class Stand:
    """A converged state on a path with its tangent, taken there or close by; motion (k,) of the unknowns, rise
    of the load per parameter.
    """

    system: System
    state: State
    here: Balance
    tangent: Tangent
    parameter: float
    motion: Array
    rise: float

    @property
    def compliance(self) -> float:
        """dV/dp [m^3/Pa]."""
        return float(-self.tangent.slope @ self.motion) / self.rise

    @cached_property
    def mark(self) -> Mark:
        """What a predictor needs of it."""
        x, load = self.state.x, self.state.load
        velocity = self.system.field(x, self.motion)
        return Mark(self.parameter, x, velocity, load, self.rise, *self.system.body.stresses(x, velocity))


def predicted(before: Mark | None, stand: Stand, goal: float) -> State:
    """Return the state expected at a parameter, from the stand there is and the mark before it."""
    system, step, tied = stand.system, goal - stand.parameter, stand.system.body.mesh.tied
    load = stand.state.load + stand.rise * step
    shift = system.shift(stand.state, load)
    if shift is not None:
        move = stand.motion * step - stand.tangent.solve((stand.tangent.across @ shift)[:, None])[:, 0]
        return system.moved(stand.state, move, load, shift=shift)
    mark = stand.mark
    if before is None or abs(step) > FARTHEST * abs(stand.parameter - before.parameter):
        return _straight(stand, step, load)
    bend = _bend(step, before, mark, before.x, mark.x, before.velocity, mark.velocity)
    if np.abs(bend).max() > MOST_BEND * np.abs(step * mark.velocity).max():
        return _straight(stand, step, load)
    x = mark.x + step * mark.velocity + bend
    x[tied] = rigid.fitted(mark.x[tied], x[tied])
    held = mark.held + step * mark.change
    held += _bend(step, before, mark, before.held, mark.held, before.change, mark.change)
    load += float(_bend(step, before, mark, before.load, mark.load, before.rise, mark.rise))
    return State(x, goal if stand.parameter == stand.state.load else load, held)


def _straight(stand: Stand, step: float, load: float) -> State:
    state = stand.system.moved(stand.state, stand.motion * step, load, hold=False)
    return State(state.x, load, stand.mark.held + step * stand.mark.change)


def _bend(step: float, before: Mark, mark: Mark, *ends: Array | float) -> Array:
    """Return by how much the cubic through values and slopes at both marks leaves the second's tangent, a step on."""
    value0, value1, slope0, slope1 = (np.asarray(end) for end in ends)
    back = before.parameter - mark.parameter
    # value1 + slope1 s + a s^2 + b s^3 through value0, slope0 at s = back
    off, off_slope = value0 - value1 - slope1 * back, slope0 - slope1
    a = (3 * off / back - off_slope) / back
    b = (off_slope - 2 * off / back) / back**2
    return np.asarray(step**2 * (a + step * b))
