"""How near a printed tube comes to a wanted shape: material map and pressure for a centreline nobody has reached.

Only the ratios of the moduli to the pressure decide a shape, so a pressure decides where the bounds lie. The wish
is approached from small q to large, each map the seed of the next; the centreline is wanted, for the surface of
an ideal shape, its twist and the sizes of its bore included, asks for more than one layer of voxels can do.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from catheter.motions import Actuator
from catheter.reconstruction import Palette, discretised
from catheter.shape import Shape
from catheter.target import target
from data.errors import BadInput, CatheterError, DidNotConverge
from data.options import option
from data.signal import Array
from fem.grid import Indices
from fem.inverse import Inversion, Problem, Reconstruction, reconstruct
from fem.observation import Seen, centreline
from fem.palette import Printed
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


def approach(
    goals: Sequence[Goal], pressure: float, inversion: Inversion, tell: Callable[[Reached], None] | None = None
) -> list[Reached]:
    """Return the nearest found to each goal in turn at a pressure [Pa], from one modulus, then each from the last.

    A goal farther than what is reached ends the search for it in bounded time. Raises DidNotConverge where no map
    in bounds bears the pressure.
    """
    moduli = np.full(goals[0].voxels.count, np.sqrt(inversion.least * inversion.most))
    done = []
    for one in goals:
        found = refined(one, pressure, moduli, inversion)
        moduli = found.found.moduli
        done.append(found)
        if tell:
            tell(found)
    return done


def refined(one: Goal, pressure: float, moduli: Array, inversion: Inversion) -> Reached:
    """Return the nearest found to a goal at a pressure [Pa] from a map (v,) [Pa]."""
    pairs = neighbours(one.grid, (True, False))
    return Reached(one, pressure, reconstruct(one.voxels, [one.seen(pressure)], moduli, pairs, inversion))


def printable(near: Reached, palette: Palette, inversion: Inversion) -> "tuple[Reached, dict[str, Printed | str]]":
    """Return a map within the palette's moduli, and what each way of choosing materials for it does, or why it fails.

    Moduli and pressure are scaled alike, which changes no shape, until the bounds' middle is the palette's;
    what is clipped is sought once more within the palette's own bounds.
    """
    levels = palette.moduli()
    factor = float(np.sqrt(levels[0] * levels[-1] / (inversion.least * inversion.most)))
    inside = Inversion(
        least=levels[0], most=levels[-1], prior=inversion.prior, edge=inversion.edge, eager=inversion.eager,
        most_iterations=inversion.most_iterations,
    )  # fmt: skip
    again = refined(near.goal, near.pressure * factor, np.clip(near.found.moduli * factor, levels[0], levels[-1]), inside)
    problem = Problem(again.goal.voxels, [again.goal.seen(again.pressure)])
    made = discretised(problem, again.goal.grid, again.found, palette)
    return again, {name: str(one) if isinstance(one, CatheterError) else one for name, one in made}


def single(one: Goal, pressure: float, modulus: float) -> Standing | None:
    """Return the equilibrium of one modulus [Pa] everywhere at a pressure [Pa], None where it bears no such pressure."""
    try:
        return one.voxels.inflate(np.full(one.voxels.count, np.log(modulus)), pressure)
    except DidNotConverge:
        return None
