"""The studies of the kinematic design: speed beside a plain loop, extreme cases."""

import time
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from catheter.free import Array, Stretches, inflate, lock
from catheter.helix import Design, bend, design
from catheter.lab.free_plain import newton_finds, plain_cost
from catheter.lab.report import Progress, Report, Row, measure
from catheter.refine import approach
from catheter.robot import published
from catheter.search import cost_field, search
from catheter.task import DEGREE, Task
from data.errors import CatheterError

DESIGN = {"volume_ratio": 1.3, "radius": 5e-3, "length": 0.3}


def free(*, quick: bool, progress: Progress) -> Report:
    """Time whole grids beside a plain loop over designs, on a sample of them that both must agree on."""
    task = Task()
    angles, field = cost_field(task)
    cells = np.random.default_rng(1).integers(0, len(angles), (300 if quick else 3000, 3))
    started = time.perf_counter()
    plain = np.array([plain_cost(task, *angles[cell].tolist()) for cell in cells])
    each = (time.perf_counter() - started) / len(cells)
    ours = field[tuple(cells.T)]
    both = np.isfinite(plain) & np.isfinite(ours)
    off = float(np.max(np.abs(plain - ours)[both] / ours[both]))
    rows = []
    steps = (5.0, 2.0, 1.0) if quick else (5.0, 2.0, 1.0, 0.5, 0.25)
    for done, step in enumerate(steps):
        grid = replace(task, step=step * DEGREE)
        rows.append(measure("this project: whole grid", f"{step:g} deg", partial(search, grid), lambda _: off))
        size = (2 * int(90 / step) + 1) ** 3
        rows.append(Row(method="plain loop, from a sample", level=f"{step:g} deg", error=off, seconds=each * size))
        progress((done + 1) / len(steps))
    return Report(
        name="free",
        title="Search of a whole grid of fibre angles: agreement with a plain loop against run time",
        level="step",
        error="relative difference",
        rows=rows,
        notes=_speed_notes(rows[4].seconds, each, len(cells), int((np.isfinite(plain) ^ np.isfinite(ours)).sum())),
        draw=lambda figure: _draw_cost(figure, task, angles, field),
    )


def _speed_notes(seconds: float, each: float, sample: int, disagree: int) -> list[str]:
    ours = seconds / 181**3
    found = search(Task())
    way = approach(Task(), found.best, np.radians([72.0, 76.0, 80.0, 84.0, 88.0, 89.9]))
    falls = ", ".join(f"{np.degrees(p.design.alpha_rad):.4g} deg {p.cost:.5f}" for p in way)
    return [
        f"Per design: {1e9 * ours:.3g} ns at 1 deg, by the plain loop {1e9 * each:.3g} ns: {each / ours:,.0f} times.",
        f"Plain loop: {sample} designs drawn from the grid, scaled up; {disagree} of them feasible to one way only.",
        f"Cost by alpha, beta and gamma at their best: {falls}. At 90 deg the design is infeasible.",
    ]


def _draw_cost(figure: Any, task: Task, angles: Array, field: Array) -> None:
    from matplotlib.colors import LogNorm

    left, right = figure.subplots(1, 2)
    gamma = int(np.argmin(np.abs(angles - published()[2])))
    degrees = np.degrees(angles)
    shown = left.pcolormesh(degrees, degrees, field[:, :, gamma].T, norm=LogNorm(), rasterized=True)
    figure.colorbar(shown, ax=left, label="cost", location="bottom")
    left.set(
        xlabel="alpha, deg", ylabel="beta, deg", aspect="equal", title=f"gamma = {degrees[gamma]:.0f} deg; white: none"
    )
    alpha = np.radians(np.linspace(71.0, 89.9, 300))
    pair = Stretches(*(x[:, None] for x in vars(inflate(alpha, -alpha, task.volume_ratio)).values()))
    third = np.radians([-13.0, -14.0, -15.0])
    for gamma_rad, radius in zip(third, task.helix(pair, third).radius_m.T, strict=True):
        right.plot(np.degrees(alpha), 1e3 * radius, label=f"gamma {np.degrees(gamma_rad):.0f} deg")
    right.axhline(1e3 * task.wanted_radius, color="black", linewidth=0.8)
    right.set(xlabel="alpha = -beta, deg", ylabel="helix radius, mm", title="one degree of gamma")
    right.legend(fontsize=8)


Case = tuple[str, str, tuple[float, float, float], dict[str, Any]]


def cases() -> list[Case]:
    """Return the extreme cases: name, what is extreme, (alpha, beta, gamma) in deg, and what differs from the task."""
    at_lock = float(lock(72 * DEGREE, -72 * DEGREE).volume_ratio.item())
    return [
        ("published spiral", "V 1.30", (72, -72, -14), {}),
        ("alpha = beta", "72, 72", (72, 72, -14), {}),
        ("nearly alpha = beta", "72, 71.9999", (72, 71.9999, -14), {}),
        ("+-90 both", "90, -90", (90, -90, -14), {}),
        ("90 and another", "90, -89", (90, -89, -15), {}),
        ("zero angle", "0, 60", (0, 60, -14), {}),
        ("near zero angle", "1e-7, 60", (1e-7, 60, -14), {}),
        ("zero angles both", "0, 0", (0, 0, -14), {}),
        ("at the lock", "V of the lock", (72, -72, -14), {"volume_ratio": at_lock}),
        ("beyond the lock", "V 1.38", (72, -72, -14), {"volume_ratio": 1.38}),
        ("locked at rest", "54.7356", (np.degrees(np.arctan(np.sqrt(2))), -np.degrees(np.arctan(np.sqrt(2))), 0), {}),
        ("a hair before the axis", "88, 36", (88, 36, -14), {}),
        ("gamma = 0", "planar ring", (72, -72, 0), {}),
        ("psi -> infinity", "gamma 90", (72, -72, 90), {}),
        ("psi large", "gamma 89.999", (72, -72, 89.999), {}),
        ("third fibre = first", "gamma 72", (72, -72, 72), {}),
        ("r -> 0", "1e-9 m", (72, -72, -14), {"radius": 1e-9}),
        ("r = 0", "0 m", (72, -72, -14), {"radius": 0.0}),
        ("at rest", "V 1", (72, -72, -14), {"volume_ratio": 1.0}),
        ("deflation, extender", "V 0.9", (72, -72, -14), {"volume_ratio": 0.9}),
        ("deflation, contractor", "V 0.9", (30, -30, -14), {"volume_ratio": 0.9}),
        ("deflation to nothing", "V 1e-9", (30, -30, -14), {"volume_ratio": 1e-9}),
        ("deflation below range", "V 0.1", (20, -70, 0), {"volume_ratio": 0.1}),
        ("no volume", "V 0", (72, -72, -14), {"volume_ratio": 0.0}),
        ("not a number", "V nan", (72, -72, -14), {"volume_ratio": np.nan}),
        ("steeper than 90", "alpha 91", (91, -72, -14), {}),
    ]


def residual(found: Design) -> float:
    """Return how far a design is from meeting its three fibres (eq. 3.9 to 3.11) and its volume."""
    d = found.twist_rad * DESIGN["radius"] / DESIGN["length"]
    lines = [(found.alpha_rad, found.axial), (found.beta_rad, found.axial), (found.gamma_rad, found.limiter)]
    fibres = [(l1 * np.cos(x)) ** 2 + (found.radial * (np.sin(x) + d * np.cos(x))) ** 2 - 1 for x, l1 in lines]
    return float(np.max(np.abs([*fibres, found.axial * found.radial**2 / found.volume_ratio - 1])))


def free_stability(*, quick: bool, progress: Progress) -> Report:
    """Solve or refuse the extreme cases, and count what plain Newton loses."""
    rows = [_solved(*case) for case in cases()]
    progress(0.5)
    lost, notes = _lost()
    progress(1.0)
    return Report(
        name="free-stability",
        title="Extreme designs: solved to their residual, or refused",
        level="case",
        error="residual, or pairs lost",
        rows=rows + lost,
        notes=[
            "A residual grows with 1/sin(alpha - beta), and where a fibre comes to lie along the axis.",
            *notes,
            *_helix_notes(),
        ],
        draw=_draw_helix,
    )


def _solved(name: str, level: str, angles: tuple[float, float, float], differs: dict[str, Any]) -> Row:
    started = time.perf_counter()
    try:
        found = design(*(float(np.radians(x)) for x in angles), **DESIGN | differs)
    except CatheterError as error:
        spent = time.perf_counter() - started
        return Row(method=name, level=level, error=np.nan, seconds=spent, failed=f"refused: {error}")
    found = replace(found, twist_rad=found.twist_rad / DESIGN["radius"] * (DESIGN | differs)["radius"])
    return Row(method=name, level=level, error=residual(found), seconds=time.perf_counter() - started)


def _lost() -> tuple[list[Row], list[str]]:
    """Return, for each way of solving, the feasible pairs of the 1 deg grid that it loses."""
    grid = np.arange(-90, 91) * DEGREE
    alpha, beta = (x.ravel() for x in np.meshgrid(grid, grid, indexing="ij"))
    ours = inflate(alpha, beta, DESIGN["volume_ratio"])
    good = ours.feasible
    ways = {
        "plain Newton from l1 = 1 (thesis)": (np.array([1.3]), 100, False),
        "Newton in 13 volumes, 8 steps each": (np.linspace(1, 1.3, 13), 8, True),
    }
    rows, found = [], {}
    for name, (volumes, iterations, halve) in ways.items():
        started = time.perf_counter()
        x = newton_finds(alpha[good], beta[good], volumes, iterations=iterations, halve=halve)
        found[name] = np.isfinite(x)
        spent = time.perf_counter() - started
        lost = int((~found[name]).sum())
        rows.append(Row(method=name, level=f"{lost:,} of {good.sum():,}", error=float(lost), seconds=spent))
    plain, steps = found.values()
    return rows, [
        f"Feasible pairs: {good.sum():,}; the 13 volumes find {steps.sum():,}, plain Newton {plain.sum():,}, which is"
        f" {(steps & ~plain).sum():,} fewer than the 13 volumes and {(~plain).sum():,} fewer than there are.",
        f"The {(~steps).sum()} that the 13 volumes lose are sound: fibres of equal signs, the root next to where the"
        " flatter one lies along the axis and dV/dl1 grows without bound.",
    ]


def _helix_notes() -> list[str]:
    """Return the published design under both torsions, and how long each makes the third fibre."""
    notes = []
    for torsion in ("thesis", "exact"):
        found = design(*published(), **DESIGN, torsion=torsion)
        inner = np.hypot(found.radius_m - found.radial * DESIGN["radius"], found.pitch_m / (2 * np.pi))
        fibre = 2 * np.pi * found.turns * inner * np.cos(found.gamma_rad) / DESIGN["length"]
        notes.append(
            f"Published design, {torsion} torsion: R {1e3 * found.radius_m:.3f} mm, lambda_x {found.length_ratio:.4f},"
            f" phi {abs(np.degrees(found.angle_rad)):.2f} deg, pitch {1e3 * abs(found.pitch_m):.2f} mm; third fibre"
            f" {fibre - 1:+.2%} of its length."
        )
    return [*notes, "The targets of thesis Table 3.1 are R 9.5 mm, lambda_x 1."]


def _draw_helix(figure: Any) -> None:
    alpha, beta, gamma = published()
    most = float(lock(alpha, beta).volume_ratio.item())
    pair = inflate(alpha, beta, np.linspace(1.001, most * (1 - 1e-9), 400))
    left, right = figure.subplots(1, 2)
    for torsion in ("thesis", "exact"):
        helix = bend(pair, gamma, radius=DESIGN["radius"], length=DESIGN["length"], torsion=torsion)
        left.plot(pair.volume_ratio, 1e3 * helix.radius_m, label=f"{torsion} torsion")
        right.plot(pair.volume_ratio, helix.length_ratio, label=f"{torsion} torsion")
    left.axhline(9.5, color="black", linewidth=0.8)
    left.set(xlabel="volume ratio", ylabel="helix radius, mm", title="published spiral, up to its lock")
    right.set(xlabel="volume ratio", ylabel="lambda_x")
    left.legend(fontsize=8)
