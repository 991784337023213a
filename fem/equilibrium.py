"""Equilibrium of a body under fluid pressure: unknowns, their tangent, Newton's method.

Unknowns are the free displacement components, level by level, then the rigid cap's three
displacements and three rotations (as arc lengths on its ring), then, under volume control, the pressure.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from data.errors import BadInput
from data.options import option
from data.signal import Array
from fem import pressure, rigid, solver
from fem.element import Body, Forces
from fem.symmetry import Symmetry

# What a system works out from its mesh: the unknowns' order and patterns.
BY_MESH = (
    "extent", "closed", "symmetric", "_levels", "_moves", "_order", "free", "_level_of", "_ends", "_spare", "method",
    "_places",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Newton:
    """How equilibrium is found.

    tolerance: residual over the load; iterations go on to a tenth of it, or to what rounding of the
    positions leaves, where that is more: the residuals of a result say which.
    most_steps: iterations in a sub-step before it is cut. most_move: the largest displacement in an
    iteration, and in a predictor, over the body's extent. smallest: the smallest sub-step, as
    a share of the way from one requested load to the next. solver: "" lets the mesh decide.
    """

    tolerance: float = option(1e-8, least=1e-12, most=1e-3)
    most_steps: int = option(20, least=3)
    most_move: float = option(0.03, least=1e-4)
    smallest: float = option(1e-3, least=1e-9, most=1.0)
    solver: str = option("", choices=("", solver.RINGS, solver.SPARSE, solver.GENERAL))

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not 1e-12 <= self.tolerance <= 1e-3 or self.most_steps < 3 or self.most_move < 1e-4:
            raise BadInput("newton", f"is {self}", "expected a tolerance of 1e-12 to 1e-3, 3 steps, a move of 1e-4")
        if self.solver not in ("", solver.RINGS, solver.SPARSE, solver.GENERAL):
            raise BadInput(
                "newton, solver", f"is {self.solver!r}", f"known: {solver.RINGS}, {solver.SPARSE}, {solver.GENERAL}"
            )


@dataclass(frozen=True, eq=False)
class State:
    """Positions x (n, 3) [m] at a load (the pressure [Pa]), the stresses (e, g, 7) its tangent is to use.

    held is None where they are those of the positions themselves.
    """

    x: Array
    load: float
    held: Array | None = None


@dataclass(frozen=True, eq=False)
class Balance:
    """Forces at a state: residual (k,) [N], its slope over the load (k,), cavity volume [m^3], strain energy [J].

    slope is -dV/dx [m^2] for a pressure; reaction (n, 3) are the forces on all nodes [N].
    """

    residual: Array
    slope: Array
    volume: float
    energy: float
    reaction: Array


@dataclass(frozen=True, eq=False)
class Tangent(Balance):
    """A balance with its factorised tangent.

    across (k, f) couples to the fixed components; coupling (free, 6) to the cap, solved (free, 6)
    is its solution, schur (6, 6) the cap's reduced stiffness.
    """

    factor: solver.Factor
    across: Any
    coupling: Array
    solved: Array
    schur: Array

    @property
    def negative(self) -> int:
        """How many pivots of the whole tangent are negative; 0 where the state is stable under that pressure."""
        return self.factor.negative + int((np.linalg.eigvalsh(self.schur) < 0).sum())

    def solve(self, right: Array) -> Array:
        """Return the unknowns (k, m) for right-hand sides (k, m)."""
        free = len(self.coupling)
        with solver.one_thread():
            first = self.factor.solve(right[:free])
        cap = np.linalg.solve(self.schur, right[free:] - self.coupling.T @ first)
        return np.vstack([first - self.solved @ cap, cap])

    def solve_transposed(self, right: Array) -> Array:
        """Return the solution (k, m) of the transposed tangent; the same as `solve` where it is symmetric."""
        if not isinstance(self.factor, solver.SuperLU):
            return self.solve(right)
        return self.factor.solve(right, transposed=True) if not self.coupling.shape[1] else self.solve(right)


@dataclass(frozen=True, eq=False)
class System:
    """A body's unknowns, in the order that suits the solver, and what a load does to it.

    A load is the pressure on the pressed faces [Pa]; dead (n, 3) are forces per unit of load
    beside it [N]; place says where the mesh's nodes (n, 3) stand at a load as far as they are fixed.
    symmetry: only its sector is solved for; pressure is the only load then.
    """

    body: Body
    newton: Newton = field(default_factory=Newton)
    dead: Array | None = None
    place: Callable[[float], Array] | None = None
    symmetry: Symmetry | None = None

    def with_body(self, body: Body) -> "System":
        """Return the system of another body of the same mesh: what the mesh alone decides is kept."""
        made = replace(self, body=body)
        for name in BY_MESH:
            made.__dict__[name] = getattr(self, name)
        return made

    @cached_property
    def part(self) -> Body:
        """The elements that are assembled: the body's, or those of a sector."""
        return self.body if self.symmetry is None else self.symmetry.sector(self.body)

    @cached_property
    def extent(self) -> float:
        """The largest side of the body's box [m]."""
        return float(np.ptp(self.body.mesh.nodes, axis=0).max())

    @cached_property
    def closed(self) -> bool:
        """Whether the pressed surface is a cavity, and nothing else loads the body."""
        return self.dead is None and self.place is None and pressure.closed(self.body.mesh)

    @cached_property
    def symmetric(self) -> bool:
        """Whether the tangent is symmetric."""
        return pressure.symmetric(self.body.mesh)

    @cached_property
    def _levels(self) -> Any:
        """Unknowns' level (n, 3) by the best of four sweeps: from the fixed nodes, and along x, y, z."""
        mesh, pattern = self.body.mesh, self.body.pattern
        held = np.asarray(mesh.fixed.all(axis=1))
        seeds = [held] if held.any() else []
        for along in mesh.nodes.T if self.symmetry is None else mesh.nodes.T[2:]:
            seeds.append(along <= along.min() + 1e-9 * self.extent)
        found = [np.repeat(solver.sweep(pattern.start, pattern.column, seed), 3) for seed in seeds]
        return min(found, key=lambda level: solver.work(level[self._moves]))

    @cached_property
    def _moves(self) -> Any:
        moves = ~self.body.mesh.fixed
        moves[self.body.mesh.tied] = False
        if not moves.any():
            raise BadInput("mesh, fixed", "nothing can move", "free some nodes")
        return moves.ravel()

    @cached_property
    def _order(self) -> Any:
        """Each node's place, level by level (n,)."""
        return solver.ranked(self.body.pattern.start, self.body.pattern.column, self._levels[::3])

    @cached_property
    def _basis(self) -> Any:
        """What displacements (3n,) a sector's unknowns make (3n, k), and each unknown's node."""
        assert self.symmetry is not None
        return self.symmetry.basis(self._moves.reshape(-1, 3).any(axis=1), self._order)

    @cached_property
    def free(self) -> Any:
        """Numbers of the free displacement components, level by level (k,); of a sector's: of its unknowns."""
        if self.symmetry is not None:
            return np.arange(self._basis[0].shape[1])
        free = np.flatnonzero(self._moves)
        return free[np.argsort(self._order[free // 3], kind="stable")]

    @cached_property
    def _level_of(self) -> Any:
        """The level of each unknown (k,)."""
        return self._levels[self.free if self.symmetry is None else 3 * self._basis[1]]

    @cached_property
    def _ends(self) -> Any:
        """Where each level's unknowns end."""
        counts = np.bincount(self._level_of)
        return np.cumsum(counts[counts > 0])

    @cached_property
    def _spare(self) -> list[Array]:
        """Memory of factors that are gone."""
        return []

    @cached_property
    def method(self) -> str:
        """The name of the solver: what the options say, or what suits the mesh."""
        if not self.symmetric:
            return solver.GENERAL
        dense = solver.work(self._level_of) <= solver.MOST_WORK
        return self.newton.solver or (solver.RINGS if dense else solver.SPARSE)

    @cached_property
    def _places(self) -> tuple[Any, ...]:
        """CSR patterns free-free, free-tied, tied-tied, free-fixed, tied-fixed; their data: places in the blocks."""
        from scipy.sparse import bsr_array

        pattern, n = self.body.pattern, 3 * len(self.body.mesh.nodes)
        numbers = np.arange(9 * len(pattern.column), dtype=np.int64).reshape(-1, 3, 3) + 1
        whole = bsr_array((numbers, pattern.column, pattern.start), shape=(n, n)).tocsr()
        tied = (3 * self.body.mesh.tied[:, None] + np.arange(3)).ravel()
        rows, cap, fixed = whole[self.free], whole[tied], np.flatnonzero(self.body.mesh.fixed)
        parts = rows[:, self.free], rows[:, tied], cap[:, tied], rows[:, fixed], cap[:, fixed]
        for part in parts:
            part.data -= 1
            part.sort_indices()
        return parts

    def _part(self, k: int, stiffness: Array) -> Any:
        from scipy.sparse import csr_array

        place = self._places[k]
        return csr_array((stiffness.ravel()[place.data], place.indices, place.indptr), shape=place.shape)

    def _parts(self, stiffness: Array) -> tuple[Any, Any, Any]:
        """Return the stiffness free-free, free-tied and tied-tied, of forces on nodes."""
        from scipy.sparse import bsr_array

        if self.symmetry is None:
            return self._part(0, stiffness), self._part(1, stiffness), self._part(2, stiffness)
        pattern, n = self.part.pattern, 3 * len(self.body.mesh.nodes)
        whole = bsr_array((stiffness, pattern.column, pattern.start), shape=(n, n)).tocsr()
        tied = (3 * self.body.mesh.tied[:, None] + np.arange(3)).ravel()
        rows = (self._basis[0].T @ whole).tocsr()
        free = (rows @ self._basis[0]).tocsr()
        free.sort_indices()
        return free, rows[:, tied], whole[tied][:, tied]

    def _cap(self, x: Array) -> Array:
        """Return d(positions of the tied nodes) / d(the cap's unknowns), (3t, 6) or as many as a symmetry leaves."""
        moves = rigid.motions(x[self.body.mesh.tied])
        return moves if self.symmetry is None or not len(moves) else moves @ self.symmetry.cap

    def rest(self) -> State:
        """Return the body at rest without pressure."""
        return State(self.body.mesh.nodes, 0.0, np.zeros((*self.part.weight.shape, 7)))

    def reduce(self, x: Array, forces: Array) -> Array:
        """Return forces on nodes (n, 3) as forces on the unknowns (k,) [N]."""
        cap = self._cap(x).T @ forces[self.body.mesh.tied].ravel()
        free = forces.ravel()[self.free] if self.symmetry is None else self._basis[0].T @ forces.ravel()
        return np.concatenate([free, cap])

    def field(self, x: Array, step: Array) -> Array:
        """Return a step of the unknowns (k,) as displacements of all nodes (n, 3), to first order."""
        out, tied = np.zeros_like(x), self.body.mesh.tied
        if self.symmetry is None:
            out.ravel()[self.free] = step[: len(self.free)]
        else:
            out += (self._basis[0] @ step[: len(self.free)]).reshape(-1, 3)
        if len(tied):
            out[tied] = (self._cap(x) @ step[len(self.free) :]).reshape(-1, 3)
        return out

    def moved(self, state: State, step: Array, load: float, *, hold: bool = True, shift: Array | None = None) -> State:
        """Return the state after a step of the unknowns (k,) [m] and of the fixed components (f,) [m], at a load.

        hold: the stresses that its tangent holds are linearised along the step.
        """
        linear, tied = self.field(state.x, step), self.body.mesh.tied
        if shift is not None:
            linear[self.body.mesh.fixed] = shift
        x = state.x + linear
        if len(tied):
            cap = step[len(self.free) :]
            x[tied] = rigid.moved(state.x[tied], cap if self.symmetry is None else self.symmetry.cap @ cap)
        return State(x, load, self.part.linearised(state.x, linear) if hold else None)

    def shift(self, state: State, load: float) -> Array | None:
        """Return how far the fixed components are from where they stand at a load (f,) [m]; None: nowhere."""
        fixed = self.body.mesh.fixed
        return None if self.place is None else self.place(load)[fixed] - state.x[fixed]

    def balance(self, state: State) -> Balance:
        """Return the forces at a state, without a tangent. Raises Inverted."""
        inside, (area, volume) = self.part.forces(state.x), self.part.fluid(state.x)
        return self._balance(state, inside, area if self.dead is None else area - self.dead, volume)

    def _balance(self, state: State, inside: Forces, slope: Array, volume: float) -> Balance:
        total = inside.force + state.load * slope
        reduced = self.reduce(state.x, total), self.reduce(state.x, slope)
        return Balance(*reduced, volume, inside.energy, self.symmetry.average(total) if self.symmetry else total)

    def tangent(self, state: State) -> Tangent:
        """Return residual and factorised tangent of a state. Raises Inverted, or DidNotConverge where singular."""
        held = self.part.linearised(state.x, np.zeros_like(state.x)) if state.held is None else state.held
        forces = self.part.forces(state.x, held)
        slope, volume = self.part.fluid(state.x, state.load, forces.stiffness)
        if self.dead is not None:
            slope -= self.dead
        matrix, beside, cap = self._parts(forces.stiffness)
        moves, tied = self._cap(state.x), self.body.mesh.tied
        coupling = beside @ moves
        with solver.one_thread():
            if self.method == solver.RINGS:
                factor: solver.Factor = solver.BlockTridiagonal(matrix, self._ends, self._spare)
            else:
                factor = solver.SuperLU(matrix, symmetric=self.method == solver.SPARSE)
            solved = factor.solve(coupling) if moves.shape[1] else coupling
        schur = moves.T @ (cap @ moves) - coupling.T @ solved
        if len(tied):
            turns = np.eye(6)[3:] if self.symmetry is None else self.symmetry.cap[3:]
            schur += turns.T @ rigid.turning(state.x[tied], (forces.carried + state.load * slope)[tied]) @ turns
        across = None
        if self.place is not None:
            across = np.vstack([self._part(3, forces.stiffness).toarray(), moves.T @ self._part(4, forces.stiffness)])
        here = self._balance(state, forces, slope, volume)
        return Tangent(**vars(here), factor=factor, across=across, coupling=coupling, solved=solved, schur=schur)

    @property
    def softest(self) -> float:
        """The least shear modulus [Pa], which loads near 0 are measured against."""
        return self.body.softest
