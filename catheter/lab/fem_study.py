"""The studies of the finite elements: error against run time on known answers, stiff and extreme cases."""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from catheter.lab import fem_cases as cases
from catheter.lab.fem_peers import peer_rows
from catheter.lab.report import Progress, Report, Row, measure
from data.errors import CatheterError
from fem import grid
from fem.element import make_body
from fem.material import Law, NeoHooke
from fem.tube import Tube

ELEMENTS = {1: "Q1P0", 2: "20 nodes"}
MM, KPA = 1e-3, 1e3
CLOSED = "closed tube near its limit"
MOST_ERROR = 0.05  # of the displacements, beyond which a mesh is refused
CONVERGED_DEG = -4.7  # twist of TWIST at 20 kPa on fine meshes, to 1 %


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
        draw=partial(_panels, rows, others),
        notes=[
            f"First solves, with numba's compilation or its cache: {compiled:.1f} s, not in the rows.",
            "Truths: Rivlin's closed forms, collocation of the compressible tube; Cook and cantilever by fine meshes.",
            f"TWIST's truth is {CONVERGED_DEG} deg to 1 %: fine meshes of several codes.",
            _default_note(rows),
            *_twist_notes(quick),
            *peer_notes,
        ],
    )


def _default_note(rows: list[Row]) -> str:
    """Say why the default is what it is."""
    found = {(row.method, row.level): row for row in rows}
    q1, q2 = (found[f"TWIST to 20 kPa, twist, {ELEMENTS[o]}", f"32 x 32 x {n}"] for o, n in ((1, 2), (2, 1)))
    return (
        "Default: Q1P0, two elements through the wall. On a map of voxels, one element to a voxel, it is off by "
        f"{100 * q1.error:.2g} % in {q1.seconds:.2g} s, 20 nodes and one layer by {100 * q2.error:.2g} % in "
        f"{q2.seconds:.2g} s: corners of stiff voxels cost both their order. On smooth walls (thick tube, torsion) 20 "
        "nodes win by far: order=2."
    )


def _panels(rows: list[Row], others: list[Row], figure: Any) -> None:
    """Draw error over seconds, a panel a problem, a line an element; ours beside other tools in the last."""
    problems = list(dict.fromkeys(row.method.rpartition(", ")[0] for row in rows))
    figure.set_size_inches(14, 7)
    axes = figure.subplots(2, len(problems) // 2 + 1).ravel()
    for problem, panel in zip(problems, axes, strict=False):
        for element, style in zip(ELEMENTS.values(), ("o-", "s--"), strict=True):
            shown = [r for r in rows if r.method == f"{problem}, {element}" and not r.failed]
            panel.loglog([r.seconds for r in shown], [r.error for r in shown], style, label=element)
            for row in shown:
                panel.annotate(row.level, (row.seconds, row.error), fontsize=6)
        panel.set(title=problem, xlabel="seconds", ylabel="relative error")
        panel.grid(visible=True, which="both", alpha=0.3)
    for panel in axes[len(problems) : -1]:
        panel.set_axis_off()
    for row in others:
        axes[-1].loglog([row.seconds], [row.error], "o", label=row.method.partition(", ")[2])
    axes[-1].set(title="TWIST, same mesh, against six codes' digits", xlabel="seconds", ylabel="relative error")
    axes[-1].legend(fontsize=6)
    axes[0].legend()
    figure.suptitle("Finite elements: error against run time, by element and mesh")


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
                (
                    "closed tube near its limit",
                    order,
                    f"{around} x 1 x {n}",
                    partial(cases.closed_tube, n, around, order),
                ),
                ("torsion, torque", order, f"{turn} x {turn // 8}", partial(_torque, turn, order, 0)),
                ("torsion, axial force", order, f"{turn} x {turn // 8}", partial(_torque, turn, order, 1)),
                ("Cook", order, f"{16 * n // order} x {16 * n // order}", partial(cases.cook, 16 * n // order, order)),
                ("cantilever", order, f"{2 * n // order} across", partial(cases.cantilever, 2 * n // order, order)),
            ]
    meshes = ((1, 32, 1), (1, 32, 2), (2, 32, 1))
    for order, n, layers in meshes if quick else (*meshes, (1, 32, 4), (1, 64, 2), (2, 32, 2)):
        level = f"{n} x {n} x {layers}"
        found.append(("TWIST to 20 kPa, twist", order, level, partial(_twist, (n, n, layers), order)))
    return found


def _twist(divisions: tuple[int, int, int], order: int) -> cases.Case:
    run = twist_tube(divisions, order).inflate([20 * KPA])
    return cases.result(run.system, run.points, float(np.degrees(run.twist[0])), CONVERGED_DEG)


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
        notes=[
            "Errors of tubes in plane strain: against exact solutions. Contrast: displacements against 20-node "
            f"elements on the same grid (fem.accuracy), refused beyond {100 * MOST_ERROR:g} %. 150,000 unknowns: twist "
            f"against {CONVERGED_DEG} deg, where fine meshes of several codes meet to 1 %.",
        ],
    )


Extreme = tuple[str, str, Callable[[], tuple[float, float]]]


def _extremes(quick: bool) -> list[Extreme]:
    jobs: list[Extreme] = []
    for order, name in ELEMENTS.items():
        for nu in (0.49, 0.499, 0.4999, 0.49999):
            jobs.append((f"nu, {name}", f"{nu}", partial(_known, partial(cases.thick_tube, 2, 64, order, nu))))
        for ratio, layers in ((0.01, 1), (1 / 1.5, 4)):
            job = partial(cases.wall_tube, ratio, (64, 1, layers), order)
            jobs.append((f"wall/radius, {name}", f"{ratio:.3g}", partial(_known, job)))
        flat = partial(cases.wall_tube, 0.25, (32, 1, 50), order)
        jobs.append((f"aspect 50, {name}", "50 layers", partial(_known, flat)))
    for pattern in ("strips", "helix"):
        for finer, layers in ((1, 1), (2, 2)) if quick else ((1, 1), (1, 2), (2, 2), (3, 2)):
            level = f"{16 * finer} x {16 * finer} x {layers}"
            jobs.append((f"contrast 1e4, {pattern}, Q1P0", level, partial(_contrast, pattern, finer, layers)))
    jobs += [
        ("turned element", "Jacobian < 0", _turned),
        ("pressure 100 times too large", "2 MPa", _too_much),
    ]
    if not quick:
        jobs.append(("150,000 unknowns, Q1P0", "128 x 128 x 2", _large))
    return jobs


def _known(solve: Callable[[], cases.Case]) -> tuple[float, float]:
    case = solve()
    return case.error, case.residual


def _contrast(pattern: str, finer: int, layers: int) -> tuple[float, float]:
    """Inflate a tube of which parts are 10,000 times as stiff, and estimate the mesh's error."""
    voxels = np.full((16, 16), NeoHooke(c1=2e5), dtype=object)
    i, j = np.indices(voxels.shape)
    voxels[(i - j) % 8 < 2 if pattern == "helix" else j % 8 < 2] = NeoHooke(c1=2e9)
    sizes = {"length": 16 * MM, "outer_radius": 5 * MM, "wall": 1 * MM}
    tube = Tube(**sizes, divisions=(16 * finer, 16 * finer, layers), material=voxels)  # type: ignore[arg-type]
    run = tube.inflate([20 * KPA])
    found = run.accuracy()
    found.require(MOST_ERROR)
    return found.displacement, run.points[0].residuals[-1]


def _turned() -> tuple[float, float]:
    cube = grid.block((1.0, 1.0, 1.0), (1, 1, 1))
    hexes = cube.hexes[..., [1, 0, 3, 2, 5, 4, 7, 6]]
    law: Law = NeoHooke(c1=2e5)
    make_body(grid.solid(cube.nodes, hexes, np.zeros((8, 3), dtype=bool)), [law], np.zeros(1, dtype=np.int32))
    return np.nan, np.nan


def _too_much() -> tuple[float, float]:
    run = twist_tube((32, 32, 1)).inflate([2000 * KPA])
    return run.accuracy().displacement, run.points[0].residuals[-1]


def _large() -> tuple[float, float]:
    run = twist_tube((128, 128, 2)).inflate([20 * KPA])
    return abs(float(np.degrees(run.twist[0])) / CONVERGED_DEG - 1), run.points[0].residuals[-1]
