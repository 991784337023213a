"""Section 3.3: the bender on the simulated bench: static tests, chirp, reduced models; Figs 3.26 to 3.33.

The models (3.35) and (3.36) are recovered from chirps of plants that obey them; the static tests and the chirp's
course are of the bench's plant with hysteresis and relaxation, whose size the thesis does not print.
"""

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from catheter.actuator import AREA_M2, ML, STROKE_M
from catheter.bench_runs import CONSTRAINED, UNCONSTRAINED, BenchRun, Relaxation, bender
from catheter.lab import plot
from catheter.lab.scene import Scene
from catheter.lab.thesis.entries import Entry, Figure, Section, claim, compare
from data.signal import Array
from sysid.estimate import Bootstrap, dropped
from sysid.hysteresis import loops
from sysid.identify import Identification, identify

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

TEXT = "3.text"
PLANTS = {"unconstrained": UNCONSTRAINED, "constrained": CONSTRAINED}
NAMES = {"x^3": "cubic", "x^2": "square", "xdd^2": "inertia", "1": "constant"}
UNC, CON = "unconstrained", "constrained"


def bender_force(*, quick: bool) -> Section:
    """Identify simulated chirps of both loadings (300 s for `quick`, the thesis's 1800 s otherwise)."""
    chirps = {name: _chirp(name, 300.0 if quick else 1800.0) for name in PLANTS}
    found = {name: _identified(run) for name, run in chirps.items()}
    entries = [*_weights(found), *_said(found[UNC])]
    return Section(entries=entries, figures=[*_static(quick), *_dynamic(chirps, found)])


def _chirp(loading: str, seconds: float) -> BenchRun:
    tables = _tables("chirp")
    return bender(**tables | {
        "drive": replace(tables["drive"], duration_s=seconds),
        "plant": PLANTS[loading],
        "relaxation": Relaxation(share=0.0),
    })  # fmt: skip


def _tables(scene: str) -> dict[str, Any]:
    return {name: options for name, options in Scene.load(scene).tables.items() if name != "ask"}


def _series(run: BenchRun) -> tuple[Array, Array]:
    """Return volume [mL] and force [N]."""
    return run.signals["/volume", "volume"] / ML, run.signals["/force", "force"]


def _identified(run: BenchRun) -> Identification:
    return identify(run.time_s, *_series(run), bootstrap=Bootstrap(resamples=20))


def _weights(found: dict[str, Identification]) -> list[Entry]:
    entries = []
    for loading, short, terms in ((UNC, "unc", ("xdd^2", "x^3", "x^2")), (CON, "con", ("x^3",))):
        one = found[loading]
        mask = one.selection.mask(terms)
        weights = dict(zip(one.selection.terms, one.selection.weights[mask].tolist(), strict=True))
        weights["1"] = float(one.selection.constants[mask])
        entries += [compare(TEXT, f"F_{short}, {NAMES[term]}", weights[term], recovered=True) for term in (*terms, "1")]
        count = len(one.choices["1 %"])
        entries.append(compare(TEXT, f"effective terms of F_{short} by the 1 % rule", count, recovered=True))
    return [*entries, compare(TEXT, "effective terms of the full model", len(found[UNC].selection.terms))]


def _said(found: Identification) -> list[Entry]:
    full = AREA_M2 * STROKE_M / ML
    x = np.linspace(0.0, full, 500)[1:]
    forces = {name: plant.cubic * x**3 + plant.square * x**2 + plant.constant for name, plant in PLANTS.items()}
    share = float(np.min(forces[UNC] / forces[CON]))
    metres = UNCONSTRAINED.cubic * (full * ML) ** 3 + UNCONSTRAINED.constant
    selection = found.selection
    kept = selection.mask(("x^3", "x^2"))
    whole = selection.mask(("x^3", "x^2", "xdd^2"))
    costs = 100 * (float(selection.rmse[kept] / selection.rmse[whole]) - 1)
    spread = float(selection.rmse[kept]) / selection.response_deviation
    return [
        claim(TEXT, "unit of x in (3.35) and (3.36)",
              f"{forces[UNC][-1]:.1f} N at {full:.2f} mL; {1e3 * metres:.1f} mN with x in m^3", holds=False),
        claim(TEXT, "the constrained bender pushes harder",
              f"F_unc / F_con is {share:.2f} or more up to {full:.0f} mL", holds=share < 1),
        claim(TEXT, "dynamics play a negligible role",
              f"without xdd^2 the error rises by {costs:.0f} %, to {100 * spread:.1f} % of the force's (simulated)",
              holds=spread < 0.05),
        claim(TEXT, "RMSE of (3.32), (3.33)",
              f"rms {found.chosen.rmse:.3g} N, root-sum-square {found.chosen.root_sum_square:.3g} N", holds=False),
    ]  # fmt: skip


def _static(quick: bool) -> list[Figure]:
    ramps = {name: bender(**_tables("ramp") | {"plant": _slipping(name)}) for name in PLANTS}
    stairs = _tables("staircase")
    if quick:
        stairs["drive"] = replace(stairs["drive"], step=0.471)
    run = bender(**stairs)
    return [
        Figure(number="3.26", title="quasi-static ramp", kind="simulated", draw=partial(_ramp, ramps)),
        Figure(number="3.27", title="staircase, energy stored and returned", kind="simulated",
               draw=partial(_stairs, run), size=(10.0, 5.5)),
    ]  # fmt: skip


def _slipping(loading: str) -> object:
    plant = Scene.load("ramp").tables["plant"]
    own = PLANTS[loading]
    return replace(plant, cubic=own.cubic, square=own.square, inertia=own.inertia, constant=own.constant)


def _dynamic(chirps: dict[str, BenchRun], found: dict[str, Identification]) -> list[Figure]:
    drawn = {"3.28": ("chirp", partial(_chirps, chirps), (9.0, 6.0))}
    for loading, term, size in ((UNC, "3.29", "3.30"), (CON, "3.31", "3.32")):
        one = found[loading]
        times = chirps[loading].time_s[one.used]
        drawn[term] = f"each term dropped, {loading}", partial(_terms, times, one), (8.0, 5.5)
        drawn[size] = f"error of all subsets, {loading}", partial(_subsets, one), (8.0, 5.5)
    drawn["3.33"] = "reduced models over time", partial(_models, chirps, found), (9.0, 6.0)
    return [
        Figure(number=number, title=title, kind="simulated", draw=draw, size=size)
        for number, (title, draw, size) in drawn.items()
    ]


def _ramp(runs: dict[str, BenchRun], figure: "Drawing") -> None:
    axes = plot.axes(figure, ("volume", "mL"), ("force", "N"), title="plant with springs that slip")
    for name, run in runs.items():
        x, force = _series(run)
        axes.plot(x, force, ".", markersize=1, label=name)
    axes.legend(fontsize=8, markerscale=8)


def _stairs(run: BenchRun, figure: "Drawing") -> None:
    x, force = _series(run)
    left = plot.axes(figure, ("volume", "mL"), ("force", "N"), at=(1, 2, 1))
    left.plot(x, force, linewidth=0.4)
    found = loops(x, force)
    right = plot.axes(figure, ("largest volume", "mL"), ("energy over the volume", "N mL"), at=(1, 2, 2))
    for name, values in (("stored", [o.stored for o in found]), ("returned", [o.returned for o in found])):
        right.plot([o.x_high for o in found], values, ".-", label=name)
    right.legend(fontsize=8)


def _chirps(runs: dict[str, BenchRun], figure: "Drawing") -> None:
    for index, (name, run) in enumerate(runs.items(), start=1):
        axes = plot.axes(figure, ("time", "s"), ("force", "N"), at=(2, 1, index), title=name)
        axes.plot(run.time_s, _series(run)[1], linewidth=0.3)


def _terms(times: Array, found: Identification, figure: "Drawing") -> None:
    differences, percent = dropped(found.selection, found.columns, found.response)
    axes = plot.axes(figure, ("time", "s"), ("root-sum-square error, more than the full model's", "N"))
    axes.set_yscale("symlog", linthresh=1e-2)
    for index, term in enumerate(found.selection.terms):
        style = ("-", "--")[index // len(plot.COLOURS)]
        axes.plot(times[::50], differences[::50, index], style, label=f"{term}: {percent[index]:+.3g} %")
    axes.legend(fontsize=8, title="dropped: error at the end", title_fontsize=8)


def _subsets(found: Identification, figure: "Drawing") -> None:
    selection = found.selection
    axes = plot.axes(figure, ("terms beside the constant", ""), ("RMSE", "N"), log="y")
    axes.plot(selection.sizes, selection.rmse, ".", color="0.6", label="all 512 subsets")
    best = np.asarray(selection.best)
    axes.plot(selection.sizes[best], selection.rmse[best], "o-", label="best of its size")
    chosen = found.mask
    axes.plot(selection.sizes[chosen], selection.rmse[chosen], "s", markersize=9,
              label=f"1 % rule: {' '.join(found.chosen.names[1:])}")  # fmt: skip
    axes.legend(fontsize=8)


def _models(runs: dict[str, BenchRun], found: dict[str, Identification], figure: "Drawing") -> None:
    for index, (name, run) in enumerate(runs.items(), start=1):
        one = found[name]
        axes = plot.axes(figure, ("time", "s"), ("force", "N"), at=(1, 2, index), title=name)
        times = run.time_s[one.used]
        early = times < 0.3 * times[-1]  # later the chirp's waves would fill the picture
        axes.plot(times[early], one.response[early], linewidth=3, color="0.75", label="simulated sensor")
        model = f"{' '.join(one.chosen.names[1:])}, fit {one.chosen.fit_percent:.1f} %"
        axes.plot(times[early], (one.response - one.residual)[early], color=plot.COLOURS[1], label=model)
        axes.legend(fontsize=8)
