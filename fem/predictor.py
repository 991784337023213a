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
class Stand:
    """A converged state on a path, at a parameter (pressure [Pa] or volume [m^3]), with its motion per parameter.

    motion (k,) of the unknowns, rise of the load. The tangent was taken at this state or one close to it.
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
    def velocity(self) -> Array:
        """Displacements of all nodes per parameter (n, 3)."""
        return self.system.field(self.state.x, self.motion)

    @cached_property
    def stresses(self) -> tuple[Array, Array]:
        """What a tangent here holds (e, g, 7), and its change per parameter."""
        return self.system.body.stresses(self.state.x, self.velocity)


def predicted(before: Stand | None, stand: Stand, goal: float) -> State:
    """Return the state expected at a parameter, from the stand there is and the one before it."""
    system, step = stand.system, goal - stand.parameter
    load = stand.state.load + stand.rise * step
    shift, tied = system.shift(stand.state, load), system.body.mesh.tied
    if shift is not None:
        move = stand.motion * step - stand.tangent.solve((stand.tangent.across @ shift)[:, None])[:, 0]
        return system.moved(stand.state, move, load, shift=shift)
    held, change = stand.stresses
    if before is None or abs(step) > FARTHEST * abs(stand.parameter - before.parameter):
        state = system.moved(stand.state, stand.motion * step, load, hold=False)
        return State(state.x, load, held + step * change)
    bend = _bend(before, stand, step, before.state.x, stand.state.x, before.velocity, stand.velocity)
    if np.abs(bend).max() > MOST_BEND * np.abs(step * stand.velocity).max():
        return predicted(None, stand, goal)
    x = stand.state.x + step * stand.velocity + bend
    x[tied] = rigid.fitted(stand.state.x[tied], x[tied])
    first, first_change = before.stresses
    held = held + step * change + _bend(before, stand, step, first, held, first_change, change)
    if stand.rise != 1.0:
        load += float(_bend(before, stand, step, before.state.load, stand.state.load, before.rise, stand.rise))
    return State(x, load, held)


def _bend(before: Stand, stand: Stand, step: float, *ends: Array | float) -> Array:
    """Return by how much the cubic through values and slopes at both ends leaves the second's tangent, a step on."""
    value0, value1, slope0, slope1 = (np.asarray(end) for end in ends)
    back = before.parameter - stand.parameter
    # value1 + slope1 s + a s^2 + b s^3 through value0, slope0 at s = back
    off, off_slope = value0 - value1 - slope1 * back, slope0 - slope1
    a = (3 * off / back - off_slope) / back
    b = (off_slope - 2 * off / back) / back**2
    return np.asarray(step**2 * (a + step * b))
