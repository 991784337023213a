"""Along a path of loads: predictor, Newton, cut-back; pressure or volume prescribed, through limit points.

A step under pressure control is accepted only if the volume it gained is what the compliance dV/dp
before it foretold, within a factor: a jump over a limit point to another branch is not, however
small the step before it, because the compliance has no bound there but the gap between branches is finite.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from data.errors import BadInput, DidNotConverge
from data.signal import Array
from fem.equilibrium import State, System, Tangent

PRESSURE, VOLUME = "pressure", "volume"
SMALL_LOAD = 1e-3  # of the softest shear modulus: pressures below it do not make the residual's scale smaller
NEAR = 1e-5  # the residual over the load below which a correction may be the last
MOST_CHANGE = 2.5  # a sub-step's gain in volume over the gain foretold


@dataclass(frozen=True, eq=False)
class Point:
    """An equilibrium: positions x (n, 3) [m], load (the pressure [Pa]), cavity volume [m^3], strain energy [J].

    compliance is dV/dp [m^3/Pa]. negative: negative pivots of the tangent, 0 where it is stable
    under that load. reaction (n, 3): forces on the nodes, 0 where they are free [N]. residuals: of every
    iteration since the requested load before, over the load.
    """

    x: Array
    load: float
    volume: float
    energy: float
    compliance: float
    negative: int
    reaction: Array
    residuals: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class _Stand:
    """A converged state, its tangent, and how it moves per unit of load: compliance is dV/dp [m^3/Pa]."""

    state: State
    tangent: Tangent
    volume: float
    motion: Array

    @property
    def compliance(self) -> float:
        return float(-self.tangent.slope @ self.motion)


class _Cut(Exception):
    """A sub-step that must be smaller, and why."""


def follow(system: System, loads: Iterable[float], control: str = PRESSURE, start: Point | None = None) -> list[Point]:
    """Return the equilibria at exactly these loads in turn: pressures [Pa] or cavity volumes [m^3].

    They are reached from rest, or from an equilibrium found before. Raises BadInput for loads
    that are no numbers or a cavity that cannot be counted, DidNotConverge where the path ends:
    under pressure control at a limit point, or where it loses stability.
    """
    targets = [float(load) for load in loads]
    if not targets or not np.isfinite(targets).all():
        raise BadInput("loads", f"are {targets}", "expected finite numbers")
    if control not in (PRESSURE, VOLUME):
        raise BadInput("control", f"is {control!r}", f"expected {PRESSURE!r} or {VOLUME!r}")
    if control == VOLUME and not system.closed:
        raise BadInput("control", "is 'volume', but no closed cavity is the only load", "control the pressure")
    state = system.rest()
    if start is not None:
        state = State(start.x, start.load, system.body.linearised(start.x, np.zeros_like(start.x)))
    stand = _stand(system, state, system.tangent(state))
    points = []
    for target in targets:
        stand, residuals = _reach(system, stand, target, control)
        state, tangent = stand.state, stand.tangent
        numbers = (state.load, stand.volume, tangent.energy, stand.compliance, tangent.negative)
        points.append(Point(state.x, *numbers, tangent.reaction, tuple(residuals)))
    return points


def limit_point(system: System, before: Point, after: Point) -> Point:
    """Return the point of greatest or least pressure between two found under volume control, by root of dp/dV.

    Raises BadInput unless dp/dV differs in sign between them.
    """
    from scipy.optimize import brentq

    if before.compliance * after.compliance > 0:
        raise BadInput("limit point", "dp/dV has one sign at both ends", "give two points around it, volume control")
    found = {before.volume: before, after.volume: after}

    def nearest(volume: float) -> Point:
        return found[min(found, key=lambda known: abs(known - volume))]

    def steepness(volume: float) -> float:
        if volume not in found:
            found[volume] = follow(system, [volume], VOLUME, nearest(volume))[0]
        return 1 / found[volume].compliance

    return nearest(float(brentq(steepness, before.volume, after.volume, rtol=1e-9)))


def _stand(system: System, state: State, tangent: Tangent) -> _Stand:
    motion = tangent.solve(-tangent.slope[:, None])[:, 0]
    return _Stand(state, tangent, system.body.fluid(state.x)[1], motion)


def _load(stand: _Stand, control: str) -> float:
    return stand.state.load if control == PRESSURE else stand.volume


def _reach(system: System, stand: _Stand, target: float, control: str) -> tuple[_Stand, list[float]]:
    """Step from a stand to a load, in as many sub-steps as it takes."""
    residuals: list[float] = []
    start = _load(stand, control)
    whole = target - start
    step, now = whole, start
    while now != target:
        step = min(step, target - now, key=abs)
        per_load = stand.motion if control == PRESSURE else stand.motion / stand.compliance
        reach = float(np.abs(per_load).max()) * abs(step) / (system.newton.most_move * system.extent)
        step /= max(1, int(np.ceil(reach)))
        goal = target if abs(target - now - step) < 1e-9 * abs(whole) else now + step
        try:
            stand = _step(system, stand, goal, control, residuals)
        except (_Cut, DidNotConverge) as error:
            step /= 2
            if abs(step) < system.newton.smallest * abs(whole):
                raise _refusal(system, stand, control, target, error) from error
            continue
        now = goal
        step *= 2
    return stand, residuals


def _predicted(system: System, stand: _Stand, goal: float, control: str) -> State:
    """Return the state at a load by the tangent of the last one."""
    state = stand.state
    rise = goal - state.load if control == PRESSURE else (goal - stand.volume) / stand.compliance
    load = goal if control == PRESSURE else state.load + rise
    shift, move = system.shift(state, load), stand.motion * rise
    if shift is not None:
        move = move - stand.tangent.solve((stand.tangent.across @ shift)[:, None])[:, 0]
    return system.moved(state, move, load, shift)


def _step(system: System, stand: _Stand, goal: float, control: str, residuals: list[float]) -> _Stand:
    """Return the equilibrium at one load. Raises _Cut or DidNotConverge where that is not near."""
    state = _predicted(system, stand, goal, control)
    longest = system.newton.most_move * system.extent
    for _ in range(system.newton.most_steps):
        tangent = system.tangent(state)
        scale = _scale(system, state, tangent)
        residuals.append(float(np.linalg.norm(tangent.residual)) / scale)
        found = tangent.solve(-np.stack([tangent.residual, tangent.slope], axis=1))
        move, extra, missing = found[:, 0], 0.0, 0.0
        if control == VOLUME:
            missing = goal - tangent.volume
            extra = (missing + float(tangent.slope @ move)) / float(-tangent.slope @ found[:, 1])
            move = move + extra * found[:, 1]
        largest = float(np.abs(move).max())
        if not np.isfinite(largest):
            raise _Cut("the displacements are not finite")
        state = system.moved(state, move * min(1.0, longest / (largest or 1.0)), state.load + extra)
        there = residuals[-1] <= max(system.newton.tolerance, system.body.noise / scale)
        there = there or (residuals[-1] <= NEAR and _settled(system, state, scale, residuals))
        if there and abs(missing) <= 1e-6 * abs(goal):
            total, energy = system.forces(state)
            tangent = replace(tangent, reaction=total, energy=energy)
            reached = _Stand(state, tangent, system.body.fluid(state.x)[1], found[:, 1])
            _check(system, stand, reached, control)
            return reached
    raise _Cut(f"residual {residuals[-1]:.1e} > {system.newton.tolerance:.0e} of the load after {len(residuals)} steps")


def _settled(system: System, state: State, scale: float, residuals: list[float]) -> bool:
    """Return whether a state needs no further tangent: its residual is a tenth of the tolerance."""
    found = float(np.linalg.norm(system.reduce(state.x, system.forces(state)[0]))) / scale
    settled = found <= 0.1 * system.newton.tolerance
    if settled:
        residuals.append(found)
    return settled


def _scale(system: System, state: State, tangent: Tangent) -> float:
    """Return what a residual is measured against [N]: the load, or the reactions where nodes are moved."""
    if system.place is not None:
        return float(np.linalg.norm(tangent.reaction[system.body.mesh.fixed])) or 1.0
    least = SMALL_LOAD * system.body.softest if system.dead is None else 0.0
    return max(abs(state.load), least) * float(np.linalg.norm(tangent.slope)) or 1.0


def _check(system: System, before: _Stand, after: _Stand, control: str) -> None:
    """Raise _Cut where a step under pressure control left the stable path it came from."""
    if control == VOLUME:
        return
    if after.tangent.negative > before.tangent.negative:
        raise _Cut(f"{after.tangent.negative} negative pivot(s): it would be unstable")
    if not system.closed:
        return
    gained = (after.volume - before.volume) / ((after.state.load - before.state.load) or 1.0)
    if not 1 / MOST_CHANGE <= gained / before.compliance <= MOST_CHANGE:
        raise _Cut("the volume is not where the tangent saw it: another branch?")


def _refusal(system: System, stand: _Stand, control: str, target: float, error: Exception) -> DidNotConverge:
    if control == VOLUME:
        at = f"{1e6 * stand.volume:.6g} mL on the way to {1e6 * target:.6g} mL"
        return DidNotConverge(f"inflation under volume control stops at {at}: {error}; try smaller volume steps")
    if not system.closed:
        at = f"{stand.state.load:.6g} on the way to {target:.6g}"
        return DidNotConverge(f"equilibrium stops at a load of {at}: {error}; try smaller steps, or a finer mesh")
    at = f"{stand.state.load / 1e3:.6g} kPa on the way to {target / 1e3:.6g} kPa"
    return DidNotConverge(
        f"inflation under pressure control stops at {at}: {error}; no stable equilibrium was found beyond "
        "(a limit point?): use control='volume', which passes it"
    )
