"""The studies of inverse design: error against noise and against run time, and cases where such methods fail."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from catheter.inflatable import Pattern, Shape
from catheter.lab.report import Progress, Report, Row
from catheter.reconstruction import Case, Quality, Wanted, solved, tube_case
from data.errors import CatheterError
from fem.inverse import Inversion

HELIX = Pattern(pattern="helix", period=16, width=4)
WANTED = Wanted(pressures=(60e3,), seen="all")
NOISES = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
BOUNDS = (0.05e6, 20e6)


def _shape(quick: bool) -> Shape:
    return Shape(length=16e-3, divisions=(16, 16, 1), voxels=(16, 16)) if quick else Shape(divisions=(32, 32, 1))


def inverse(*, quick: bool, progress: Progress) -> Report:
    """Reconstruct the twisting tube by four methods: at noises of 1e-6 to 10 %, and iteration by iteration."""
    shape, noises = _shape(quick), NOISES[::3] if quick else NOISES
    rows, done = list[Row](), 0
    total = (len(noises) + 1) * len(METHODS) + len(noises)
    for noise in (0.0, *noises):
        case = tube_case(shape, HELIX, replace(WANTED, noise=noise))
        for name, method in METHODS.items():
            rows += _measured(name, method, case, noise, quick)
            done += 1
            progress(done / total)
    for noise in noises:
        case = tube_case(shape, HELIX, replace(WANTED, noise=noise, seen="outer"))
        rows += _measured("Gauss-Newton, outside only", METHODS["Gauss-Newton"], case, noise, quick)
        done += 1
        progress(done / total)
    return Report(
        name="inverse",
        title="Maps of the twisting tube (simulated): median modulus error against noise and run time",
        level="noise, iteration",
        error="median relative modulus error",
        rows=rows,
        notes=[
            "Noise: standard deviation over the largest displacement; every node seen unless it says outside only.",
            "Uniform seed of 1 MPa; the thesis's method: its own seed, weights 0, 1, 0, two classes four times.",
            "A method that ends early keeps its last map; L-BFGS has the noise's weight from the start.",
        ],
        draw=lambda figure: _draw(figure, rows),
    )


def _draw(figure: Any, rows: list[Row]) -> None:
    """Draw the error over run time, iteration by iteration on exact data, and at the end over the noise."""
    from catheter.lab.plot import MARKERS, axes

    figure.set_size_inches(12, 5.5)
    error = ("median relative modulus error", "1")
    left = axes(figure, ("run time", "s"), error, at=(1, 2, 1), title="exact data, each iteration", log="xy")
    right = axes(figure, ("noise over the largest displacement", "1"), error, at=(1, 2, 2), title="the end", log="xy")
    for plot, exact in ((left, True), (right, False)):
        mine = [row for row in rows if row.level.startswith("it.") == exact and not row.failed]
        for marker, name in zip(MARKERS, dict.fromkeys(row.method for row in mine), strict=False):
            found = [row for row in mine if row.method == name]
            places = [row.seconds if exact else float(row.level) for row in found]
            plot.plot(places, [row.error for row in found], marker=marker, label=name)
        plot.legend(fontsize=8)


Told = Callable[[Any, float], None]


def _gap(case: Case, tell: Told, quick: bool) -> None:
    started = time.perf_counter()
    found = replace(case, wanted=replace(case.wanted, seed="gap")).seed(Inversion())
    tell(found, time.perf_counter() - started)


def _newton(case: Case, tell: Told, quick: bool) -> None:
    solved(case, Inversion(), None, lambda one: tell(np.exp(one.log), one.seconds))


def _descent(case: Case, tell: Told, quick: bool) -> None:
    from fem.descent import descend

    options = Inversion(most_iterations=16 if quick else 24)
    seed = case.seed(options)
    descend(case.voxels, case.observations, seed, case.variation, options, lambda i: tell(np.exp(i.log), i.seconds))


def _thesis(case: Case, tell: Told, quick: bool) -> None:
    from fem.thesis_inverse import ThesisWeights, thesis_inverse, thesis_seed

    seen: Any = case.observations[0]
    weights = ThesisWeights(displacement=0, strain=1, similarity=0, classes=4, most=8 if quick else 20)
    seed = thesis_seed(case.voxels, seen, BOUNDS)
    thesis_inverse(case.voxels, seen, seed, case.variation, BOUNDS, weights, lambda s: tell(s.moduli, s.seconds))


METHODS: dict[str, Callable[[Case, Told, bool], None]] = {
    "gap": _gap,
    "Gauss-Newton": _newton,
    "L-BFGS, adjoint": _descent,
    "thesis's": _thesis,
}


def _measured(
    name: str, method: Callable[[Case, Told, bool], None], case: Case, noise: float, quick: bool
) -> list[Row]:
    """Return a method's rows: its end at a noise, and every iteration where data are exact."""
    history = list[tuple[float, float]]()
    failed = ""
    try:
        method(case, lambda moduli, seconds: history.append((_error(case, moduli), seconds)), quick)
    except CatheterError as error:
        failed = str(error)
    if not history:
        return [Row(method=name, level=f"{noise:g}", error=np.nan, seconds=0.0, failed=failed or "no map")]
    if noise:
        return [Row(method=name, level=f"{noise:g}", error=history[-1][0], seconds=history[-1][1])]
    steps = range(0, len(history), max(1, len(history) // 15))
    return [
        Row(method=f"{name}, exact", level=f"it. {k}", error=history[k][0], seconds=history[k][1])
        for k in sorted({*steps, len(history) - 1})
    ]


def _error(case: Case, moduli: Any) -> float:
    return Quality.of(moduli, case.truth).median


def inverse_stability(*, quick: bool, progress: Progress) -> Report:
    """Stiff, noisy and impossible cases of the twisting tube: solved with their error, or ended with a reason."""
    shape, rows = _shape(quick), list[Row]()
    cases = _cases()
    for done, (name, (pattern, wanted, options)) in enumerate(cases.items()):
        started = time.perf_counter()
        try:
            case = tube_case(shape, pattern, wanted)
            found = solved(case, options)
            quality = Quality.of(found.moduli, case.truth)
            bounds = f"{(found.bounded < 0).sum()} at the least, {(found.bounded > 0).sum()} at the most modulus"
            level = f"{found.why}; misfit {found.misfit:.1e}; right {100 * quality.right:.1f} %; {bounds}"
            rows.append(Row(method=name, level=level, error=quality.median, seconds=found.seconds))
        except CatheterError as error:
            seconds = time.perf_counter() - started
            rows.append(Row(method=name, level="refused", error=np.nan, seconds=seconds, failed=str(error)))
        progress((done + 1) / len(cases))
    return Report(
        name="inverse-stability",
        title="Inverse design at its limits (simulated): each case solved with its error, or ended with a reason",
        level="how it ended",
        error="median relative modulus error",
        rows=rows,
        notes=["One default setting throughout; misfit in noises where there is noise, else over the largest value."],
    )


def _cases() -> dict[str, tuple[Pattern, Wanted, Inversion]]:
    outside = replace(WANTED, seen="outer", noise=0.01)
    plain = Inversion()
    return {
        "contrast 99 (FLX9795), exact": (replace(HELIX, stiff="FLX9795"), WANTED, Inversion(most=60e6)),
        "contrast 99, outside, 1 %": (replace(HELIX, stiff="FLX9795"), outside, Inversion(most=60e6)),
        "a third of the length not seen, 1 %": (HELIX, replace(outside, missing=1 / 3), plain),
        "a third of the length not seen, exact": (HELIX, replace(WANTED, seen="outer", missing=1 / 3), plain),
        "two outliers of 5 mm, 1 %": (HELIX, replace(outside, outliers=2), plain),
        "64 markers outside, 1 %": (HELIX, replace(outside, seen="markers"), plain),
        "centreline alone, 1 %": (HELIX, replace(outside, seen="centreline"), plain),
        "tip's pose alone, exact": (HELIX, replace(WANTED, seen="tip"), plain),
        "a balloon twice too large": (Pattern(), replace(WANTED, pressures=(40e3,), stretched=2.0), plain),
        "a pure torsion of 10 deg": (HELIX, replace(WANTED, turned=float(np.radians(-10.0))), plain),
        "the twist of the tip alone": (HELIX, replace(WANTED, seen="twist"), plain),
        "a target that folds (12 times)": (HELIX, replace(WANTED, stretched=12.0), Inversion(most_iterations=30)),
        "pressure beyond the limit point": (Pattern(), replace(WANTED, pressures=(90e3,)), plain),
        "noise of 10 %": (HELIX, replace(outside, noise=0.1), plain),
    }
