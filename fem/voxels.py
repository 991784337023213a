"""A body whose voxels' moduli are unknown: the forward problem of every inverse one.

A voxel's modulus scales its law, bulk modulus included (Poisson's ratio is kept), so that the forces of
its elements are linear in it.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from data.errors import BadInput, DidNotConverge
from data.signal import Array
from fem import continuation, rigid
from fem.element import make_body
from fem.equilibrium import Newton, State, System, Tangent
from fem.grid import Indices, Mesh
from fem.kernel import assemble
from fem.material import Law, NeoHooke, Ogden

UNIT = NeoHooke(c1=1.0)
TIMID = 0.5  # the largest predicted move in one go, over the largest displacement there is


@dataclass(frozen=True, eq=False)
class Standing:
    """A map in equilibrium: log moduli (v,), the state, and its tangent."""

    log: Array
    state: State
    tangent: Tangent


@dataclass(frozen=True, eq=False)
class Voxels:
    """A mesh whose elements belong to voxels: which (e,) names an element's, -1 for one of `rest`'s law.

    law: the law of a voxel of modulus 1 Pa. Raises BadInput for voxels without an element.
    """

    mesh: Mesh
    which: Indices
    law: Law = UNIT
    rest: Law = UNIT
    newton: Newton = field(default_factory=Newton)

    def __post_init__(self) -> None:
        """Check that every voxel has an element."""
        if self.which.shape != (len(self.mesh.hexes),):
            raise BadInput("voxels, which", f"has shape {self.which.shape}", f"expected ({len(self.mesh.hexes)},)")
        counts = np.bincount(self.which[self.which >= 0])
        if not len(counts) or not counts.all():
            raise BadInput("voxels, which", "a voxel has no element", "number them from 0 without a gap")

    @property
    def count(self) -> int:
        """The number of voxels."""
        return int(self.which.max()) + 1

    @cached_property
    def system(self) -> System:
        """The unknowns' order and patterns, with 1 Pa in every voxel."""
        return System(make_body(self.mesh, [self.law, self.rest], (self.which < 0).astype(np.int32)), self.newton)

    def with_moduli(self, moduli: Array) -> System:
        """Return the system of moduli (v,) [Pa], patterns shared. Raises BadInput unless they are positive."""
        if moduli.shape != (self.count,) or not (np.isfinite(moduli) & (moduli > 0)).all():
            raise BadInput("moduli", f"{moduli.shape}, least {moduli.min():g} Pa", f"expected {self.count} above 0")
        unit = self.system.body
        factor = np.append(moduli, 1.0)[self.which]
        numbers = unit.numbers * factor[:, None]
        if isinstance(self.law, Ogden):  # the exponents stay
            numbers[:, 3:] = unit.numbers[:, 3:]
        softest = min(self.law.shear * float(moduli.min()), self.rest.shear if (self.which < 0).any() else np.inf)
        body = replace(unit, numbers=numbers, kappa=unit.kappa * factor, softest=softest)
        return self.system.with_body(body)

    def stretch(self, x: Array) -> Array:
        """Return the largest principal stretch in each voxel (v,) at positions x (n, 3) [m]."""
        return self.system.body.stretch(x, self.which)

    def onto(self, x: Array) -> Any:
        """Return d(positions) / d(unknowns) at positions x, sparse (3n, k)."""
        from scipy.sparse import coo_array

        system, tied = self.system, self.mesh.tied
        free = system.free
        moves = rigid.motions(x[tied])
        places = (3 * tied[:, None] + np.arange(3)).ravel()
        rows = np.concatenate([free, np.repeat(places, moves.shape[1])])
        columns = np.concatenate([np.arange(len(free)), np.tile(len(free) + np.arange(moves.shape[1]), len(places))])
        values = np.concatenate([np.ones(len(free)), moves.ravel()])
        return coo_array((values, (rows, columns)), shape=(x.size, len(free) + moves.shape[1])).tocsr()

    def unit_forces(self, x: Array) -> Any:
        """Return the forces on the nodes (3n, v) of each voxel at 1 Pa, sparse [N/Pa]."""
        from scipy.sparse import coo_array

        rows, columns, force = self._element_forces(x)
        keep = columns >= 0
        return coo_array((force[keep], (rows[keep], columns[keep])), shape=(x.size, self.count)).tocsc()

    def known_forces(self, x: Array) -> Array:
        """Return the forces (n, 3) of the elements that belong to no voxel [N]."""
        rows, columns, force = self._element_forces(x)
        known = columns < 0
        total = np.bincount(rows[known], force[known], minlength=x.size)
        return np.asarray(total.reshape(x.shape), dtype=np.float64)

    def _element_forces(self, x: Array) -> tuple[Any, Any, Array]:
        """Return rows, voxels and values of every element's forces on its nodes."""
        body, nodes = self.system.body, self.mesh.hexes.shape[1]
        apart = np.arange(self.mesh.hexes.size, dtype=np.int32).reshape(self.mesh.hexes.shape)
        force = np.zeros((self.mesh.hexes.size, 3))
        none = np.zeros((1, 1, 7)), body.pattern.element, force, np.zeros_like(force), np.zeros((0, 3, 3))
        elements = body.gradient, body.weight, body.law, body.numbers, body.kappa, body.mean
        bad, _ = assemble(np.ascontiguousarray(x[self.mesh.hexes.ravel()]), apart, *elements, *none)
        if bad >= 0:
            raise BadInput("positions", f"element {bad} is turned inside out", "no voxel can be that shape")
        rows = 3 * self.mesh.hexes.ravel()[:, None] + np.arange(3)
        return rows.ravel(), np.repeat(self.which, 3 * nodes), force.ravel()

    def slopes(self, standing: Standing) -> Any:
        """Return d(residual) / d(log moduli), sparse (k, v) [N]."""
        from scipy.sparse import dia_array

        x = standing.state.x
        scale: Any = dia_array((np.exp(standing.log)[None], np.zeros(1, dtype=int)), shape=(self.count, self.count))
        return (self.onto(x).T @ self.unit_forces(x) @ scale).tocsc()

    def stiffest(self, standing: Standing) -> float:
        """Return a bound of the tangent's largest eigenvalue [N/m]: the largest absolute row sum of its blocks."""
        system = self.with_moduli(np.exp(standing.log))
        x = standing.state.x
        blocks = system.body.forces(x, system.body.linearised(x, np.zeros_like(x))).stiffness
        rows = np.add.reduceat(np.abs(blocks).sum(axis=2), system.body.pattern.start[:-1], axis=0)
        return float(rows.max())

    def inflate(self, log: Array, load: float) -> Standing:
        """Return a map's equilibrium at a load [Pa], from rest. Raises DidNotConverge."""
        return self.path(log, [load])[0]

    def path(self, log: Array, loads: list[float]) -> list[Standing]:
        """Return a map's equilibria at loads [Pa] in turn, from rest. Raises DidNotConverge."""
        system = self.with_moduli(np.exp(log))
        found = []
        for point in continuation.follow(system, loads):
            state = State(point.x, point.load)
            found.append(Standing(log, state, system.tangent(state)))
        return found

    def moved(self, standing: Standing, log: Array, load: float | None = None, shares: int = 16) -> Standing:
        """Return the equilibrium of another map (and load), reached from one that is known by its tangent.

        Raises DidNotConverge where it takes steps smaller than 1 / shares of the way.
        """
        goal = standing.state.load if load is None else load
        first, done, step = standing, 0.0, 1.0
        while done < 1.0:
            step = min(step, 1.0 - done)
            share = 1.0 if done + step > 1 - 1e-12 else done + step
            target = first.log + share * (log - first.log) if share < 1 else log
            force = first.state.load + share * (goal - first.state.load)
            try:
                standing = self._step(standing, target, force)
            except DidNotConverge:
                step /= 2
                if step < 1 / shares:
                    raise
                continue
            done, step = share, 2 * step
        return standing

    def _step(self, standing: Standing, log: Array, load: float) -> Standing:
        """Return the equilibrium at a map and load near a known one. Raises DidNotConverge where Newton fails."""
        system = self.with_moduli(np.exp(log))
        state, tangent = standing.state, standing.tangent
        rise = self.slopes(standing) @ (log - standing.log) + tangent.slope * (load - state.load)
        move = tangent.solve(-rise[:, None])[:, 0]
        largest = float(np.abs(move).max())
        reach = float(np.abs(state.x - self.mesh.nodes).max())
        if largest > TIMID * max(reach, 1e-3 * system.extent):
            raise DidNotConverge(f"the tangent foretells a move of {largest:.3g} m; a smaller step")
        return _settled(system, system.moved(state, move, load), log)


def _settled(system: System, state: State, log: Array) -> Standing:
    longest = system.newton.most_move * system.extent
    norms: list[float] = []
    for _ in range(system.newton.most_steps):
        tangent = system.tangent(state)
        scale = abs(state.load) * float(np.linalg.norm(tangent.slope)) or 1.0
        norms.append(float(np.linalg.norm(tangent.residual)) / scale)
        if not np.isfinite(norms[-1]) or (len(norms) > 4 and norms[-1] > 10 * norms[0]):
            break
        move = tangent.solve(-tangent.residual[:, None])[:, 0]
        largest = float(np.abs(move).max())
        state = system.moved(state, move * min(1.0, longest / (largest or 1.0)), state.load)
        if norms[-1] <= max(system.newton.tolerance, system.body.noise / scale):
            if tangent.negative:
                raise DidNotConverge(
                    f"{tangent.negative} negative pivot(s) at {state.load:.6g} Pa: it would be unstable"
                )
            return Standing(log, state, tangent)
    raise DidNotConverge(f"residual {norms[-1]:.1e} of the load after {len(norms)} steps at {state.load:.6g} Pa")
