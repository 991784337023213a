"""Along a path of loads: predictor, Newton, cut-back; pressure or volume prescribed, through limit points.

A step under pressure control is accepted only if the volume it gained is what the compliance dV/dp
before it foretold, within a factor: a jump over a limit point to another branch is not, however
small the step before it, because the compliance has no bound there but the gap between branches is finite.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from data.errors import BadInput, DidNotConverge
from data.signal import Array
from fem import solver
from fem.equilibrium import Balance, State, System, Tangent
from fem.predictor import Mark, Stand, predicted

PRESSURE, VOLUME = "pressure", "volume"
SMALL_LOAD = 1e-3  # of the softest shear modulus: pressures below it do not make the residual's scale smaller
CLOSE = 1e-3  # the residual over the load from which the tangent is kept: it is that of the end state to 1e-5
MISSED = 1e-12  # of a volume asked for
MOST_CHANGE = 2.5  # a sub-step's gain in volume over the gain foretold


@dataclass(frozen=True, eq=False)
class Point:
    """An equilibrium: positions x (n, 3) [m], load (the pressure [Pa]), cavity volume [m^3], strain energy [J].

    compliance is dV/dp [m^3/Pa]. negative: negative pivots of the tangent, 0 where it is stable
    under that load. reaction (n, 3): forces on the nodes, 0 where they are free [N]. residuals: all since the
    requested load before, over the load; iterations: the corrections among them, factors: those with a new tangent.
    """

    x: Array
    load: float
    volume: float
    energy: float
    compliance: float
    negative: int
    reaction: Array
    residuals: tuple[float, ...]
    iterations: int
    factors: int


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
    with solver.one_thread():
        stand = _stand(system, system.rest() if start is None else State(start.x, start.load), control)
        before, points = None, []
        for target in targets:
            spent = _Spent()
            before, stand = _reach(system, before, stand, target, control, spent)
            points.append(_point(stand, spent))
    return points


def _point(stand: Stand, spent: "_Spent") -> Point:
    here, state = stand.here, stand.state
    numbers = (state.load, here.volume, here.energy, stand.compliance, stand.tangent.negative)
    return Point(state.x, *numbers, here.reaction, tuple(spent.residuals), spent.iterations, spent.factors)


@dataclass
class _Spent:
    """What has been spent since the last requested load."""

    residuals: list[float] = field(default_factory=list)
    iterations: int = 0
    factors: int = 0


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


def _stand(system: System, state: State, control: str) -> Stand:
    tangent = system.tangent(state)
    return _reached(system, state, tangent, tangent, tangent.solve(-tangent.slope[:, None])[:, 0], control)


def _reached(  # noqa: PLR0917
    system: System, state: State, here: Balance, tangent: Tangent, per_load: Array, control: str
) -> Stand:
    if control == PRESSURE:
        return Stand(system, state, here, tangent, state.load, per_load, 1.0)
    rise = 1 / float(-tangent.slope @ per_load)
    return Stand(system, state, here, tangent, here.volume, per_load * rise, rise)


def _reach(  # noqa: PLR0917
    system: System, before: Mark | None, stand: Stand, target: float, control: str, spent: _Spent
) -> tuple[Mark | None, Stand]:
    """Step from a stand to a load, in as many sub-steps as it takes; return it with the mark before it."""
    whole, now = target - stand.parameter, stand.parameter
    step = whole
    while now != target:
        step = min(step, target - now, key=abs)
        reach = float(np.abs(stand.motion).max()) * abs(step) / (system.newton.most_move * system.extent)
        step /= max(1, int(np.ceil(reach)))
        goal = target if abs(target - now - step) < 1e-9 * abs(whole) else now + step
        try:
            reached = _step(system, before, stand, goal, control, spent)
        except (_Cut, DidNotConverge) as error:
            step /= 2
            if abs(step) < system.newton.smallest * abs(whole):
                raise _refusal(stand, control, target, error) from error
            continue
        before, stand = stand.mark, reached
        now = goal
        step *= 2
    return before, stand


def _step(  # noqa: PLR0917
    system: System, before: Mark | None, stand: Stand, goal: float, control: str, spent: _Spent
) -> Stand:
    """Return the equilibrium at one load. Raises _Cut or DidNotConverge where that is not near.

    Newton's method; once the residual is small the factor at hand is used again, as long as it makes
    the residual fall tenfold.
    """
    state, size = predicted(before, stand, goal), np.inf
    kept: tuple[Tangent, Array] | None = None  # a tangent taken close by, and how the unknowns move per load by it
    for _ in range(system.newton.most_steps):
        here = system.tangent(state) if kept is None else system.balance(state)
        scale = _scale(system, state, here)
        last, size = size, float(np.linalg.norm(here.residual)) / scale
        missing = goal - here.volume if control == VOLUME else 0.0
        there = size <= max(0.1 * system.newton.tolerance, system.body.noise / scale)
        there = there and abs(missing) <= MISSED * abs(goal)
        if not there and size > 0.1 * last and kept is not None:  # the old factor is no longer good enough
            here, state = system.tangent(state), State(state.x, state.load)
        spent.residuals.append(size)
        if kept is None or isinstance(here, Tangent):
            assert isinstance(here, Tangent)
            found = here.solve(-np.stack([here.residual, here.slope], axis=1))
            move, kept = found[:, 0], (here, found[:, 1])
            spent.factors += 1
        elif not there:
            move = kept[0].solve(-here.residual[:, None])[:, 0]
        if there:
            reached = _reached(system, state, here, *kept, control)
            _check(system, stand, reached, control)
            return reached
        state = _corrected(system, state, here, move, kept[1], missing, control, size > CLOSE)
        spent.iterations += 1
        if size > CLOSE:
            del here  # the next tangent takes its memory
            kept = None
    raise _Cut(f"residual {size:.1e} > {system.newton.tolerance:.0e} of the load after {len(spent.residuals)} steps")


def _corrected(  # noqa: PLR0917
    system: System, state: State, here: Balance, move: Array, per_load: Array, missing: float, control: str, hold: bool
) -> State:
    """Return the state after a correction for the residual, per_load along with it where a volume is missing."""
    extra = 0.0
    if control == VOLUME:
        extra = (missing + float(here.slope @ move)) / float(-here.slope @ per_load)
        move = move + extra * per_load
    largest, longest = float(np.abs(move).max()), system.newton.most_move * system.extent
    if not np.isfinite(largest):
        raise _Cut("the displacements are not finite")
    return system.moved(state, move * min(1.0, longest / (largest or 1.0)), state.load + extra, hold=hold)


def _scale(system: System, state: State, here: Balance) -> float:
    """Return what a residual is measured against [N]: the load, or the reactions where nodes are moved."""
    if system.place is not None:
        return float(np.linalg.norm(here.reaction[system.body.mesh.fixed])) or 1.0
    least = SMALL_LOAD * system.body.softest if system.dead is None else 0.0
    return max(abs(state.load), least) * float(np.linalg.norm(here.slope)) or 1.0


def _check(system: System, before: Stand, after: Stand, control: str) -> None:
    """Raise _Cut where a step under pressure control left the stable path it came from."""
    if control == VOLUME:
        return
    if after.tangent.negative > before.tangent.negative:
        raise _Cut(f"{after.tangent.negative} negative pivot(s): it would be unstable")
    if not system.closed:
        return
    gained = (after.here.volume - before.here.volume) / ((after.state.load - before.state.load) or 1.0)
    if not 1 / MOST_CHANGE <= gained / before.compliance <= MOST_CHANGE:
        raise _Cut("the volume is not where the tangent saw it: another branch?")


def _refusal(stand: Stand, control: str, target: float, error: Exception) -> DidNotConverge:
    if control == VOLUME:
        at = f"{1e6 * stand.here.volume:.6g} mL on the way to {1e6 * target:.6g} mL"
        return DidNotConverge(f"inflation under volume control stops at {at}: {error}; try smaller volume steps")
    if not stand.system.closed:
        at = f"{stand.state.load:.6g} on the way to {target:.6g}"
        return DidNotConverge(f"equilibrium stops at a load of {at}: {error}; try smaller steps, or a finer mesh")
    at = f"{stand.state.load / 1e3:.6g} kPa on the way to {target / 1e3:.6g} kPa"
    return DidNotConverge(
        f"inflation under pressure control stops at {at}: {error}; no stable equilibrium was found beyond "
        "(a limit point?): use control='volume', which passes it"
    )
