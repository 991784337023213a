"""A printed actuator designed anew with the materials that the printer really makes (thesis 6.5, the loop closed).

What is wanted is the motion of the design with the table's materials. Printed of calibrated ones
it moves otherwise; voxels are chosen anew between the two, until it moves as designed as nearly as
two materials can.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from catheter.calibrate import Calibration, calibrate, groups, twist_curve
from catheter.inflatable import Pattern, Shape
from catheter.reconstruction import Case, Wanted, tube_case, tube_voxels
from data.errors import BadInput
from data.signal import Array
from fem.inverse import Problem
from fem.observation import nodes, twist
from fem.palette import Printed, printed, swapped
from fem.voxels import Standing, Voxels

CURVE = 9  # pressures of the model's twist curve, rest included


def calibrated(
    shape: Shape, pattern: Pattern, pressure: Array, angle: Array, *, angle_sd: float, pressure_share: float
) -> Calibration:
    """Return the soft and the stiff modulus of a tube's two materials from pressures (n,) [Pa] and twists (n,) [rad].

    Raises BadInput for a map that has not two materials, and as `calibrate`.
    """
    levels = np.unique(pattern.moduli(shape.voxels[0], shape.voxels[1]))
    if len(levels) != 2:
        raise BadInput(f"map {pattern.pattern!r}", f"has {len(levels)} moduli", "a calibration needs two materials")
    stiff = pattern.stiff_voxels(shape.voxels[0], shape.voxels[1]).ravel()
    few = groups(tube_voxels(shape), stiff.astype(int))
    curve = twist_curve(few, np.linspace(0, float(pressure.max()) * 1.02, CURVE)[1:])
    return calibrate(curve, pressure, angle, angle_sd=angle_sd, pressure_share=pressure_share, seed=levels)


@dataclass(frozen=True, eq=False)
class Redesign:
    """The design as wanted, and what the calibrated materials make of it; moduli (2,) [Pa], soft and stiff.

    before: the design's map at its own pressure; driven: at the pressure_pa at which it twists as
    designed; after: voxels chosen anew, at that pressure. All simulated.
    """

    case: Case
    moduli: Array
    pressure_pa: float
    before: Printed
    driven: Printed
    after: Printed

    def errors(self, made: Printed) -> Array:
        """Return every node's distance from where the design puts it (n,) [m]."""
        return self.case.errors(made.standings)

    def twist(self, standing: Standing) -> float:
        """Return the twist of an equilibrium [rad], anticlockwise as seen from beyond the tip."""
        return _twist(self.case.voxels, standing)

    @property
    def rows(self) -> tuple[tuple[str, float, Printed], ...]:
        """What each of the three is, the pressure it is under [Pa], and what it does."""
        return (
            ("as printed, at the design's pressure", self.case.whole[0].state.load, self.before),
            ("as printed, at a pressure that twists as designed", self.pressure_pa, self.driven),
            ("voxels chosen anew, at that pressure", self.pressure_pa, self.after),
        )

    @property
    def changed(self) -> int:
        """How many voxels are of the other material."""
        return int((self.after.chosen != self.before.chosen).sum())


def _twist(voxels: Voxels, standing: Standing) -> float:
    mesh = voxels.mesh
    return twist(mesh.nodes[mesh.ring], standing.state.x[mesh.ring])


def redesign(
    shape: Shape,
    pattern: Pattern,
    moduli: Array,
    pressure_pa: float,
    *,
    rounds: int = 12,
    progress: Callable[[Printed], None] | None = None,
) -> Redesign:
    """Return pressure and map of two materials of given moduli, soft and stiff, that move most nearly as the design.

    The design is the pattern in the table's materials at pressure_pa; nearest by the distances of all
    nodes. Raises DidNotConverge where a map does not bear the pressure.
    """
    case = tube_case(shape, pattern, Wanted(pressures=(pressure_pa,)))
    voxels, levels = case.voxels, moduli.tolist()
    stiff = pattern.stiff_voxels(shape.voxels[0], shape.voxels[1]).ravel().astype(np.int64)
    before = printed(case.problem, stiff, levels, case.whole)
    at = _pressure(voxels, np.log(moduli[stiff]), _twist(voxels, case.whole[0]), pressure_pa)
    target = nodes(voxels.mesh, np.arange(len(voxels.mesh.nodes), dtype=np.int32), case.whole[0].state.x, at)
    problem = Problem(voxels, [target])
    driven = printed(problem, stiff, levels, None)
    after = swapped(problem, driven, levels, rounds=rounds, progress=progress)
    return Redesign(case, moduli, at, before, driven, after)


def _pressure(voxels: Voxels, log: Array, angle: float, near: float) -> float:
    """Return the pressure at which a map twists by an angle, by the secant from `near`."""
    from scipy.optimize import newton

    def off(pressure: float) -> float:
        return _twist(voxels, voxels.inflate(log, float(pressure))) - angle

    return float(newton(off, near, x1=1.02 * near, tol=1e-6 * near, maxiter=20))
