"""The command that inflates: a printed tube of two materials under pressure, or filled to a volume."""

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from catheter.lab.dashboard import check_view, save_view, view_options
from catheter.lab.outcome import Outcome, progress, table
from data.errors import BadInput
from data.files import check_free, check_inputs, fresh

if TYPE_CHECKING:
    from fem.tube import Inflation


def inflate_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `inflate`."""
    parser.add_argument("scene", nargs="?", default="twist", help="a shipped scene (twist), or a .toml file")
    parser.add_argument(
        "--pressure", action="append", metavar="PRESSURE", help="as '20 kPa', instead of the scene's; repeatable"
    )
    parser.add_argument(
        "--volume",
        action="append",
        type=float,
        metavar="RATIO",
        help="cavity volume over that at rest, instead of the scene's loads; repeatable",
    )
    view_options(parser, "deformed mesh, curves, Newton's history")
    parser.add_argument("--vtu", metavar="FILE", help="for ParaView: .vtu the last load, .pvd all of them")
    parser.add_argument("--accumulator", metavar="FIT.toml", help="the tube as a spring for `run --fit N=FIT.toml`")
    parser.add_argument("--force", action="store_true", help="overwrite the outputs")


def inflate_(options: argparse.Namespace) -> Outcome:
    """Inflate a scene's tube and say what became of it at each load."""
    from catheter.inflatable import Path as Loads
    from catheter.inflatable import inflated
    from catheter.lab.scene import Scene
    from data.options import read

    scene = Scene.load(options.scene)
    if scene.heading.kind != "tube":
        raise BadInput(f"scene {options.scene}", f"is a {scene.heading.kind} scene", "a tube scene has a [tube]")
    path = scene.tables["path"]
    if options.pressure or options.volume:
        given = {"pressures": options.pressure, "volume_ratios": options.volume}
        path = replace(
            read(Loads, {key: value for key, value in given.items() if value}, "command line"), tolerance=path.tolerance
        )
    outputs, drawn = _outputs(options), check_view(options, options.scene)
    started = time.perf_counter()
    with progress("inflating"):
        run = inflated(scene.tables["tube"], scene.tables["map"], path)
    outcome = _outcome(run, scene.heading.title, time.perf_counter() - started)
    for name, out in outputs.items():
        told, values = WRITERS[name](run, scene.heading.title, out, options.force)
        outcome.parts += told
        outcome.values |= values
    if drawn:
        from catheter.lab.views.inflate import save_inflation, timeline_of

        title = scene.heading.title
        save_view(outcome, options, lambda out: save_inflation(run, title, out), count=timeline_of(run))
    return outcome


def _outputs(options: argparse.Namespace) -> dict[str, Path]:
    """Return what is to be written, each place free. Raises BadInput, CannotWrite."""
    found = {name: Path(getattr(options, name)) for name in WRITERS if getattr(options, name)}
    if "vtu" in found and found["vtu"].suffix not in (".vtu", ".pvd"):
        raise BadInput("--vtu", f"is {found['vtu']}", "expected a name ending in .vtu or .pvd")
    for out in found.values():
        check_inputs(out, Path(options.scene))
        check_free(out, options.force)
    return found


Written = tuple[list[str], dict[str, Any]]


def _vtu(run: "Inflation", _title: str, out: Path, force: bool) -> Written:
    from fem.vtu import write_pvd, write_vtu

    if out.suffix == ".pvd":
        files = write_pvd(run, out, force=force)
    else:
        write_vtu(run, out, force=force)
        files = [out]
    return [f"{out} written, {len(files)} file(s)"], {"vtu": [str(path) for path in files]}


def _accumulator(run: "Inflation", title: str, out: Path, force: bool) -> Written:
    from catheter.response import spring
    from data.options import to_toml

    found = spring(run)
    fit, law = found.fit, found.accumulator
    told = {
        "model": "accumulator",
        "recording": title,
        "kind": "simulated",
        "rmse": f"{fit.rmse_pa!r} Pa",
        "rising": list(fit.rising),
        "range": list(fit.range),
        "standard_errors": [f"{e!r} Pa" for e in fit.standard_errors.tolist()],
    }
    spring_table = {
        "rest_volume": f"{law.rest_volume!r} m^3",
        "coefficients": [f"{c!r} Pa" for c in law.coefficients],
    }
    with fresh(out, force) as temporary:
        temporary.write_text(to_toml({"fit": told, "accumulator": spring_table}), encoding="utf-8")
    text = (
        f"{out} written: P = sum c_n (V - 1)^n of order {fit.order}, RMSE {fit.rmse_pa:.3g} Pa, rest "
        f"{1e6 * law.rest_volume:.4g} mL, rising for V = {fit.rising[0]:.3f} to {fit.rising[1]:.3f}"
    )
    values = {"out": str(out), "order": fit.order, "coefficients_pa": list(law.coefficients), "rmse_pa": fit.rmse_pa}
    return [text], {"accumulator": values | {"rest_volume_m3": law.rest_volume, "rising": list(fit.rising)}}


WRITERS = {"vtu": _vtu, "accumulator": _accumulator}


def _outcome(run: "Inflation", title: str, seconds: float) -> Outcome:
    ratio = run.volume / run.tube.rest_volume
    columns = {
        "pressure_kpa": run.pressure / 1e3,
        "volume_ratio": ratio,
        "twist_deg": np.degrees(run.twist),
        "extension_mm": run.extension * 1e3,
        "bending_deg": np.degrees(run.bending),
        "energy_mj": run.energy * 1e3,
        "stretch": np.array([run.stretch(k).max() for k in range(len(run.points))]),
    }
    over = [int(run.overstretched(k).sum()) for k in range(len(run.points))]
    rows = [
        {name: float(column[k]) for name, column in columns.items()}
        | {"overstretched": over[k], "stable": bool(run.stable[k]), "iterations": int(run.iterations[k])}
        for k in range(len(run.points))
    ]
    digits = (3, 4, 4, 4, 3, 4, 3)
    shown = [
        [
            *(f"{row[name]:.{n}f}" for name, n in zip(columns, digits, strict=True)),
            str(row["overstretched"]),
            "yes" if row["stable"] else "no",
            str(row["iterations"]),
        ]
        for row in rows
    ]
    head = ["kPa", "V/V0", "twist deg", "ext. mm", "bend deg", "W mJ", "stretch", "over", "stable", "its"]
    parts = [
        table(head, shown, f"{title} (simulated)", words=0),
        f"{len(run.system.free)} unknowns, {run.solver}, {run.iterations.sum()} Newton iterations, {seconds:.2f} s.",
        "Twist: end ring, anticlockwise as seen from +z. over: voxels stretched past their material's elongation.",
    ]
    values = {
        "simulated": True,
        "solver": run.solver,
        "unknowns": len(run.system.free),
        "seconds": seconds,
        "loads": rows,
    }
    return Outcome(values, parts)
