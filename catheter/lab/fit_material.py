"""`fit --model material`: tensile tests in; five laws, their limits, a row of the material table and a picture out."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from catheter.lab.outcome import progress, table
from data.errors import BadInput, nearest
from data.files import fresh

if TYPE_CHECKING:
    from catheter.lab.fit_bender import Fitted
    from catheter.material_fit import LawFit, MaterialFit

MPA = 1e6
TENSION_ONLY = (
    "Tension alone tells laws apart in tension alone: trust no other mode of a law with more than one number."
)


def material_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of a material fit."""
    group = parser.add_argument_group("--model material, from tensile tests (.csv with a header)")
    group.add_argument("--specimen", default="", metavar="COLUMN,...", help="columns that tell specimens apart")
    group.add_argument("--where", action="append", default=[], metavar="COLUMN=VALUE", help="rows to keep; repeatable")
    group.add_argument("--strain", default="", metavar="COLUMN", help="engineering strain (default: by its name)")
    group.add_argument("--stress", default="", metavar="COLUMN", help="engineering stress, as stress_MPa (by its name)")
    group.add_argument("--most-strain", type=float, default=1.0, help="fit strains up to this (default 1: 100 %%)")
    group.add_argument("--law", default="", help="the law to write (default: the stable one of least AICc)")
    group.add_argument("--name", default="", help="what the material is called (default: the file's name)")
    group.add_argument("--origin", choices=("measured", "simulated"), help="where the tests are from")


def check_material(options: argparse.Namespace) -> None:
    """Refuse a material fit's options for another model, and another's for a material."""
    own = ("specimen", "where", "strain", "stress", "law", "name", "origin")
    others = ("response", "input", "view", "validate", "rest_volume", "target")
    given = [name for name in (others if options.model == "material" else own) if getattr(options, name)]
    if given:
        option = f"--{given[0].replace('_', '-')}"
        raise BadInput(option, f"given for a {options.model} model", "leave it out, or see fit --help")


def fit_tests(source: Path, kind: str, options: argparse.Namespace) -> "Fitted":
    """Fit the laws to a table of tensile tests."""
    from catheter.lab.fit_bender import Fitted
    from catheter.material_fit import Tensile, fit_material
    from catheter.tensile import Columns, read_tensile
    from data.options import read

    given = {"most_strain": options.most_strain, "resamples": options.resamples}
    chosen = read(Tensile, given, "command line")
    columns = Columns(
        strain=options.strain,
        stress=options.stress,
        specimen=tuple(filter(None, options.specimen.split(","))),
        where=tuple(options.where),
    )
    with progress("fitting") as advance:
        found = fit_material(read_tensile(source, columns), chosen, advance)
    if options.law and options.law not in found.laws:
        raise BadInput("--law", f"{options.law!r} is unknown", nearest(options.law, found.laws))
    wanted = found.laws[options.law] if options.law else found.preferred
    name = options.name or source.stem
    parts = _parts(found, wanted)
    if options.picture:
        title = f"{name} ({kind}): {len(found.specimens)} specimens, strains to {chosen.most_strain:g}"
        with fresh(Path(options.picture), options.force) as temporary:
            draw(found, title, temporary)
        parts.append(f"{options.picture} written")
    tables = _tables(found, wanted, name)
    return Fitted(_values(found, wanted, name), parts, tables)


def _parts(found: "MaterialFit", wanted: "LawFit") -> list[Any]:
    shifts = np.array([one.shift for one in found.specimens])
    least = min(fit.aicc for fit in found.laws.values())
    laws = [
        [
            fit.name,
            f"{fit.rms / 1e3:.3g}",
            f"{fit.own_rms / 1e3:.3g}",
            f"{fit.aicc - least:.1f}",
            str(fit.chosen_by),
            "stable" if fit.stability.everywhere else "unstable",
        ]
        for fit in found.laws.values()
    ]
    numbers = [
        [fit.name if k == 0 else "", fit.numbers[k], *_number(fit, k)]
        for fit in found.laws.values()
        for k in range(len(fit.numbers))
    ]
    head = ["law", "rms kPa", "own fits kPa", "dAICc", "won", "Drucker"]
    title = f"{len(found.specimens)} specimens, strains to {found.options.most_strain:g}"
    level = f"{100 * found.options.level:g} %, low"
    rupture = f"{found.broke} of {len(found.specimens)} broke"
    return [
        table(head, laws, title),
        *(f"{fit.name}: {fit.stability.words}" for fit in found.laws.values() if not fit.stability.everywhere),
        *(f"{name} left out: {why}" for name, why in found.left_out.items()),
        table(["law", "number", "value MPa", level, "high", "specimens' median"], numbers, words=2),
        f"Strain counted from the stress-free state: shifted by {shifts.min():+.4f} to {shifts.max():+.4f}, "
        f"{sum(one.dropped for one in found.specimens)} samples of toe left out.",
        f"Chosen: {wanted.name}. Elongation at least {found.elongation:.1%}, strength {found.strength / MPA:.3g} MPa "
        f"(median; {rupture}{'' if found.broke == len(found.specimens) else ': lower bounds'}).",
        TENSION_ONLY,
    ]


def _number(fit: "LawFit", k: int) -> list[str]:
    unit = 1.0 if fit.numbers[k] == "alpha" else MPA
    shown = (fit.values[k], fit.low[k], fit.high[k], np.median(fit.each[:, k]))
    return [f"{value / unit:.4g}" if np.isfinite(value) else "-" for value in shown]


def _values(found: "MaterialFit", wanted: "LawFit", name: str) -> dict[str, Any]:
    laws = {
        fit.name: {
            "numbers": dict(zip(fit.numbers, fit.values.tolist(), strict=True)),
            "low": fit.low.tolist(),
            "high": fit.high.tolist(),
            "each": fit.each.tolist(),
            "median": np.median(fit.each, axis=0).tolist(),
            "rms_pa": fit.rms,
            "own_rms_pa": fit.own_rms,
            "aicc": fit.aicc,
            "chosen_by": fit.chosen_by,
            "stable": fit.stability.everywhere,
            "stability": fit.stability.words,
        }
        for fit in found.laws.values()
    }
    specimens = [
        {
            "name": one.name,
            "shift": one.shift,
            "toe_samples": one.dropped,
            "elongation": float(one.strain[-1]),
            "strength_pa": float(one.stress[-1]),
            "broke": one.broke,
        }
        for one in found.specimens
    ]
    return {
        "name": name,
        "law": wanted.name,
        "laws": laws,
        "left_out": found.left_out,
        "specimens": specimens,
        "elongation": found.elongation,
        "strength_pa": found.strength,
        "most_strain": found.options.most_strain,
        "note": TENSION_ONLY,
    }


def _tables(found: "MaterialFit", wanted: "LawFit", name: str) -> dict[str, dict[str, Any]]:
    """Return the fit, the material as scenes and `catheter.material` read it, and its row of Table 5.1."""
    units = {number: "" if number == "alpha" else " Pa" for number in wanted.numbers}
    values = {n: float(v) for n, v in zip(wanted.numbers, wanted.values, strict=True)}
    ends = {
        f"{n}_{end}": float(v) if n == "alpha" else f"{float(v)!r} Pa"
        for end, row in (("low", wanted.low), ("high", wanted.high))
        for n, v in zip(wanted.numbers, row, strict=True)
        if np.isfinite(v)
    }
    told = {
        "law": wanted.name,
        "specimens": len(found.specimens),
        "broke": found.broke,
        "most_strain": found.options.most_strain,
        "rms": f"{wanted.rms!r} Pa",
        "stability": wanted.stability.words,
        **ends,
    }
    numbers = {n: v if not units[n] else f"{v!r}{units[n]}" for n, v in values.items()}
    row = {
        "material": name,
        "elongation_at_least": round(100 * found.elongation, 1),
        "strength": round(found.strength / MPA, 4),
        "c1": round(float(found.laws["neo-Hooke"].values[0]) / MPA, 4),  # the one a positive stress always has
    }
    return {
        "fit": told,
        "material": {"name": name, "law": wanted.name, "elongation": found.elongation, **numbers},
        "row": row,
    }


def draw(found: "MaterialFit", title: str, path: Path) -> None:
    """Write a picture: stress over strain of every specimen with the laws, and what each law misses."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 5), layout="constrained")
    curves, misses = figure.subplots(1, 2)
    for one in found.specimens:
        curves.plot(one.strain, one.stress / MPA, ".", color="0.6", markersize=3)
    strain = np.linspace(0, found.options.most_strain, 200)
    for fit in found.laws.values():
        label = fit.name if fit.stability.everywhere else f"{fit.name} (unstable)"
        line = curves.plot(strain, fit.law.uniaxial(1 + strain) / MPA, label=label)[0]
        for one in found.specimens:
            inside = one.strain <= found.options.most_strain
            away = fit.law.uniaxial(1 + one.strain[inside]) - one.stress[inside]
            misses.plot(one.strain[inside], away / MPA, color=line.get_color(), linewidth=0.7)
    reach = max(float(one.stress[one.strain <= found.options.most_strain].max()) for one in found.specimens) / MPA
    curves.set(xlim=(0, found.options.most_strain * 1.05), ylim=(0, 1.1 * reach))
    curves.set(xlabel="engineering strain from the stress-free state", ylabel="engineering stress [MPa]")
    misses.set(xlabel="engineering strain", ylabel="law minus specimen [MPa]")
    curves.legend(fontsize=8)
    figure.suptitle(title, fontsize=10, parse_math=False)
    figure.savefig(path, format="png", dpi=110)
