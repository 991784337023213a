"""The studies of the finite elements: error against run time on known answers, stiff and extreme cases."""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import numpy as np

from catheter.lab import fem_cases as cases
from catheter.lab.fem_peers import peer_rows
from catheter.lab.report import Progress, Report, Row, measure
from data.errors import CatheterError
from fem import grid
from fem.element import make_body
from fem.material import Law, NeoHooke
from fem.tube import Inflation, Tube

ELEMENTS = {1: "Q1P0", 2: "20 nodes"}
MM, KPA = 1e-3, 1e3


def twist_tube(divisions: tuple[int, int, int], order: int = 1, **given: float) -> Tube:
    """Return the reference twisting tube (TWIST), with an elastic disc unless a cap is given."""
    sizes = {"length": 32 * MM, "outer_radius": 5 * MM, "wall": 1 * MM, "cap": 2 * MM} | given
    tube = Tube(**sizes, divisions=divisions, order=order)  # type: ignore[arg-type]
    i, j = np.indices(tube.material.shape)
    tube.material[(i - j) % 16 < 4] = NeoHooke(c1=1.89e6)
    return tube


def fem(*, quick: bool, progress: Progress, peers: bool) -> Report:
    """Solve problems with known answers on finer and finer meshes with both elements."""
    started = time.perf_counter()
    for order in ELEMENTS:
        cases.thick_tube(1, 8, order)
    compiled = time.perf_counter() - started
    jobs = list(_jobs(quick))
    rows = []
    for done, (name, order, level, solve) in enumerate(jobs):
        rows.append(measure(f"{name}, {ELEMENTS[order]}", level, solve, _error))
        progress((done + 1) / len(jobs))
    others, peer_notes = peer_rows(twist_tube((32, 32, 1)), peers=peers)
    return Report(
        name="fem",
        title="Finite elements on problems with known answers: error against run time",
        level="mesh",
        error="relative error",
        rows=rows + others,
        notes=[
            f"First solves, with numba's compilation or its cache: {compiled:.1f} s, not in the rows.",
            "Truths: Rivlin's closed forms, collocation of the compressible tube; Cook and cantilever by fine meshes.",
            *_twist_notes(quick),
            *peer_notes,
        ],
    )


def _error(case: object) -> float:
    assert isinstance(case, cases.Case)
    return case.error


def _jobs(quick: bool) -> list[tuple[str, int, str, Callable[[], object]]]:
    found: list[tuple[str, int, str, Callable[[], object]]] = []
    for order in ELEMENTS:
        for n in (1, 2) if quick else (1, 2, 4):
            around, turn = 32 * n // order, 8 * (n + 1)
            found += [
                ("thick tube, bore", order, f"{around} x 1 x {n}", partial(cases.thick_tube, n, around, order)),
                ("closed tube, bore", order, f"{around} x 1 x {n}", partial(cases.closed_tube, n, around, order)),
                ("torsion, torque", order, f"{turn} x {turn // 8}", partial(_torque, turn, order, 0)),
                ("torsion, axial force", order, f"{turn} x {turn // 8}", partial(_torque, turn, order, 1)),
                ("Cook", order, f"{16 * n // order} x {16 * n // order}", partial(cases.cook, 16 * n // order, order)),
                ("cantilever", order, f"{2 * n // order} across", partial(cases.cantilever, 2 * n // order, order)),
            ]
    return found


def _torque(around: int, order: int, which: int) -> cases.Case:
    return cases.rivlin(around, order)[which]


def _twist_notes(quick: bool) -> list[str]:
    """Time TWIST on the way to 20 and to 100 kPa."""
    notes = []
    five = (20, 40, 60, 80, 100)
    for layers, order, loads in ((1, 1, (5, 10, 15, 20)), (1, 1, five), (2, 1, five), (1, 2, (20,)), (2, 1, (20,))):
        if quick and loads[-1] > 20:
            continue
        started = time.perf_counter()
        run = twist_tube((32, 32, layers), order).inflate(np.array(loads) * KPA)
        spent, steps = time.perf_counter() - started, int(run.iterations.sum())
        notes.append(
            f"TWIST (a), {ELEMENTS[order]}, {layers} layer(s), {len(loads)} steps to {loads[-1]} kPa: "
            f"twist {np.degrees(run.twist[-1]):.6f} deg, {steps} Newton iterations, {spent:.2f} s, {run.solver}."
        )
    return notes


def fem_stability(*, quick: bool, progress: Progress) -> Report:
    """Solve stiff and extreme cases: the residual to tolerance and the discretisation error beside it, or refused."""
    jobs = _extremes(quick)
    rows = []
    for done, (name, level, solve) in enumerate(jobs):
        started = time.perf_counter()
        try:
            error, residual = solve()
            row = Row(method=name, level=f"{level}; residual {residual:.0e}", error=error, seconds=0.0)
        except CatheterError as refused:
            row = Row(method=name, level=level, error=np.nan, seconds=0.0, failed=f"refused: {refused}"[:120])
        rows.append(replace(row, seconds=time.perf_counter() - started))
        progress((done + 1) / len(jobs))
    return Report(
        name="fem-stability",
        title="Extreme cases of the finite elements: discretisation error, or refused",
        level="case",
        error="relative error",
        rows=rows,
        notes=["Errors against exact solutions (tubes in plane strain), or against 20-node elements on the same grid."],
    )


Extreme = tuple[str, str, Callable[[], tuple[float, float]]]


def _extremes(quick: bool) -> list[Extreme]:
    jobs: list[Extreme] = []
    meshes = ((1, 1), (2, 1), (2, 2)) if quick else ((1, 1), (2, 1), (2, 2), (4, 4))
    for order, name in ELEMENTS.items():
        for nu in (0.49, 0.499, 0.4999, 0.49999):
            jobs.append((f"nu, {name}", f"{nu}", partial(_known, partial(cases.thick_tube, 2, 64, order, nu))))
        for ratio, layers in ((0.01, 1), (1 / 1.5, 4)):
            job = partial(cases.wall_tube, ratio, (64, 1, layers), order)
            jobs.append((f"wall/radius, {name}", f"{ratio:.3g}", partial(_known, job)))
        flat = partial(cases.wall_tube, 0.25, (32, 1, 50), order)
        jobs.append((f"aspect 50, {name}", "50 layers", partial(_known, flat)))
    jobs += [
        *(("contrast 1e4, Q1P0", f"16 x 16 x {n} times {m}", partial(_contrast, n, m)) for n, m in meshes),
        ("turned element", "Jacobian < 0", _turned),
        ("pressure 100 times too large", "2 MPa", partial(_inflated, (16, 16, 1), 2000 * KPA, np.nan)),
    ]
    if not quick:
        # an independent code's number on this mesh
        jobs.append(("150,000 unknowns, Q1P0", "128 x 128 x 2", partial(_inflated, (128, 128, 2), 20 * KPA, -4.59776)))
    return jobs


def _known(solve: Callable[[], cases.Case]) -> tuple[float, float]:
    case = solve()
    return case.error, case.residual


def _small(order: int, layers: int, finer: int) -> Inflation:
    voxels = np.full((16, 16), NeoHooke(c1=2e5), dtype=object)
    i, j = np.indices(voxels.shape)
    voxels[(i - j) % 8 < 2] = NeoHooke(c1=2e9)
    sizes = {"length": 16 * MM, "outer_radius": 5 * MM, "wall": 1 * MM}
    tube = Tube(**sizes, divisions=(16 * finer, 16 * finer, layers), material=voxels, order=order)  # type: ignore[arg-type]
    return tube.inflate([20 * KPA])


@cache
def _fine_twist() -> float:
    """The twist of the 20-node elements, two to a voxel and two through the wall [rad]."""
    return float(_small(2, 2, 2).twist[0])


def _contrast(layers: int, finer: int) -> tuple[float, float]:
    run = _small(1, layers, finer)
    return abs(float(run.twist[0]) / _fine_twist() - 1), run.points[0].residuals[-1]


def _turned() -> tuple[float, float]:
    cube = grid.block((1.0, 1.0, 1.0), (1, 1, 1))
    hexes = cube.hexes[..., [1, 0, 3, 2, 5, 4, 7, 6]]
    law: Law = NeoHooke(c1=2e5)
    make_body(grid.solid(cube.nodes, hexes, np.zeros((8, 3), dtype=bool)), [law], np.zeros(1, dtype=np.int32))
    return np.nan, np.nan


def _inflated(divisions: tuple[int, int, int], pressure: float, known_deg: float) -> tuple[float, float]:
    voxels = np.full((min(32, divisions[0]), min(32, divisions[1])), NeoHooke(c1=2e5), dtype=object)
    i, j = np.indices(voxels.shape)
    voxels[(i - j) % 16 < 4] = NeoHooke(c1=1.89e6)
    run = replace(twist_tube((32, 32, 1)), divisions=divisions, material=voxels).inflate([pressure])
    return abs(float(np.degrees(run.twist[0])) / known_deg - 1), run.points[0].residuals[-1]
