"""TWIST to 20 kPa in felupe, in an environment of its own; not part of the packages.

argv[1]: JSON with mesh (an .npz file) and solver (default, symmetric). Prints one JSON object.
"""

import json
import sys
import time

import felupe
import numpy as np
from scipy.sparse.linalg import splu, spsolve


def symmetric(A, b, **_):
    """Solve by SuperLU in symmetric mode, which felupe can be given."""
    factor = splu(A.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return factor.solve(np.asarray(b).ravel())


def main(mesh, solver):
    """Solve and print twist [deg], Newton iterations and seconds, compilation of nothing included."""
    setup = time.perf_counter()
    given = np.load(mesh)
    nodes, part = given["nodes_mm"], given["material"]
    grid = felupe.Mesh(nodes, given["hexes"].astype(int), "hexahedron")
    field = felupe.FieldContainer([felupe.Field(felupe.RegionHexahedron(grid), dim=3)])
    law = felupe.NeoHooke(mu=given["mu_MPa"][part].reshape(1, -1))
    law.chunksize = None  # per-cell arrays of more than 1,024 cells
    solid = felupe.SolidBodyNearlyIncompressible(law, field, bulk=given["kappa_MPa"][part])
    pressed = np.isin(np.arange(len(nodes)), given["pressure_quads"])
    surface = felupe.RegionHexahedronBoundary(grid, only_surface=True, mask=pressed)
    fluid = felupe.SolidBodyPressure(felupe.FieldContainer([felupe.Field(surface, dim=3)]))
    held = felupe.Boundary(field[0], mask=np.isin(np.arange(len(nodes)), given["fixed_nodes"]))
    dof0, dof1 = felupe.dof.partition(field, {"fixed": held})
    setup = time.perf_counter() - setup
    started, steps = time.perf_counter(), 0
    for pressure_mpa in (5e-3, 10e-3, 15e-3, 20e-3):
        fluid.results.pressure = pressure_mpa
        found = felupe.newtonraphson(
            items=[solid, fluid],
            x0=field,
            dof0=dof0,
            dof1=dof1,
            tol=1e-8,
            maxiter=60,
            verbose=0,
            solver=symmetric if solver == "symmetric" else spsolve,
        )
        steps += found.iterations
    seconds = time.perf_counter() - started
    ring = given["ring_nodes"]
    rest, now = (x[ring, :2] - x[ring, :2].mean(axis=0) for x in (nodes, nodes + field[0].values))
    twist = np.arctan2((rest[:, 0] * now[:, 1] - rest[:, 1] * now[:, 0]).sum(), (rest * now).sum())
    answer = {"twist_deg": float(np.degrees(twist)), "iterations": int(steps), "seconds": seconds, "setup_s": setup}
    print(json.dumps(answer | {"version": felupe.__version__}))


if __name__ == "__main__":
    main(**json.loads(sys.argv[1]))
