"""An inverse problem as a scene describes it: a body, what is wanted or seen of it, and how its map is sought."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from catheter.inflatable import Pattern, Shape
from data.errors import BadInput, CatheterError
from data.options import option
from data.signal import Array
from fem.inverse import Inversion, Iteration, Problem, Reconstruction, reconstruct
from fem.observation import Observation, Pose, Seen, centreline, nodes, twist
from fem.voxels import Standing, Voxels

if TYPE_CHECKING:
    from fem.palette import Printed

SEEN = ("all", "outer", "markers", "centreline", "tip", "twist")
SEEDS = ("uniform", "gap", "random")
POWER = 4.0  # of the errors whose mean the last swaps lower: the largest count


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """What is seen of the deformed body: the truth simulated from the scene's map, noise added where given.

    seen: all nodes, the outer surface's, `markers` of them, the centreline, the tip's pose or its twist.
    noise: standard deviation over the largest displacement. seed: where the search starts; number: of
    the random streams of noise and seed. stretched: the displacements' factor, a target nobody simulated;
    turned: instead of the truth, a pure torsion by that angle [rad] at the tip, which no map reaches;
    missing: the share of the length, in the middle, of which nothing is seen; outliers: nodes off by `off` [m].
    """

    pressures: tuple[float, ...] = option(unit="Pa")
    seen: str = option("all", choices=SEEN)
    noise: float = option(0.0, least=0.0, most=1.0)
    seed: str = option("uniform", choices=SEEDS)
    number: int = option(0, least=0)
    markers: int = option(64, least=1)
    stretched: float = option(1.0, least=0.0)
    turned: float = option(0.0, unit="rad")
    missing: float = option(0.0, least=0.0, most=0.9)
    outliers: int = option(0, least=0)
    off: float = option(5e-3, unit="m", least=0.0)


@dataclass(frozen=True, kw_only=True)
class Palette:
    """The materials that can be printed, by their names in thesis Table 5.1; none: the map stays as it is."""

    materials: tuple[str, ...] = ()
    rounds: int = option(12, least=0)

    def names(self) -> list[str]:
        """Return the materials, soft to stiff. Raises BadInput for a material without c1."""
        from fem.material import printable

        return sorted(self.materials, key=lambda name: printable(name).c1)

    def moduli(self) -> tuple[float, ...]:
        """Return c1 of each, ascending [Pa]. Raises BadInput for a material without c1."""
        from fem.material import printable

        return tuple(sorted(printable(name).c1 for name in self.materials))

    def moduli_of(self, chosen: Any) -> Array:
        """Return c1 of chosen materials [Pa]."""
        return np.asarray(np.array(self.moduli())[chosen])

    def elongations(self, chosen: Any) -> Array:
        """Return the elongation that chosen materials bear at least, 1 for twice the length; infinite: not known."""
        from fem.material import printable

        return np.asarray(np.array([printable(name).elongation for name in self.names()])[chosen])

    def overstretched(self, voxels: Voxels, chosen: Any, standings: Sequence[Standing]) -> int:
        """Return how many voxels of a printed map are stretched past their material's elongation at any pressure."""
        most = np.max([voxels.stretch(standing.state.x) for standing in standings], axis=0)
        return int((most - 1 > self.elongations(chosen)).sum())


@dataclass(frozen=True, kw_only=True)
class Cube:
    """A block of voxels, one an element, of which those with an odd sum of their numbers' halves are stiff.

    Faces are named as in fem.block: x0 at x = 0 to z1.
    """

    sizes: tuple[float, ...] = option((8e-3, 8e-3, 8e-3), unit="m", least=1e-6)
    divisions: tuple[int, ...] = option((8, 8, 8), least=1, most=64)
    pressed: tuple[str, ...] = ("x1", "z1")
    held: tuple[str, ...] = ("z0",)
    soft: str = "Agilus30"
    stiff: str = "FLX9785"
    nu: float = option(0.499, least=0.0, most=0.499999)


@dataclass(frozen=True, eq=False)
class Case:
    """An inverse problem: voxels, their grid, the true moduli (v,) [Pa] if a map was simulated, and what is seen.

    wraps: which axes of the grid close on themselves. whole: the equilibria of the truth.
    """

    voxels: Voxels
    grid: tuple[int, ...]
    wraps: tuple[bool, ...]
    truth: Array
    whole: tuple[Standing, ...]
    observations: tuple[Observation, ...]
    wanted: Wanted

    @property
    def variation(self) -> Any:
        """Neighbours' differences."""
        from fem.regular import neighbours

        return neighbours(self.grid, self.wraps)

    @property
    def problem(self) -> Problem:
        """What is seen beside the forward problem."""
        return Problem(self.voxels, list(self.observations))

    def names(self, palette: Palette) -> list[str]:
        """Return the palette's materials, soft to stiff."""
        return palette.names()

    def errors(self, standings: Sequence[Standing]) -> Array:
        """Return every node's distance from where the truth puts it, at all pressures (n,) [m]."""
        pairs = zip(standings, self.whole, strict=True)
        return np.concatenate([np.linalg.norm(a.state.x - b.state.x, axis=1) for a, b in pairs])

    def seed(self, options: Inversion) -> Array:
        """Return the moduli (v,) [Pa] that the scene starts from. Raises BadInput for a gap that nobody can see."""
        count, wanted = self.voxels.count, self.wanted
        low, high = np.log(options.least), np.log(options.most)
        if wanted.seed == "random":
            return np.exp(np.random.default_rng(wanted.number).uniform(low, high, count))
        if wanted.seed == "uniform":
            return np.full(count, np.exp((low + high) / 2))
        if wanted.seen != "all" or wanted.outliers or wanted.missing or wanted.stretched != 1.0 or wanted.turned:
            raise BadInput("wanted, seed", "is 'gap'", "it needs every node's position; start from 'uniform'")
        from fem.gap import gap

        first = self.observations[0]
        assert isinstance(first, Seen)
        x = first.rest + (first.rows.T @ first.target).reshape(-1, 3)
        return gap(self.voxels, x, first.pressure, options.least, options.most).moduli


def tube_voxels(shape: Shape) -> Voxels:
    """Return a tube's voxels of unknown moduli. Raises BadInput for what makes no tube."""
    from fem import tube_grid
    from fem.material import NeoHooke
    from fem.tube import DISC

    around, along, through = (*shape.divisions, 1)[:3]
    mesh = tube_grid.tube(
        shape.length, shape.outer_radius, shape.wall, (around, along, through),
        voxels=(shape.voxels[0], shape.voxels[1]), cap=shape.cap, order=1 if shape.nodes == "8" else 2,
    )  # fmt: skip
    return Voxels(mesh, mesh.part, law=NeoHooke(c1=1.0, nu=shape.nu), rest=DISC)


def tube_case(shape: Shape, pattern: Pattern, wanted: Wanted) -> Case:
    """Return the inverse problem of a scene's tube: its map is simulated, and seen as wanted."""
    voxels = tube_voxels(shape)
    grid = (shape.voxels[0], shape.voxels[1])
    return seen_of(voxels, grid, (True, False), pattern.moduli(*grid).ravel(), wanted)


def cube_case(cube: Cube, wanted: Wanted) -> Case:
    """Return the inverse problem of a scene's block."""
    from fem.block import Block
    from fem.material import NeoHooke, printable

    soft, stiff = printable(cube.soft).c1, printable(cube.stiff).c1
    law = NeoHooke(c1=1.0, nu=cube.nu)
    x, y, z = np.indices(cube.divisions)
    material = np.full(cube.divisions, law, dtype=object)
    sizes, divisions = (cube.sizes[0], cube.sizes[1], cube.sizes[2]), (len(x), x.shape[1], x.shape[2])
    body = Block(sizes=sizes, divisions=divisions, material=material, pressed=cube.pressed, held=cube.held).body()
    at = np.floor(body.mesh.nodes[body.mesh.hexes].mean(axis=1) / (np.array(sizes) / divisions)).astype(np.int32)
    which = np.ravel_multi_index((at[:, 0], at[:, 1], at[:, 2]), divisions).astype(np.int32)
    truth = np.where((x // 2 + y // 2 + z // 2) % 2, stiff, soft).ravel()
    return seen_of(Voxels(body.mesh, which, law=law), divisions, (False,) * 3, truth, wanted)


def seen_of(voxels: Voxels, grid: tuple[int, ...], wraps: tuple[bool, ...], truth: Array, wanted: Wanted) -> Case:
    """Return the inverse problem whose data are simulated from a map (v,) [Pa]. Raises DidNotConverge as `inflate`."""
    rng = np.random.default_rng(1000 + wanted.number)
    whole, observations = list[Standing](), list[Observation]()
    for pressure in sorted(wanted.pressures):
        first = voxels.inflate(np.log(truth), pressure)
        whole.append(first)
        observations.append(observed(voxels, first.state.x, pressure, wanted, rng))
    return Case(voxels, grid, wraps, truth, tuple(whole), tuple(observations), wanted)


def observed(voxels: Voxels, x: Array, pressure: float, wanted: Wanted, rng: np.random.Generator) -> Observation:
    """Return what is seen of positions x (n, 3) [m] at a pressure, with the scene's noise."""
    mesh = voxels.mesh
    moved = wanted.stretched * ((torsion(mesh.nodes, wanted.turned) if wanted.turned else x) - mesh.nodes)
    sd = wanted.noise * float(np.abs(moved).max())
    x = mesh.nodes + moved + sd * rng.standard_normal(x.shape)
    ring: Any = mesh.ring if len(mesh.ring) else np.flatnonzero(mesh.nodes[:, 2] >= mesh.nodes[:, 2].max() - 1e-9)
    if wanted.seen in ("tip", "twist"):
        rest, now = mesh.nodes[ring], x[ring]
        turn = np.array([0.0, 0.0, twist(rest, now)])
        arm = float(np.linalg.norm(rest - rest.mean(axis=0), axis=1).max())
        shift = (now - rest).mean(axis=0)
        return Pose(
            pressure=pressure, ring=ring, rest=mesh.nodes, shift=shift, turn=turn, arm=arm,
            angle_only=wanted.seen == "twist", sd=sd / len(ring) ** 0.5,
        )  # fmt: skip
    if wanted.seen == "centreline":
        rings = heights(mesh.nodes)
        line = np.stack([x[one].mean(axis=0) for one in rings])
        return centreline(mesh, rings, line, pressure, sd=sd / min(map(len, rings)) ** 0.5)
    which = visible(voxels, wanted)
    if wanted.seen == "markers":
        which = np.sort(rng.choice(which, min(wanted.markers, len(which)), replace=False))
    if wanted.outliers:
        x[rng.choice(which, wanted.outliers, replace=False), 0] += wanted.off
    return nodes(mesh, which, x, pressure, sd=sd)


def torsion(rest: Array, angle: float) -> Array:
    """Return positions (n, 3) turned about z in proportion to height, by an angle [rad] at the tip: pure shear."""
    turn = angle * rest[:, 2] / rest[:, 2].max()
    x, y, z = rest.T
    return np.stack([x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn), z], axis=1)


def heights(rest: Array) -> list[Any]:
    """Return the nodes of each ring, base to tip."""
    level = np.round(rest[:, 2] / np.ptp(rest[:, 2]) * 1e6).astype(np.int64)
    return [np.flatnonzero(level == one) for one in np.unique(level)[1:]]


def visible(voxels: Voxels, wanted: Wanted) -> Any:
    """Return the nodes a scene sees: all, or those of the outer surface, without its missing middle."""
    rest = voxels.mesh.nodes
    which = np.arange(len(rest))
    if wanted.seen != "all":
        radius = np.hypot(rest[:, 0], rest[:, 1])
        which = np.flatnonzero((radius > radius.max() * (1 - 1e-9)) & (rest[:, 2] > 0))
    middle = np.abs(rest[which, 2] / rest[:, 2].max() - 0.5) < wanted.missing / 2
    return which[~middle]


def solved(
    case: Case,
    options: Inversion,
    seed: Array | None = None,
    progress: Callable[[Iteration], None] | None = None,
) -> Reconstruction:
    """Return a case's map from its own seed, or from another."""
    first = case.seed(options) if seed is None else seed
    return reconstruct(case.voxels, case.observations, first, case.variation, options, progress)


def discretised(case: Case, found: Reconstruction, palette: Palette) -> "Iterator[tuple[str, Printed | CatheterError]]":
    """Yield each way of choosing printable materials for a map, and what would be printed, solved."""
    from fem.palette import Printed, binned, diffused, dithered, printed, swapped

    problem, moduli, start = case.problem, palette.moduli(), found.standings
    flat = found.moduli.reshape(case.grid)
    plain: dict[str, Callable[[], Printed]] = {
        "nearest": lambda: printed(problem, binned(flat, moduli), moduli, start),
        "nearest in logarithm": lambda: printed(problem, binned(flat, moduli, log=True), moduli, start),
        "dithered": lambda: printed(problem, dithered(flat, moduli), moduli, start),
        "dithered in logarithm": lambda: printed(problem, dithered(flat, moduli, log=True), moduli, start),
        "by mechanics": lambda: diffused(problem, start, moduli),
    }
    stood = list[Printed]()
    for name, choose in plain.items():
        try:
            made = choose()
            stood.append(made)
            yield name, made
        except CatheterError as error:
            yield name, error
    if stood:
        first = min(stood, key=lambda one: one.misfit)
        yield "best of these, swapped by mechanics", swapped(problem, first, moduli, rounds=palette.rounds, power=POWER)


@dataclass(frozen=True)
class Quality:
    """How a map compares with the true one: modulus errors relative, right: share on the truth's side of stiff/soft."""

    largest: float
    median: float
    right: float

    @classmethod
    def of(cls, moduli: Array, truth: Array) -> "Quality":
        """Return the comparison of moduli (v,) with the truth (v,)."""
        error = np.abs(moduli / truth - 1)
        edge = float(np.sqrt(truth.min() * truth.max())) if np.ptp(truth) > 0 else 0.0
        right = float(((moduli > edge) == (truth > edge)).mean())
        return cls(float(error.max()), float(np.median(error)), right)
