"""How near a printed tube comes to a wanted shape: material map and pressure for a centreline nobody has reached.

Only the ratios of the moduli to the pressure decide a shape, so a pressure decides where the bounds lie. The wish
is approached from small q to large, each map the seed of the next; the centreline is wanted, for the surface of
an ideal shape, its twist and the sizes of its bore included, asks for more than one layer of voxels can do.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from catheter.motions import Actuator
from catheter.reconstruction import Palette
from catheter.shape import Shape
from data.errors import BadInput, CatheterError, DidNotConverge
from data.options import option
from data.signal import Array
from fem.grid import Indices
from fem.inverse import Inversion, Iteration, Problem, Reconstruction, reconstruct
from fem.observation import Seen, centreline
from fem.palette import Choice, binned, dithered, printed, swapped
from fem.regular import neighbours
from fem.voxels import Standing, Voxels


@dataclass(frozen=True, kw_only=True)
class Reach:
    """How a shape is approached: at each of some pressures, by shapes of ascending q, the last the wish itself."""

    pressures: tuple[float, ...] = option((60e3, 150e3), unit="Pa", least=1.0)
    qs: tuple[float, ...] = option((0.1, 0.2, 0.3, 0.5, 0.75, 1.0), least=1e-3, most=1.0)
    nu: float = option(0.499, least=0.0, most=0.499999)

    def __post_init__(self) -> None:
        """Check that there is something to do, in order."""
        if not self.pressures or not self.qs or list(self.qs) != sorted(set(self.qs)):
            raise BadInput("reach", f"pressures {self.pressures}, qs {self.qs}", "expected one at least, qs ascending")


@dataclass(frozen=True, eq=False)
class Goal:
    """A shape on the mesh of the tube that is to reach it: nodes x (n, 3) and centreline (r, 3) wanted [m].

    rings: the nodes whose means are the centreline's points, base to tip, without the base, which is held.
    """

    voxels: Voxels
    grid: tuple[int, int]
    rings: tuple[Indices, ...]
    x: Array
    q: float

    def line(self, x: Array) -> Array:
        """Return the rings' mean positions (r, 3) [m] of nodes at x."""
        return np.stack([x[ring].mean(axis=0) for ring in self.rings])

    def seen(self, pressure: float) -> Seen:
        """Return the wish for the centreline, at a pressure [Pa]."""
        return centreline(self.voxels.mesh, self.rings, self.line(self.x), pressure)

    def off(self, x: Array) -> "Off":
        """Return how far nodes at x (n, 3) [m] are from the wish."""
        line = np.linalg.norm(self.line(x) - self.line(self.x), axis=1)
        surface = np.linalg.norm((x - self.x)[: len(self.x) - 1], axis=1)
        return Off(float(np.sqrt((line**2).mean())), float(line.max()), float(np.sqrt((surface**2).mean())))


@dataclass(frozen=True)
class Off:
    """Distances from a wish [m]: the centreline's root mean square and largest, and the wall's root mean square."""

    rms: float
    largest: float
    surface: float


@dataclass(frozen=True, eq=False)
class Reached:
    """The nearest that was found to a goal at a pressure [Pa]."""

    goal: Goal
    pressure: float
    found: Reconstruction

    @property
    def off(self) -> Off:
        """How far it is."""
        return self.goal.off(self.found.standings[0].state.x)


def goal(shape: Shape, actuator: Actuator, q: float, nu: float = 0.499) -> Goal:
    """Return the shape at q on an actuator's mesh. Raises BadInput for 20-node elements, and as target."""
    from catheter.target import target
    from fem import tube_grid
    from fem.material import NeoHooke

    if actuator.nodes != "8":
        raise BadInput("actuator, nodes", f"is {actuator.nodes}", "expected 8")
    wish = target(shape, actuator, q)
    around, along, through = actuator.divisions
    grid = (actuator.voxels[0], actuator.voxels[1])
    index = wish.undeformed.index
    mesh = tube_grid.capped(wish.undeformed, tube_grid.voxels_of((around, along, through), grid), 1)
    hub = wish.deformed[index[:, -1, 0]].mean(axis=0)
    rings = tuple(index[:, j].ravel() for j in range(1, index.shape[1]))
    return Goal(
        Voxels(mesh, mesh.part, law=NeoHooke(c1=1.0, nu=nu)), grid, rings, np.vstack([wish.deformed, hub]), wish.q
    )


def approach(  # noqa: PLR0917
    goals: Sequence[Goal],
    pressure: float,
    inversion: Inversion,
    tell: Callable[[Reached], None] | None = None,
    each: Callable[[Goal, Iteration], None] | None = None,
    seed: Array | None = None,
) -> list[Reached]:
    """Return the nearest found to each goal in turn at a pressure [Pa], from one modulus, then each from the last.

    seed: a map (v,) [Pa] to begin from instead. tell and each take what is found, and every iteration.
    A goal farther than what is reached ends the search for it in bounded time. Raises DidNotConverge where no map
    in bounds bears the pressure.
    """
    moduli = np.full(goals[0].voxels.count, np.sqrt(inversion.least * inversion.most)) if seed is None else seed
    done = []
    for one in goals:
        found = refined(one, pressure, moduli, inversion, each)
        moduli = found.found.moduli
        done.append(found)
        if tell:
            tell(found)
    return done


def refined(
    one: Goal,
    pressure: float,
    moduli: Array,
    inversion: Inversion,
    each: Callable[[Goal, Iteration], None] | None = None,
) -> Reached:
    """Return the nearest found to a goal at a pressure [Pa] from a map (v,) [Pa]."""
    pairs, seen = neighbours(one.grid, (True, False)), [one.seen(pressure)]
    tell = partial(each, one) if each else None
    return Reached(one, pressure, reconstruct(one.voxels, seen, moduli, pairs, inversion, tell))


def within(near: Reached, palette: Palette, inversion: Inversion) -> Reached:
    """Return the nearest map within the palette's own bounds.

    Moduli and pressure are scaled alike, which changes no shape, until the bounds' middle is the palette's; what
    is clipped is sought once more.
    """
    levels = palette.moduli()
    factor = float(np.sqrt(levels[0] * levels[-1] / (inversion.least * inversion.most)))
    moduli = np.clip(near.found.moduli * factor, levels[0], levels[-1])
    return refined(near.goal, near.pressure * factor, moduli, replace(inversion, least=levels[0], most=levels[-1]))


@dataclass(frozen=True, eq=False)
class Made:
    """A map of printable materials at the pressure [Pa] that brings it nearest to a goal. chosen (v,): of the palette.

    highest: whether it bears no higher pressure of those tried. seconds: that choosing and pressing it took.
    """

    chosen: Choice
    pressure: float
    standing: Standing
    off: Off
    highest: bool
    seconds: float


def pressed(one: Goal, palette: Palette, chosen: Choice, highest: float) -> Made:
    """Return a printed map at the best of 20 pressures up to the highest [Pa], or to what it bears.

    Raises DidNotConverge if it does not bear the least of them.
    """
    started = time.perf_counter()
    log, best, standing, last = np.log(palette.moduli_of(chosen)).ravel(), None, None, False
    for pressure in highest * np.arange(1, 21) / 20:
        try:
            standing = one.voxels.moved(standing, log, pressure) if standing else one.voxels.inflate(log, pressure)
        except DidNotConverge:
            if best is None:
                raise
            last = best.standing is standing
            break
        off = one.off(standing.state.x)
        if best is None or off.rms < best.off.rms:
            best = Made(chosen.ravel(), float(pressure), standing, off, False, 0.0)
    assert best is not None
    return replace(best, highest=last, seconds=time.perf_counter() - started)


def printable(near: Reached, palette: Palette) -> dict[str, Made | CatheterError]:
    """Return the printed maps for a map within the palette, by how materials are chosen, or why there is none.

    The best of those that only look at moduli is improved by swaps that look at the body's mechanics.
    """
    flat, levels = near.found.moduli.reshape(near.goal.grid), palette.moduli()
    ways: dict[str, Choice] = {
        "nearest": binned(flat, levels),
        "nearest in logarithm": binned(flat, levels, log=True),
        "dithered": dithered(flat, levels),
        "dithered in logarithm": dithered(flat, levels, log=True),
    }
    done = dict[str, Made | CatheterError]()
    for name, chosen in ways.items():
        try:
            done[name] = pressed(near.goal, palette, chosen, 1.5 * near.pressure)
        except DidNotConverge as error:
            done[name] = error
    good = [made for made in done.values() if isinstance(made, Made)]
    if good:
        started = time.perf_counter()
        best = min(good, key=lambda made: made.off.rms)
        problem = Problem(near.goal.voxels, [near.goal.seen(best.pressure)])
        first = printed(problem, best.chosen, levels, [best.standing])
        last = swapped(problem, first, levels, rounds=palette.rounds)
        here = last.standings[0]
        swaps = Made(last.chosen, best.pressure, here, near.goal.off(here.state.x), False, 0.0)
        again = pressed(near.goal, palette, last.chosen, 1.2 * best.pressure)
        found = min((swaps, again), key=lambda made: made.off.rms)
        done["best of these, swapped by mechanics"] = replace(found, seconds=time.perf_counter() - started)
    return done
