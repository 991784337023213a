"""Along a path of loads: predictor, Newton, cut-back; pressure or volume prescribed, through limit points.

A step is taken on trust only if the volume it gained lies between what the compliances dV/dp at
its ends allow (the mean value theorem): a jump to another branch does not.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from data.errors import BadInput, DidNotConverge
from data.signal import Array
from fem.equilibrium import State, System, Tangent

PRESSURE, VOLUME = "pressure", "volume"
SMALL_LOAD = 1e-3  # of the softest shear modulus: pressures below it do not make the residual's scale smaller


@dataclass(frozen=True, eq=False)
class Point:
    """An equilibrium: positions x (n, 3) [m], pressure [Pa], cavity volume [m^3], strain energy [J].

    negative: negative pivots of the tangent, 0 where it is stable under that pressure. residuals:
    of every iteration since the requested load before, over the load.
    """

    x: Array
    pressure: float
    volume: float
    energy: float
    negative: int
    residuals: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class _Stand:
    """A converged state, its tangent, and how it moves per pascal: compliance is dV/dp [m^3/Pa]."""

    state: State
    tangent: Tangent
    volume: float
    motion: Array
    compliance: float


class _Cut(Exception):
    """A sub-step that must be smaller, and why."""


def follow(system: System, loads: Iterable[float], control: str = PRESSURE) -> list[Point]:
    """Return the equilibria at exactly these loads in turn, from rest: pressures [Pa] or cavity volumes [m^3].

    Raises BadInput for loads that are no numbers or a cavity that cannot be counted, DidNotConverge
    where the path ends: under pressure control at a limit point, or where it loses stability.
    """
    targets = [float(load) for load in loads]
    if not targets or not np.isfinite(targets).all():
        raise BadInput("loads", f"are {targets}", "expected finite numbers")
    if control not in (PRESSURE, VOLUME):
        raise BadInput("control", f"is {control!r}", f"expected {PRESSURE!r} or {VOLUME!r}")
    if control == VOLUME and not system.closed:
        raise BadInput("control", "is 'volume', but the pressed surface is open", "close it, or control the pressure")
    stand = _stand(system, system.rest(), system.tangent(system.rest()))
    points = []
    for target in targets:
        stand, residuals = _reach(system, stand, target, control)
        points.append(_point(stand, residuals))
    return points


def _point(stand: _Stand, residuals: list[float]) -> Point:
    state, tangent = stand.state, stand.tangent
    return Point(state.x, state.pressure, stand.volume, tangent.energy, tangent.negative, tuple(residuals))


def _stand(system: System, state: State, tangent: Tangent) -> _Stand:
    motion = tangent.solve(-tangent.area[:, None])[:, 0]
    volume = system.body.fluid(state.x)[1]
    return _Stand(state, tangent, volume, motion, float(-tangent.area @ motion))


def _load(stand: _Stand, control: str) -> float:
    return stand.state.pressure if control == PRESSURE else stand.volume


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
                raise _refusal(stand, control, target, error) from error
            continue
        now = goal
        step *= 2
    return stand, residuals


def _step(system: System, stand: _Stand, goal: float, control: str, residuals: list[float]) -> _Stand:
    """Return the equilibrium at one load. Raises _Cut or DidNotConverge where that is not near."""
    state = stand.state
    rise = goal - state.pressure if control == PRESSURE else (goal - stand.volume) / stand.compliance
    state = system.moved(replace(state, pressure=state.pressure + rise), stand.motion * rise)
    if control == PRESSURE:
        state = replace(state, pressure=goal)
    for _ in range(system.newton.most_steps):
        tangent = system.tangent(state)
        scale = max(abs(state.pressure), SMALL_LOAD * system.softest) * float(np.linalg.norm(tangent.area))
        residuals.append(float(np.linalg.norm(tangent.residual)) / scale)
        found = tangent.solve(-np.stack([tangent.residual, tangent.area], axis=1))
        move = found[:, 0]
        missing = 0.0
        if control == VOLUME:
            missing = goal - tangent.volume
            extra = (missing + float(tangent.area @ move)) / float(-tangent.area @ found[:, 1])
            move = move + extra * found[:, 1]
            state = replace(state, pressure=state.pressure + extra)
        largest = float(np.abs(move).max())
        if not np.isfinite(largest):
            raise _Cut("the displacements are not finite")
        state = system.moved(state, move * min(1.0, system.newton.most_move * system.extent / (largest or 1.0)))
        if residuals[-1] <= system.newton.tolerance and abs(missing) <= 1e-6 * abs(goal):
            reached = _Stand(
                state,
                tangent,
                system.body.fluid(state.x)[1],
                found[:, 1],
                float(-tangent.area @ found[:, 1]),
            )
            _check(stand, reached, control)
            return reached
    raise _Cut(f"residual {residuals[-1]:.1e} > {system.newton.tolerance:.0e} of the load after {len(residuals)} steps")


def _check(before: _Stand, after: _Stand, control: str) -> None:
    """Raise _Cut where a step under pressure control left the stable path it came from."""
    if control == VOLUME:
        return
    if after.tangent.negative > before.tangent.negative:
        raise _Cut(f"{after.tangent.negative} negative pivot(s): it would be unstable")
    gained = (after.volume - before.volume) / ((after.state.pressure - before.state.pressure) or 1.0)
    low, high = sorted((before.compliance, after.compliance))
    if not low / 1.5 <= gained <= 1.5 * high:
        raise _Cut("the volume jumped: another branch")


def _refusal(stand: _Stand, control: str, target: float, error: Exception) -> DidNotConverge:
    if control == VOLUME:
        at = f"{1e6 * stand.volume:.6g} mL on the way to {1e6 * target:.6g} mL"
        return DidNotConverge(f"inflation under volume control stops at {at}: {error}; try smaller volume steps")
    at = f"{stand.state.pressure / 1e3:.6g} kPa on the way to {target / 1e3:.6g} kPa"
    return DidNotConverge(
        f"inflation under pressure control stops at {at}: {error}; no stable equilibrium was found beyond "
        "(a limit point?): use control='volume', which passes it"
    )
