"""The study of the material fits: known curves with toe and preload, and real resins beside their published numbers."""

import csv
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from catheter.lab.report import Progress, Report, Row
from catheter.laws import columns
from catheter.material_fit import MaterialFit, Tensile, fit_material
from catheter.tensile import Columns, Rested, Specimen, Toe, read_tensile, rested
from data.errors import BadInput
from fem.material import Yeoh

MPA = 1e6
REAL = Path(__file__).parents[3] / "shared" / "data" / "real"
MOST = 1.0  # strain
KNOWN = Yeoh(0.2 * MPA, -0.01 * MPA, 0.002 * MPA)
Zero = Callable[[Specimen], Rested]


def line_zero(test: Specimen) -> Rested:
    """Return a specimen counted from where a line through five samples meets zero stress.

    The rule of the resins' publishers: the first five samples above 5 % of the greatest stress, which is left out.
    """
    above = test.stress > 0.05 * test.stress.max()
    strain, stress = test.strain[above][:-1], test.stress[above][:-1]
    slope, height = np.polyfit(strain[:5], stress[:5], 1)
    shift = float(height / slope)
    return Rested(test.name, strain + shift, stress, shift, int(np.argmax(above)), float(slope) / 6, test.broke)


def untouched(test: Specimen) -> Rested:
    """Return a specimen as its machine counted."""
    return Rested(test.name, test.strain, test.stress, 0.0, 0, np.nan, test.broke)


ZEROS: dict[str, Zero] = {"ours": rested, "line": line_zero, "as counted": untouched}


def c1_of(one: Rested, most: float = MOST) -> float:
    """Return Yeoh's c1 of one specimen by least squares on engineering stress [Pa]."""
    inside = (one.strain > 0) & (one.strain <= most)
    return float(np.linalg.lstsq(columns("Yeoh", 1 + one.strain[inside]), one.stress[inside], rcond=None)[0][0])


def known_test(slack: float, foot: float, noise: float = 500.0) -> Specimen:
    """Return a test of a known Yeoh material: its grips take up `slack` (a preload if negative), rounded over `foot`.

    noise: standard deviation of the stress [Pa].
    """
    strain = np.arange(0.0, 1.3, 0.03)
    real = strain - slack
    if slack > 0:
        width = max(foot, 1e-6) / 6
        real = width * np.logaddexp(0.0, real / width)
    stress = KNOWN.uniaxial(1 + real) + np.random.default_rng(0).normal(0.0, noise, len(strain))
    return Specimen(f"slack {slack:g}, foot {foot:g}", strain, stress)


def real_folder() -> Path:
    """Return the folder of real measurements. Raises BadInput where there is none."""
    folder = Path(os.environ.get("CATHETER_REAL_DATA", REAL)) / "elastomers"
    if not folder.is_dir():
        raise BadInput(folder, "is not there", "set CATHETER_REAL_DATA to the folder of real measurements")
    return folder


@dataclass(frozen=True, eq=False)
class Resin:
    """One resin after one sterilisation: its specimens, and what was published of it (c1 [Pa], stress at 50 %)."""

    name: str
    treatment: str
    tests: list[Specimen]
    c1: float
    law: Yeoh
    half: float


def resins(folder: Path) -> list[Resin]:
    """Return every group of the real specimens with its published medians."""
    table = folder / "soft_tensile_tidy.csv"
    published = _rows(folder / "published_yeoh_bootstrap_summary.csv")[3:]
    metrics = _rows(folder / "published_soft_stress_metrics.csv")[1:]
    with table.open(encoding="utf-8", newline="") as file:
        names = {row["resin"].lower(): row["resin"] for row in csv.DictReader(file)}
    found = []
    for row in published:
        where = (f"resin={names[row[0]]}", f"ster={row[1]}")
        tests = read_tensile(table, Columns(specimen=("plate", "spec"), where=where))
        half = [float(m[4]) for m in metrics if m[:2] == row[:2] and m[4]]
        law = Yeoh(*(float(row[k]) * MPA for k in (4, 7, 10)))
        found.append(Resin(names[row[0]], row[1], tests, law.c1, law, float(np.median(half)) * MPA))
    return found


def _rows(path: Path) -> list[list[str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file))


def materials(*, quick: bool, progress: Progress) -> Report:
    """Judge the zero of a tensile test on known curves, and Yeoh's c1 of real resins on the published medians."""
    rows = [_known(name, zero, *case) for case in _cases() for name, zero in ZEROS.items()]
    real = resins(real_folder())
    medians: dict[str, list[float]] = {name: [] for name in ZEROS}
    for done, resin in enumerate(real):
        for name, zero in ZEROS.items():
            started = time.perf_counter()
            c1 = float(np.median([c1_of(zero(test)) for test in resin.tests]))
            medians[name].append(c1 / resin.c1)
            level = f"{resin.name}, {resin.treatment}"
            spent = time.perf_counter() - started
            rows.append(Row(method=f"real, {name}", level=level, error=abs(c1 / resin.c1 - 1), seconds=spent))
        progress((done + 1) / (len(real) + 5))
    plain = [resin for resin in real if resin.treatment == "NS"]
    options = Tensile(most_strain=MOST, resamples=50 if quick else 400)
    fits = {resin.name: fit_material(resin.tests, options) for resin in plain}
    progress(1.0)
    return Report(
        name="materials",
        title="Yeoh's c1 from tensile tests, strains to 100 %: relative error",
        level="specimens",
        error="relative error of c1",
        rows=rows,
        notes=[*_notes(real, medians), *_sensitivity(real), *(_choice(name, fit) for name, fit in fits.items())],
        draw=lambda figure: _draw(figure, real, medians, fits),
    )


def _cases() -> list[tuple[float, float]]:
    return [(0.0, 0.0), (0.05, 0.0), (0.05, 0.03), (0.1, 0.06), (-0.04, 0.0)]


def _known(name: str, zero: Zero, slack: float, foot: float) -> Row:
    started = time.perf_counter()
    error = abs(c1_of(zero(known_test(slack, foot))) / KNOWN.c1 - 1)
    level = f"slack {slack:g}, foot {foot:g}" if slack >= 0 else f"preload {-slack:g}"
    return Row(method=f"known, {name}", level=level, error=error, seconds=time.perf_counter() - started)


def _notes(real: list[Resin], medians: dict[str, list[float]]) -> list[str]:
    notes = []
    for name, ratios in medians.items():
        near = sum(abs(ratio - 1) <= 0.1 for ratio in ratios)
        notes.append(f"{name}: c1 {min(ratios):.2f} to {max(ratios):.2f} of published, {near} of {len(ratios)} in 10 %")
    for index, resin in enumerate(real):
        own = float(resin.law.uniaxial(1.5)) / resin.half
        ours, line, _ = (ratios[index] for ratios in medians.values())
        notes.append(
            f"{resin.name}, {resin.treatment}: c1 over published {ours:.2f} ours, {line:.2f} by the publishers' line; "
            f"the published law over the published stress at 50 % strain: {own:.2f}"
        )
    misses = np.array([float(resin.law.uniaxial(1.5)) / resin.half for resin in real])
    lines = np.array(medians["line"])
    notes.append(
        f"The published laws were fitted to tension and compression at once, and miss their own tension by "
        f"{100 * (misses.min() - 1):+.0f} to {100 * (misses.max() - 1):+.0f} % at 50 % strain. With the publishers' "
        f"zero, c1 from tension alone times that miss is {(lines * misses).min():.2f} to {(lines * misses).max():.2f} "
        f"of published (correlation {np.corrcoef(lines, misses)[0, 1]:.2f})."
    )
    return notes


def _sensitivity(real: list[Resin]) -> list[str]:
    """Say what the span of the zero and the range of the fit do to the ratio to the published c1."""
    notes = []
    for span, most in ((0.2, MOST), (0.3, MOST), (0.4, MOST), (0.3, 0.5), (0.3, 1.5)):
        toe = Toe(span=span)
        ratios = [np.median([c1_of(rested(test, toe), most) for test in resin.tests]) / resin.c1 for resin in real]
        near = sum(abs(ratio - 1) <= 0.1 for ratio in ratios)
        notes.append(
            f"Ours with the zero from strains to {span:g}, fitted to {most:g}: c1 {min(ratios):.2f} to "
            f"{max(ratios):.2f} of published, median {np.median(ratios):.2f}, {near} of {len(ratios)} in 10 %"
        )
    return notes


def _choice(name: str, fit: MaterialFit) -> str:
    least = min(law.aicc for law in fit.laws.values())
    parts = [
        f"{law.name} {law.aicc - least:.0f} ({law.chosen_by}{'' if law.stability.everywhere else ', unstable'})"
        for law in fit.laws.values()
    ]
    return f"{name}, NS: dAICc (specimens won): {', '.join(parts)}; elongation at least {fit.elongation:.0%}"


def _draw(figure: Any, real: list[Resin], medians: dict[str, list[float]], fits: dict[str, MaterialFit]) -> None:
    figure.set_size_inches(12, 5.5)
    left, right = figure.subplots(1, 2)
    for index, (name, fit) in enumerate(fits.items()):
        colour = f"C{index}"
        for one in fit.specimens:
            left.plot(one.strain, one.stress / MPA, ".", color=colour, markersize=2)
        strain = np.linspace(0, MOST, 100)
        left.plot(strain, fit.laws["Yeoh"].law.uniaxial(1 + strain) / MPA, color="k", linewidth=1)
        left.plot([], [], ".", color=colour, label=name)
    left.set(xlim=(0, 1.1 * MOST), ylim=(0, 2.8), xlabel="engineering strain", ylabel="engineering stress [MPa]")
    left.set_title("measured specimens, not sterilised, and Yeoh (black)", fontsize=9)
    left.legend(fontsize=8)
    places = np.arange(len(real))
    for (name, ratios), mark in zip(medians.items(), "os^", strict=True):
        right.plot(ratios, places, mark, label=name)
    right.plot([r.half / float(r.law.uniaxial(1.5)) for r in real], places, "k+", label="tension / published law")
    right.axvspan(0.9, 1.1, color="0.85")
    right.set_yticks(places, [f"{resin.name}, {resin.treatment}" for resin in real], fontsize=7)
    right.set(xlabel="Yeoh's c1 over the published median (band: 10 %)")
    right.legend(fontsize=8)
