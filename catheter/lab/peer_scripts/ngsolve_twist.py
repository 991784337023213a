"""TWIST to 20 kPa in NGSolve, in an environment of its own; not part of the packages.

argv[1]: JSON with mesh (an .npz file). Displacements of order 1 with one pressure an element, which is
the mean dilatation of the other codes; the pressures are condensed element by element. Prints one JSON object.
"""

import json
import sys
import time

import ngsolve as ng
import numpy as np
from netgen.meshing import Element2D, Element3D, FaceDescriptor, Mesh, MeshPoint, Pnt


def meshed(given):
    """Return the reference mesh; the pressed faces are its only boundary elements."""
    mesh = Mesh(dim=3)
    points = [mesh.Add(MeshPoint(Pnt(*node))) for node in given["nodes_mm"].tolist()]
    mesh.Add(FaceDescriptor(surfnr=1, domin=1, domout=0, bc=1))
    for corners, part in zip(given["hexes"].tolist(), given["material"].tolist(), strict=True):
        mesh.Add(Element3D(part + 1, [points[k] for k in corners]))
    for corners in given["pressure_quads"].tolist():
        mesh.Add(Element2D(1, [points[k] for k in corners]))
    for part in range(len(given["mu_MPa"])):
        mesh.SetMaterial(part + 1, f"m{part}")
    return ng.Mesh(mesh)


def main(mesh):  # noqa: PLR0915, one recipe
    """Solve and print twist [deg], Newton iterations, seconds, and those of the setup apart."""
    given = np.load(mesh)
    started = time.perf_counter()
    grid = meshed(given)
    nodes = given["nodes_mm"]
    count = len(nodes)
    pair = given["mu_MPa"], given["kappa_MPa"]
    parts = {f"m{k}": (float(m), float(b)) for k, (m, b) in enumerate(zip(*pair, strict=True))}
    mu = grid.MaterialCF({name: values[0] for name, values in parts.items()})
    kappa = grid.MaterialCF({name: values[1] for name, values in parts.items()})
    space = ng.VectorH1(grid, order=1) * ng.L2(grid, order=0)
    (u, p), (v, _) = space.TnT()
    rule = {ng.HEX: ng.IntegrationRule(ng.HEX, 3), ng.QUAD: ng.IntegrationRule(ng.QUAD, 3)}
    F = ng.Id(3) + ng.Grad(u)
    J = ng.Det(F)
    energy = mu / 2 * (J ** (-2 / 3) * ng.InnerProduct(F, F) - 3) + p * (J - 1) - p * p / (2 * kappa)
    pressure = ng.Parameter(0.0)
    surface = ng.Id(3) + ng.Grad(u).Trace()
    form = ng.BilinearForm(space, symmetric=True, condense=True)
    form += ng.Variation(energy.Compile() * ng.dx(intrules=rule))
    push = ng.BilinearForm(space)  # the fluid's part alone, whose size the residual is measured against
    work = pressure * ng.InnerProduct(ng.Cof(surface) * ng.specialcf.normal(3), v.Trace())
    form += work.Compile() * ng.ds(intrules=rule)
    push += work.Compile() * ng.ds(intrules=rule)
    free = ng.BitArray(space.FreeDofs(coupling=True))
    for node in given["fixed_nodes"].tolist():
        for axis in range(3):
            free.Clear(axis * count + node)
    moving = np.array([free[k] for k in range(3 * count)])
    state = ng.GridFunction(space)
    residual, load, step = (state.vec.CreateVector() for _ in range(3))
    setup = time.perf_counter() - started
    started, steps = time.perf_counter(), 0
    for pressure_mpa in (5e-3, 10e-3, 15e-3, 20e-3):
        pressure.Set(pressure_mpa)
        for _ in range(60):
            form.Apply(state.vec, residual)
            push.Apply(state.vec, load)
            force = np.linalg.norm(residual.FV().NumPy()[: 3 * count][moving])
            size = np.linalg.norm(load.FV().NumPy()[: 3 * count][moving])
            volumes = np.abs(residual.FV().NumPy()[3 * count :]).max()  # J - 1 - p/kappa, times the element's volume
            if force <= 1e-8 * size and volumes <= 1e-10:
                break
            form.AssembleLinearization(state.vec)
            inverse = form.mat.Inverse(free, inverse="sparsecholesky")
            residual.data += form.harmonic_extension_trans * residual
            step.data = inverse * residual
            step.data += form.harmonic_extension * step
            step.data += form.inner_solve * residual
            state.vec.data -= step
            steps += 1
        else:
            raise RuntimeError(f"residual {force / size:.1e} of the load after 60 iterations")
    seconds = time.perf_counter() - started
    ring = given["ring_nodes"]
    moved = nodes + state.components[0].vec.FV().NumPy().reshape(3, count).T
    rest, now = (x[ring, :2] - x[ring, :2].mean(axis=0) for x in (nodes, moved))
    twist = np.arctan2((rest[:, 0] * now[:, 1] - rest[:, 1] * now[:, 0]).sum(), (rest * now).sum())
    answer = {"twist_deg": float(np.degrees(twist)), "iterations": steps, "seconds": seconds, "setup_s": setup}
    print(json.dumps(answer | {"version": ng.__version__}))


if __name__ == "__main__":
    main(**json.loads(sys.argv[1]))
