"""Section 3.1: the circuit's periodic cycle, its events, the map of the valves, the stroke; Figs 3.11, 3.13, 3.16."""

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from catheter.circuit import DENSITY_KG_M3, DISCHARGE, Circuit, thesis_circuit
from catheter.drive import SquareWave
from catheter.hydraulics import Solver
from catheter.lab import plot
from catheter.lab.thesis.entries import Entry, Figure, Section, claim, compare
from catheter.locomotion import stroke
from catheter.optimum import optimum
from catheter.periodic import Orbit, periodic
from catheter.robot import Extender
from catheter.sweep import Scatter, built, coefficient_map, grid_coefficients
from catheter.tuning import NAMES, Marks, Score, evaluate
from data.signal import Array
from data.table import table
from data.units import quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

TEXT = "3.text"
FRAME_S = 1 / 24  # of the thesis's video
_HAPPENS = ("rear spiral anchored", "front spiral touches", "rear spiral lets go", "front spiral lets go")
EVENTS = dict(zip(NAMES, _HAPPENS, strict=True))
ACTUATORS = ("Act 1, spiral", "Act 2, extender", "Act 3, spiral")
GRID_NOTE = "a flat ridge: 96.6 % of the largest objective at the published values"


def locomotion(*, quick: bool) -> Section:
    """Bring the published circuit to its periodic state and search its valves; the coarse map is for `quick`."""
    circuit, source, marks = thesis_circuit(0.01), SquareWave(), Marks()
    orbit = periodic(circuit, source.drive(), solver=Solver(tolerance=1e-9))
    score = evaluate(circuit, source, marks)
    grid = grid_coefficients()[:: 6 if quick else 1]
    field = coefficient_map(thesis_circuit(), source, marks, grid)
    robots = built(thesis_circuit(), source, marks, Scatter(samples=100 if quick else 1000))
    entries = [*_events(score), *_volumes(orbit, score), *_stroke(score)]
    entries += [*_valves(thesis_circuit(), source, marks, grid, field), *_printed(circuit, score)]
    figures = [
        Figure(number="3.11", title="objective over K2 and K3", kind="simulated", draw=partial(_map, grid, field)),
        Figure(number="3.13", title="volumes over a cycle", kind="simulated", draw=partial(_cycle, orbit, score)),
        Figure(number="3.16", title="times forward and reverse", kind="simulated", draw=partial(_times, robots, score)),
    ]
    return Section(entries=entries, figures=figures)


def _events(score: Score) -> list[Entry]:
    times = dict(zip(NAMES, score.events_s[0].tolist(), strict=True))
    source = SquareWave()
    found = [compare(TEXT, f"{name}, {what}", times[name]) for name, what in EVENTS.items()]
    found.append(compare(TEXT, "tD, source switches off", source.period * source.duty))
    found.append(compare(TEXT, "tG, end of the cycle", source.period))
    forward, reverse = times["tC"] - times["tB"], times["tF"] - times["tE"]
    found += [compare(TEXT, "duration of Vfwd", forward), compare(TEXT, "duration of Vrev", reverse)]
    off = max(abs(phase - 0.14) for phase in (forward, reverse)) / FRAME_S
    found.append(claim(TEXT, "mean timing within one video frame", f"simulated phases off by {off:.1f} frames",
                       holds=False))  # fmt: skip
    a, b = float(score.forward[0]), float(score.reverse[0])
    told = f"V2 changes by {a:.3f} and {b:.3f}"
    found.append(claim(TEXT, "expansion and retraction are roughly equal", told, holds=abs(a / b - 1) < 0.2))
    return found


def _volumes(orbit: Orbit, score: Score) -> list[Entry]:
    times = np.linspace(0.0, 2.0, 4001)
    volume, pressure = orbit.run.at(times), orbit.run.pressure_pa(times)
    found = [compare(TEXT, f"final volume coefficient of Act {i + 1}", float(volume[:, i].max())) for i in range(3)]
    found.append(compare(TEXT, "least volume coefficient of Act 3", float(volume[:, 2].min())))
    found.append(compare(TEXT, "largest pressure allowed", float(pressure.max())))
    whole = float(np.ptp(volume[:, 1]))
    shares = {"forward": float(score.forward[0]) / whole, "reverse": float(score.reverse[0]) / whole}
    return found + [compare(TEXT, f"useful share of extension, {name}", share) for name, share in shares.items()]


def _stroke(score: Score) -> list[Entry]:
    metres = stroke(score.extender[0], Extender()).stroke_m
    names = ("stroke of a cycle, predicted", "stroke of a cycle, measured +- 4 mm")
    return [compare(TEXT, name, metres) for name in names]


def _valves(circuit: Circuit, source: SquareWave, marks: Marks, grid: Array, field: Score) -> list[Entry]:
    first = circuit.segments[0].valve.coefficient
    n2, n3 = np.unravel_index(int(field.objective.argmax()), (len(grid), len(grid)))
    best = optimum(circuit.with_coefficients(first, grid[n2], grid[n3]), source, marks)
    found = [
        compare("3.4", f"Valve {i + 1}", best.circuit.segments[i].valve.coefficient, "optimal", reason=GRID_NOTE)
        for i in (1, 2)
    ]
    here = float(evaluate(circuit, source, marks).objective[0])
    found.append(compare(TEXT, "J at the published valves over its largest", here / best.objective))
    fall = []
    for moved in (1, 2):
        values = [s.valve.coefficient for s in best.circuit.segments]
        values[moved] *= 1.1
        changed = float(evaluate(circuit.with_coefficients(*values), source, marks).objective[0])
        fall.append(100 * (1 - changed / best.objective))
    told = f"10 % more K2 costs {fall[0]:.2f} % of J, 10 % more K3 {fall[1]:.2f} %"
    found.append(claim(TEXT, "J is more sensitive to K3 than to K2", told, holds=fall[1] > fall[0]))
    area = _step([table("3.4").value(f"Valve {i}", "optimal") for i in (2, 3)])
    return [*found, compare(TEXT, "grid step of orifice area", area)]


def _step(optima: list[float]) -> float:
    """Return the largest of 5, 2, 1 times a power of ten [m^2] of which both K are multiples, as far as printed."""
    for step in (n * 10.0**-e for e in range(7, 12) for n in (5, 2, 1)):
        each = DISCHARGE * step * np.sqrt(2 / DENSITY_KG_M3)
        misses = [abs(k - round(k / each) * each) for k in optima]
        if misses[0] <= 0.5e-9 and misses[1] <= 0.5e-10:
            return step
    return float("nan")


def _printed(circuit: Circuit, score: Score) -> list[Entry]:
    """Return what (3.21) to (3.24) say as printed, and the constants of the text."""
    a, b = float(score.forward[0]), float(score.reverse[0])
    signed = a**2 + b**2 - (-a - b) ** 2
    flow = 1e6 * circuit.segments[1].valve.coefficient * 1e3**0.5
    return [
        claim(TEXT, "Vfwd and Vrev of (3.22), (3.23)", f"J = {2 * a * b:.4f} by magnitudes, {signed:.4f} as printed",
              holds=False),
        claim(TEXT, "(3.21)", f"valve 2 at 1 kPa: {flow:.2f} mL/s either way, as printed into Act 2 only", holds=False),
        compare(TEXT, "source pressure of 12 psi", quantity("12 psi", "Pa")),
        compare(TEXT, "density of water at 23 C", water_density_kg_m3(23.0)),
    ]  # fmt: skip


def water_density_kg_m3(celsius: float) -> float:
    """Return the density of air-free water at 101.325 kPa, 0 to 150 C (Kell, J. Chem. Eng. Data 20, 1975, eq. 16)."""
    over = (999.83952, 16.945176, -7.9870401e-3, -46.170461e-6, 105.56302e-9, -280.54253e-12)
    return float(np.polynomial.polynomial.polyval(celsius, over) / (1 + 16.879850e-3 * celsius))


def _map(grid: Array, field: Score, figure: "Drawing") -> None:
    k, objective = grid * 1e6, field.objective.reshape(len(grid), len(grid))
    axes = plot.axes(figure, ("K2", "1e-6 m^3 Pa^-1/2 s^-1"), ("K3", "1e-6 m^3 Pa^-1/2 s^-1"), log="xy")
    shown = axes.contourf(k, k, objective.T, levels=24, cmap="viridis")
    figure.colorbar(shown, label="J [1]")
    n2, n3 = np.unravel_index(int(objective.argmax()), objective.shape)
    valves = [table("3.4").value(f"Valve {i}", "optimal") * 1e6 for i in (2, 3)]
    axes.plot(k[n2], k[n3], "ko", label=f"largest of the map: {k[n2]:.3f}, {k[n3]:.4f}")
    axes.plot(*valves, "w^", markeredgecolor="k", label=f"published: {valves[0]:.3f}, {valves[1]:.4f}")
    axes.legend(fontsize=8)


def _cycle(orbit: Orbit, score: Score, figure: "Drawing") -> None:
    axes = plot.axes(figure, ("time", "s"), ("volume coefficient V", "1"))
    times = np.concatenate([start + np.geomspace(1e-4, 1.0, 600) for start in (0.0, 1.0)])
    for index, (name, volume) in enumerate(zip(ACTUATORS, orbit.run.at(times).T, strict=True)):
        axes.plot(times, volume, color=plot.COLOURS[index], label=name)
    for first, last in ((0, 1), (2, 3)):
        part = np.linspace(float(score.events_s[0, first]), float(score.events_s[0, last]), 100)
        axes.plot(part, orbit.run.at(part)[:, 1], color=plot.COLOURS[1], linewidth=4)
    published = [table(TEXT).value(f"{name}, {what}", "published") for name, what in EVENTS.items()]
    for name, ours, printed in zip(NAMES, score.events_s[0], published, strict=True):
        axes.axvline(ours, color="0.3", linewidth=0.8)
        axes.axvline(printed, color="0.3", linewidth=0.8, linestyle=":")
        axes.text(ours, 1.01, name, fontsize=8, transform=axes.get_xaxis_transform())
    for level in (Marks().contact, Marks().anchored):
        axes.axhline(level, color="0.7", linewidth=0.8)
    axes.plot([], [], color="0.3", label="event, ours")
    axes.plot([], [], color="0.3", linestyle=":", label="event, published")
    axes.legend(fontsize=8, loc="lower center")


def _times(robots: Score, score: Score, figure: "Drawing") -> None:
    """Draw the phases of robots built with scatter, in place of the reviewers' readings, which are not published."""
    axes = plot.axes(figure, ("", ""), ("phase", "ms"))
    pairs = {"forward, tC - tB": (0, 1), "reverse, tF - tE": (2, 3)}
    spread = [1e3 * (robots.events_s[:, last] - robots.events_s[:, first]) for first, last in pairs.values()]
    spread = [values[np.isfinite(values)] for values in spread]
    axes.boxplot(spread, notch=True, whis=(5, 95), showfliers=False)
    axes.set_xticks([1, 2], list(pairs))
    for at, (first, last) in enumerate(pairs.values(), start=1):
        axes.plot(at, 1e3 * (score.events_s[0, last] - score.events_s[0, first]), "D", color=plot.COLOURS[1],
                  label="published circuit" if at == 1 else None)  # fmt: skip
    axes.axhline(140, color="k", label="published: 140 ms")
    for off in (-1, 1):
        axes.axhline(140 + off * 1e3 * FRAME_S, color="k", linestyle=":", label="one video frame" if off > 0 else None)
    axes.legend(fontsize=8)
    axes.set_title("robots built with scatter (K 2 %, stiffness and volume 5 %): box, and 5 to 95 %", fontsize=9)
