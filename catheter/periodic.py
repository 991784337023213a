"""The periodic steady state of a circuit, found directly instead of waited for."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from catheter.circuit import Circuit
from catheter.drive import Drive
from catheter.hydraulics import Run, Solver, run_of
from data.errors import BadInput, DidNotConverge
from data.options import option
from data.signal import Array


@dataclass(frozen=True, kw_only=True)
class Closing:
    """When a cycle counts as closed: its first state is known to `settle` times the solver's tolerance.

    A cycle much shorter than the circuit's slowest time constant (1.6 s for the thesis's robot)
    hides a large error of the state in a small gap between its ends, so that error is what counts;
    the same ratio magnifies the integration error, which is why `settle` is not 1.
    """

    settle: float = option(10.0, least=0.1, most=1e6)
    most_cycles: int = option(40, least=1, most=10_000)


@dataclass(frozen=True, eq=False)
class Orbit:
    """One closed cycle: the run, dV(T)/dV(0) (N, N), the error of the first state, cycles it took to find."""

    run: Run
    derivative: Array
    error: float
    cycles: int


def periodic(
    circuit: Circuit,
    drive: Drive,
    *,
    solver: Solver | None = None,
    closing: Closing | None = None,
    guess: ArrayLike | None = None,
) -> Orbit:
    """Return the cycle of the circuit that ends as it begins, under a drive that is one period.

    Newton's method on V(T) - V(0) = 0 with the exact derivative of every step. guess: volume
    coefficients (N,), by default those of a very fast cycle. Raises DidNotConverge with the error
    that was left, and what `simulate` raises.
    """
    from catheter import circuit_kernel as kernel

    solver, closing = solver or Solver(), closing or Closing()
    if solver.method != "rodas5p":
        raise BadInput("solver, method", f"is {solver.method!r}", "only 'rodas5p' carries derivatives")
    table, n, settle = circuit.table(), len(circuit.segments), closing.settle * solver.tolerance
    lower, upper = kernel.bounds(table, drive.breaks_s, drive.pieces)
    if not ((lower > -1) & np.isfinite(upper)).all():
        raise BadInput("drive", "has pressures that no volume holds", "choose pressures nearer to 0")
    if guess is None:
        begin = kernel.balance(table, drive.breaks_s, drive.pieces, lower, upper)
    else:
        begin = np.array(guess, dtype=np.float64) - 1.0
        if begin.shape != (n,) or not np.isfinite(begin).all():
            raise BadInput("guess", f"is {begin + 1.0}", f"expected {n} volume coefficients")
    status, where, cycles, error, _, _, *arrays = kernel.periodic(
        *(table, drive.breaks_s, drive.pieces, begin, 0, 1.0, settle),
        *(closing.most_cycles, solver.tolerance, solver.most_steps),
    )
    found: tuple[Any, ...] = (status, where, *arrays)
    run = run_of(circuit, drive, solver, found)
    if not error <= settle:
        raise DidNotConverge(
            f"periodic state: after {cycles} cycles the state is known to {error:.3g}, not {settle:.3g}; "
            "lower the solver's tolerance, or raise settle or most_cycles"
        )
    derivative = found[6][found[2], n:].reshape(n, n).T
    return Orbit(run, derivative, float(error), int(cycles))
