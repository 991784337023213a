"""How far a tube's answers depend on its mesh: the same tube, solved again with a better discretisation.

A residual says that the equations of the mesh are solved, not that the mesh can say what the tube does. Elements of 8
nodes are compared with those of 20 nodes on the same mesh, which are curved and bend: their own error
is far less. Those of 20 nodes are compared with twice as many each way. The estimate is the difference.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput, DidNotConverge
from data.signal import Array

if TYPE_CHECKING:
    from fem.tube import Inflation

MOST_NODES = 400_000  # of the better mesh


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """Estimated errors of one equilibrium: what the better discretisation makes differently.

    displacement: norm over the shared nodes, over the norm of the displacements. twist, bending
    [rad] and extension [m] are differences, load (pressure or volume, whichever was not
    prescribed) is relative. against says with what.
    """

    displacement: float
    twist: float
    bending: float
    extension: float
    load: float
    against: str

    def require(self, most: float) -> None:
        """Raise DidNotConverge where the displacements are off by more than a share."""
        if not self.displacement <= most:
            raise DidNotConverge(
                f"mesh too coarse: {self.against} are displaced otherwise by {100 * self.displacement:.2g} %, "
                f"allowed {100 * most:g} %; try more divisions, or order=2"
            )


def estimate(run: "Inflation", index: int = -1) -> Accuracy:
    """Return the discretisation error of one equilibrium of a run, as seen by a better discretisation.

    Raises BadInput where that would be too large, DidNotConverge where it does not reach the load.
    """
    tube, index = run.tube, range(len(run.points))[index]
    fine = 2 if tube.order == 2 else 1
    around, along, through = tube.divisions
    divisions = (fine * around, fine * along, fine * through)
    if 4 * np.prod(divisions) > MOST_NODES:
        raise BadInput("accuracy", f"needs {divisions} elements of 20 nodes", f"has room for {MOST_NODES} nodes")
    better = replace(tube, order=2, divisions=divisions)
    loads = run.pressure if run.control == "pressure" else run.volume * better.rest_volume / tube.rest_volume
    other = better.inflate(loads[: index + 1], run.control)
    nodes, there = run.system.body.mesh.nodes, other.system.body.mesh.nodes
    mine, its = _shared(nodes, there, 1e-3 * tube.wall / max(divisions))
    u, v = run.displacement[index, mine], other.displacement[-1, its]
    ratio = run.volume[index] / tube.rest_volume * better.rest_volume / other.volume[-1]
    return Accuracy(
        displacement=float(np.linalg.norm(u - v) / (np.linalg.norm(v) or 1.0)),
        twist=float(abs(run.twist[index] - other.twist[-1])),
        bending=float(abs(run.bending[index] - other.bending[-1])),
        extension=float(abs(run.extension[index] - other.extension[-1])),
        load=abs(ratio * run.pressure[index] / (other.pressure[-1] or 1.0) - 1),
        against=f"{divisions[0]} x {divisions[1]} x {divisions[2]} elements of 20 nodes",
    )


def _shared(nodes: Array, there: Array, within: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the numbers of nodes at the same place in two meshes."""
    from scipy.spatial import cKDTree

    away, number = cKDTree(there).query(nodes)
    mine = np.flatnonzero(away < within)
    return mine, np.asarray(number, dtype=np.int64)[mine]
