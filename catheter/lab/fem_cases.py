"""Problems with known answers for the finite elements: what is solved, and how far off it is."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data.signal import Array
from fem import exact, grid, tube_grid
from fem.continuation import Point, follow
from fem.element import make_body
from fem.equilibrium import Newton, System
from fem.material import NeoHooke

MPA, MM = 1e6, 1e-3


@dataclass(frozen=True, kw_only=True)
class Case:
    """A problem at one mesh: relative error of what it asks for, unknowns and Newton iterations."""

    error: float
    value: float
    unknowns: int
    iterations: int
    residual: float


def result(system: System, points: Sequence[Point], value: float, truth: float) -> Case:
    """Return what a solved problem's last point is worth."""
    spent = sum(p.iterations for p in points)
    return Case(
        error=abs(value / truth - 1),
        value=value,
        unknowns=len(system.free),
        iterations=spent,
        residual=points[-1].residuals[-1],
    )


def _system(mesh: grid.Mesh, law: NeoHooke, **given: object) -> System:
    return System(make_body(mesh, [law], np.zeros(len(mesh.hexes), dtype=np.int32)), Newton(), **given)  # type: ignore[arg-type]


def _ring(divisions: tuple[int, int, int], order: int, wall: float = 1 * MM) -> grid.Mesh:
    """Return a slice, 1 mm, of a tube of 5 mm outside between planes; rigid motions held."""
    cut = tube_grid.tube_lattice(1 * MM, 5 * MM, wall, divisions, order)
    x, y, _ = cut.nodes.T
    small = 1e-9 * MM
    fixed = np.stack([np.abs(x) < small, np.abs(y) < small, np.ones(len(x), dtype=bool)], axis=1)
    return grid.solid(cut.nodes, cut.hexes, fixed, cut.face("w0"))


def thick_tube(layers: int, around: int, order: int, nu: float = 0.499) -> Case:
    """Inflate a long tube 4/5 mm under plane strain to a bore of 5 mm: the bore's displacement."""
    mesh = _ring((around, 1, layers), order)
    system = _system(mesh, NeoHooke(c1=0.2 * MPA, nu=nu))
    points = follow(system, [46819.304])
    truth = exact.compressible_tube(4 * MM, 5 * MM, 0.4 * MPA, nu, 46819.304)[0]
    return result(system, points, bore_radius(mesh, points[-1]) - 4 * MM, truth - 4 * MM)


def bore_radius(mesh: grid.Mesh, point: Point) -> float:
    """Return the mean radius of the pressed faces' corners [m]."""
    return float(np.hypot(*point.x[np.unique(mesh.pressed[:, :4]), :2].T).mean())


def wall_tube(ratio: float, divisions: tuple[int, int, int], order: int, nu: float = 0.499) -> Case:
    """Inflate a tube of 5 mm outside whose wall is a share of its bore radius by 10 %: the bore's displacement."""
    outer, inner = 5 * MM, 5 * MM / (1 + ratio)
    mesh = _ring(divisions, order, wall=outer - inner)
    system = _system(mesh, NeoHooke(c1=0.2 * MPA, nu=nu))
    tube = exact.ThickTube(inner=inner, outer=outer, mu=0.4 * MPA)
    pressure = float(tube.pressure(1.1 * inner))
    points = follow(system, [pressure])
    truth = exact.compressible_tube(inner, outer, 0.4 * MPA, nu, pressure)[0]
    return result(system, points, bore_radius(mesh, points[-1]) - inner, truth - inner)


def closed_tube(layers: int, around: int, order: int, bore: float = 6 * MM, nu: float = 0.49999) -> Case:
    """Inflate a closed-end tube's slice, stretched as Rivlin's solution says, to 64.1 of 66.9 kPa: the bore."""
    mesh = _ring((around, 1, layers), order)
    tube = exact.ThickTube(inner=4 * MM, outer=5 * MM, mu=0.4 * MPA)
    path = np.array([(tube.closed(a)[0], tube.closed(a)[1] - 1) for a in np.linspace(4 * MM, bore, 9)[1:]])

    def place(load: float) -> Array:
        pull = np.interp(load, np.append(0, path[:, 0]), np.append(0, path[:, 1]))
        return np.asarray(mesh.nodes * [1, 1, 1 + pull])

    system = _system(mesh, NeoHooke(c1=0.2 * MPA, nu=nu), place=place)
    points = follow(system, path[:, 0])
    return result(system, points, bore_radius(mesh, points[-1]) - 4 * MM, bore - 4 * MM)


def rivlin(around: int, order: int, nu: float = 0.49999) -> tuple[Case, Case]:
    """Twist a solid cylinder of 5 mm radius by 0.08 rad/mm at fixed length: torque, axial force."""
    angle = 2 * np.pi * np.arange(around * order) / (around * order)
    rim = 5 * MM * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    tall = around // 8 * order
    heights = 1 * MM * np.arange(tall + 1) / tall
    parts = tube_grid.rod(rim, heights, order, collar=around // 8)
    nodes, new = grid.merge([p.nodes for p in parts], 1e-9)
    hexes = np.vstack([number[p.hexes].reshape(-1, p.hexes.shape[-1]) for number, p in zip(new, parts, strict=True)])
    ends = np.isin(nodes[:, 2], heights[[0, -1]])
    return _torsion(grid.solid(nodes, hexes, np.repeat(ends[:, None], 3, axis=1)), nu)


def _torsion(mesh: grid.Mesh, nu: float) -> tuple[Case, Case]:
    def place(load: float) -> Array:
        turn = load * mesh.nodes[:, 2]
        x, y, z = mesh.nodes.T
        return np.stack([x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn), z], axis=1)

    system = _system(mesh, NeoHooke(c1=0.2 * MPA, nu=nu), place=place)
    points = follow(system, [40.0, 80.0])
    top = mesh.nodes[:, 2] > mesh.nodes[:, 2].max() - 1e-9
    force, at = points[-1].reaction[top], points[-1].x[top]
    moment, axial = exact.torsion(5 * MM, 80.0, 0.4 * MPA)
    torque = float((at[:, 0] * force[:, 1] - at[:, 1] * force[:, 0]).sum())
    return result(system, points, torque, moment), result(system, points, float(force[:, 2].sum()), axial)


def _end_load(lattice: grid.Lattice, direction: int, total: float) -> Array:
    """Return a uniform traction on face v1 as consistent nodal forces (n, 3) [N]."""
    quads = lattice.face("v1").reshape(-1, 4 if lattice.hexes.shape[-1] == 8 else 8)
    share = np.full(4, 0.25) if quads.shape[1] == 4 else np.array([-1 / 12] * 4 + [1 / 3] * 4)
    out = np.zeros_like(lattice.nodes)
    for quad in quads:
        out[quad, direction] += share * total / len(quads)
    return out


def cook(n: int, order: int) -> Case:
    """Cook's membrane, n x n, plane strain, mu 80.1938, K 400889.806 MPa, 100 N: tip displacement against 6.9346 mm."""
    flat = grid.block((1.0, 1.0, 1.0), (n, n, 1), order=order)
    x, y, z = flat.nodes.T
    nodes = np.stack([48 * x, 44 * x + y * (44 - 28 * x), z], axis=1) * MM
    fixed = np.stack([x == 0, x == 0, np.ones_like(x, dtype=bool)], axis=1)
    mu, bulk = 80.1938 * MPA, 400889.806 * MPA
    law = NeoHooke(c1=mu / 2, nu=(3 * bulk - 2 * mu) / (2 * (3 * bulk + mu)))
    system = _system(grid.solid(nodes, flat.hexes, fixed), law, dead=_end_load(flat, 1, 100.0))
    points = follow(system, [1.0])
    tip = int(np.argmin(np.abs(x - 1) + np.abs(y - 1) + np.abs(z)))
    return result(system, points, float(points[-1].x[tip, 1] - nodes[tip, 1]), 6.9346 * MM)


def cantilever(across: int, order: int) -> Case:
    """A beam 10 x 1 x 1 mm, mu 0.4 MPa, nu 0.499, end load 1.2e-3 N: lower corner's displacement against 3.54 mm."""
    beam = grid.block((10 * MM, 1 * MM, 1 * MM), (10 * across, across, across), order=order)
    fixed = np.repeat(beam.nodes[:, :1] == 0, 3, axis=1)
    law = NeoHooke(c1=0.2 * MPA, nu=0.499)
    system = _system(grid.solid(beam.nodes, beam.hexes, fixed), law, dead=_end_load(beam, 2, 1.2e-3))
    points = follow(system, [1.0])
    tip = int(np.argmin(np.abs(beam.nodes - [10 * MM, 0, 0]).sum(axis=1)))
    return result(system, points, float(points[-1].x[tip, 2]), 3.54 * MM)
