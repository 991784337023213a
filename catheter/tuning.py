"""Tuning the valves: the events of a cycle, the objective on them, its exact slope, maps and optima.

Events of the three-segment robot (thesis Fig 3.3), as volume coefficients pass two levels:
B: the first actuator is anchored, C: the last one touches, E: the first one lets go, F: the last
one is no longer anchored. The extender between them should move between B and C, and E and F.
"""

from dataclasses import dataclass

import numpy as np

from catheter.circuit import Circuit
from catheter.drive import SquareWave
from catheter.hydraulics import Solver
from catheter.periodic import periodic
from data.errors import BadInput, DidNotConverge
from data.options import option
from data.signal import Array

NAMES = ("tB", "tC", "tE", "tF")
FIRST, EXTENDER, LAST = range(3)


@dataclass(frozen=True, kw_only=True)
class Marks:
    """Volume coefficients at which a spiral touches the cannula and is anchored in it, and the objective.

    Both are inputs: the thesis prints 1.30 and, for contact, 1.13 in its methods and 1.12 in its
    Fig 3.13. product: J = a^2 + b^2 - (a - b)^2 = 2ab (thesis eq. 3.24); equal: a^2 + b^2 - |a - b|,
    where equal strokes weigh more. a and b are magnitudes: with signs as printed in (3.22), the
    largest J would be 0.
    """

    anchored: float = option(1.30, least=1.0, most=1e3)
    contact: float = option(1.13, least=1.0, most=1e3)
    objective: str = option("product", choices=("product", "equal"))

    def levels(self) -> tuple[Array, Array]:
        """Return the watched state columns (4,) and, (2, 4), direction and level in x of events B, C, E, F."""
        a, c = self.anchored - 1.0, self.contact - 1.0
        return np.array([FIRST, LAST, FIRST, LAST]), np.array([[1.0, 1.0, -1.0, -1.0], [a, c, c, a]])


@dataclass(frozen=True, eq=False)
class Score:
    """Events and objective of C cycles, each (C,) or (C, 4) for B, C, E, F; NaN where there is no such event."""

    events_s: Array
    extender: Array
    forward: Array
    reverse: Array
    objective: Array
    cycles: Array


@dataclass(frozen=True, eq=False)
class Slope:
    """J and its derivatives by the flow coefficients K (N,), relative stiffnesses (N,) and the period."""

    objective: float
    coefficient: Array
    stiffness: Array
    period: float


def score_of(marks: Marks, events_s: Array, extender: Array, cycles: Array) -> Score:
    """Return the score of events (C, 4) and the extender's volume there.

    a = |V2(C) - V2(B)| if C follows B, b = |V2(E) - V2(F)|; a term whose event is missing is 0.
    """
    ordered = events_s[:, 1] > events_s[:, 0]
    forward = np.where(ordered, np.abs(extender[:, 1] - extender[:, 0]), 0.0)
    reverse = np.nan_to_num(np.abs(extender[:, 2] - extender[:, 3]))
    together = 2 * forward * reverse
    if marks.objective == "equal":
        together = forward**2 + reverse**2 - np.abs(forward - reverse)
    return Score(events_s, extender, forward, reverse, together, cycles)


def check_robot(circuit: Circuit) -> None:
    """Raise BadInput unless the circuit has the three segments that the events are about."""
    if len(circuit.segments) != 3:
        raise BadInput(
            "circuit", f"has {len(circuit.segments)} segments", "the events are those of front, extender, rear"
        )


def evaluate(circuit: Circuit, source: SquareWave, marks: Marks, solver: Solver | None = None) -> Score:
    """Return events and objective (1,) of the periodic cycle. Raises as `periodic`."""
    check_robot(circuit)
    orbit = periodic(circuit, source.drive(), solver=solver or Solver(tolerance=1e-9))
    events, extender = np.full((1, 4), np.nan), np.full((1, 4), np.nan)
    columns, (directions, levels) = marks.levels()
    for j in range(4):
        times = orbit.run.crossings(int(columns[j]), 1.0 + levels[j], rising=directions[j] > 0)
        if len(times):
            events[0, j], extender[0, j] = times[0], orbit.run.at(times[0])[0, EXTENDER]
    return score_of(marks, events, extender, np.array([orbit.cycles]))


def slope(circuit: Circuit, source: SquareWave, marks: Marks, solver: Solver | None = None) -> Slope:
    """Return dJ/dK, dJ/d(relative stiffness) and dJ/dT of the periodic cycle, exact for the numbers computed.

    The cycle's first state depends on a parameter p by dx0/dp = (1 - dx(T)/dx0)^-1 dx(T)/dp; an
    event of column s moves by dt/dp = -(dx_s/dp) / (dx_s/dt). dJ/dT needs nothing new: dx/dt is
    linear in all K together, so a longer period is a larger K. Raises as `periodic`.
    """
    from catheter import circuit_kernel as kernel

    check_robot(circuit)
    coefficients = np.array([segment.valve.coefficient for segment in circuit.segments])
    if not (coefficients > 0).all():
        raise BadInput("circuit", f"a valve is closed: K = {coefficients}", "no derivative by a closed valve's K")
    solver, drive, n = solver or Solver(tolerance=1e-9), source.drive(), len(circuit.segments)
    orbit = periodic(circuit, drive, solver=solver)
    start = np.vstack([orbit.run.volume[0] - 1.0, np.eye(n), np.zeros((2 * n, n))])
    tangent = np.vstack([np.zeros((n, 2 * n)), np.eye(2 * n)])
    status, where, steps, _, _, _, state, dense = kernel.integrate(
        *(circuit.table(), drive.breaks_s, drive.pieces, start.ravel(), tangent, solver.tolerance, solver.most_steps)
    )
    if status != kernel.DONE:
        raise DidNotConverge(f"derivatives of the cycle: status {status}, segment {where}; lower the tolerance")
    end = state[steps].reshape(1 + 3 * n, n)
    by_start, by_parameter = end[1 : 1 + n].T, end[1 + n :].T
    try:
        first = np.linalg.solve(np.eye(n) - by_start, by_parameter)
    except np.linalg.LinAlgError as error:
        raise DidNotConverge("derivatives of the cycle: its state is not unique; open valves that stay shut") from error
    value, change = np.full(4, np.nan), np.zeros((4, 2 * n))
    order = np.full(4, np.nan)
    columns, (directions, levels) = marks.levels()
    for j in range(4):
        i, a = kernel.crossing(state, dense, steps, columns[j], levels[j], directions[j] > 0)
        if i < 0:
            continue
        here = np.array([kernel.between(state, dense, i, a, c) for c in range(state.shape[1])])
        order[j] = i + a
        y, rate = here[:, 0].reshape(1 + 3 * n, n), here[:n, 1]
        total = y[1 + n :].T + y[1 : 1 + n].T @ first
        value[j], sees = y[0, EXTENDER], int(columns[j])
        change[j] = total[EXTENDER] - rate[EXTENDER] * total[sees] / rate[sees]
    return _slope_of(circuit, source.period, marks, order, (value, change))


def _slope_of(circuit: Circuit, period: float, marks: Marks, order: Array, extender: tuple[Array, Array]) -> Slope:
    """Return J's slope from the order of the events, and the extender's volume there and its relative slopes."""
    value, change = extender
    score = score_of(marks, order[None], value[None], np.zeros(1))
    a, b = float(score.forward[0]), float(score.reverse[0])
    da = np.sign(value[1] - value[0]) * (change[1] - change[0]) if a > 0 else 0 * change[0]
    db = np.sign(value[2] - value[3]) * (change[2] - change[3]) if b > 0 else 0 * change[0]
    total = 2 * (a * db + b * da)
    if marks.objective == "equal":
        total = 2 * a * da + 2 * b * db - np.sign(a - b) * (da - db)
    n = len(circuit.segments)
    coefficients = np.array([segment.valve.coefficient for segment in circuit.segments])
    by_coefficient = total[:n] / coefficients
    return Slope(float(score.objective[0]), by_coefficient, total[n:], float(total[:n].sum()) / period)
