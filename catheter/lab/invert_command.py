"""The command that inverts: a scene's wanted motion to a material map, or a recording to material constants."""

import argparse
import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from catheter.lab.outcome import Outcome, table
from data.errors import BadInput, CatheterError
from data.files import check_free, check_inputs

if TYPE_CHECKING:
    from catheter.lab.scene import Scene
    from catheter.reconstruction import Case
    from fem.inverse import Iteration, Reconstruction

KINDS = ("inverse", "inverse-block")
MOST_DENSE = 4096  # voxels whose dense curvature is made


def invert_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `invert`."""
    parser.add_argument("source", nargs="?", default="invert_twist", help="a scene, or a recording (.mcap)")
    parser.add_argument("--scene", help="for a recording: the actuator's scene (default: the recording's own)")
    parser.add_argument("--seed", choices=("uniform", "gap", "random"), help="where the search starts")
    parser.add_argument(
        "--seen", choices=("all", "outer", "markers", "centreline", "tip", "twist"), help="what is seen"
    )
    parser.add_argument("--noise", type=float, metavar="SHARE", help="of the largest displacement")
    parser.add_argument("--number", type=int, help="of the random streams of noise and seed")
    parser.add_argument("--out", metavar="MAP.npz", help="the map; an interrupted run is continued from it")
    parser.add_argument("--view", metavar="FILE.rrd", help="map unwrapped, shape on target, misfit curve")
    parser.add_argument("--camera-noise", type=float, default=0.05, metavar="DEG", help="of a recorded twist")
    parser.add_argument("--pressure-noise", type=float, default=0.01, metavar="SHARE", help="of a recorded pressure")
    parser.add_argument("--force", action="store_true", help="begin anew and overwrite the outputs")


def invert_(options: argparse.Namespace) -> Outcome:
    """Invert a scene or a recording."""
    if str(options.source).endswith(".mcap"):
        return _calibrated(options)
    from catheter.lab.scene import Scene

    scene = Scene.load(options.source)
    if scene.heading.kind == "inverse-shape":
        return _reached(options, scene)
    case, scene = _case(options)
    out = Path(options.out) if options.out else None
    view = Path(options.view) if options.view else None
    for path in filter(None, (view,)):
        check_free(path, options.force)
    seed = _resumed(out, case, options.force) if out else None
    with _live(scene.heading.title) as tell:

        def each(iteration: "Iteration") -> None:
            tell(iteration)
            if out:
                _keep(out, case, np.exp(iteration.log), iteration)

        found = _solved(case, scene, seed, each)
    outcome = _outcome(case, scene, found)
    if out:
        outcome.parts.append(f"Map: {out}")
    palette = scene.tables.get("palette")
    printed = _printable(case, found, palette) if palette and palette.materials else {}
    if printed:
        outcome.values["printable"] = printed
        outcome.parts.append(_palette_table(printed))
    if view:
        from catheter.lab.views.inverse import save_inverse

        save_inverse(case, found, scene.heading.title, view)
        outcome.values["view"] = str(view)
        outcome.parts.append(f"Dashboard: {view}   (look at it with: rerun {view})")
    return outcome


def _reached(options: argparse.Namespace, scene: "Scene") -> Outcome:
    """Say how near a scene's shape is reached. Raises BadInput for options that are for other scenes."""
    from catheter.lab.outcome import progress
    from catheter.lab.reach_study import studied

    for name in ("seed", "seen", "noise", "number", "view"):
        if getattr(options, name) is not None:
            raise BadInput(f"--{name}", "is given for a shape that is wanted", "set [reach] in the scene")
    out = Path(options.out) if options.out else None
    if out:
        check_free(out, options.force)
    with progress(scene.heading.title) as advance:
        found = studied(scene, advance)
    best = found.best
    if out:
        from data.files import fresh

        grid = np.array(best.goal.grid)
        with fresh(out, options.force) as temporary, temporary.open("wb") as file:
            np.savez(file, moduli_pa=best.found.moduli, grid=grid, pressure_pa=best.pressure, origin="simulated")
    values = {
        "simulated": True,
        "title": found.title,
        "pressure_pa": best.pressure,
        "rms_mm": 1e3 * best.off.rms,
        "largest_mm": 1e3 * best.off.largest,
        "rows": [vars(row) for row in found.rows],
        "moduli_pa": best.found.moduli.reshape(best.goal.grid).tolist(),
        "printed_pa": None if found.chosen is None else found.chosen.reshape(best.goal.grid).tolist(),
    }
    rows = [[r.method, r.level, r.error_text, f"{r.seconds:.3g}"] for r in found.rows]
    shown = table(
        ["map", "how it ended", "rms mm", "s"], rows, f"{found.title} (simulated): distance of the centreline"
    )
    return Outcome(values, [shown, *found.notes, *([f"Map: {out}"] if out else [])])


def _case(options: argparse.Namespace, name: str = "") -> "tuple[Case, Scene]":
    from dataclasses import replace

    from catheter.lab.scene import Scene
    from catheter.reconstruction import cube_case, tube_case

    scene = Scene.load(name or options.source)
    if scene.heading.kind not in KINDS:
        raise BadInput(f"scene {options.source}", f"is a {scene.heading.kind} scene", "an inverse scene has a [wanted]")
    wanted = scene.tables["wanted"]
    given = {key: getattr(options, key) for key in ("seed", "seen", "noise", "number")}
    wanted = replace(wanted, **{key: value for key, value in given.items() if value is not None})
    if scene.heading.kind == "inverse":
        return tube_case(scene.tables["tube"], scene.tables["map"], wanted), scene
    return cube_case(scene.tables["block"], wanted), scene


def _solved(case: "Case", scene: "Scene", seed: Any, each: Any) -> "Reconstruction":
    from catheter.reconstruction import solved

    return solved(case, scene.tables["inversion"], seed, each)


def _keep(out: Path, case: "Case", moduli: Any, iteration: "Iteration") -> None:
    """Write the map so far, in one step."""
    import os

    part = out.with_name(out.name + ".partial")
    with part.open("wb") as file:
        np.savez(
            file, moduli_pa=moduli, grid=np.array(case.grid), iteration=iteration.number, misfit=iteration.misfit,
            seconds=iteration.seconds, origin="simulated",
        )  # fmt: skip
    os.replace(part, out)  # noqa: PTH105, Path.replace does the same


def _resumed(out: Path, case: "Case", force: bool) -> Any:
    """Return the moduli of an interrupted run, or None. Raises BadInput for a file that is no such map."""
    if force or not out.exists():
        check_free(out, force)
        return None
    try:
        with np.load(out, allow_pickle=False) as file:
            moduli, grid = file["moduli_pa"], tuple(file["grid"].tolist())
    except (OSError, ValueError, KeyError) as error:
        raise BadInput(out, f"is no map: {error}", "name another file, or begin anew with --force") from error
    if grid != case.grid or moduli.shape != (case.voxels.count,):
        raise BadInput(out, f"has {grid} voxels", f"expected {case.grid}; name another file, or --force")
    return moduli


def _live(title: str) -> Any:
    """Return a context that shows each iteration on a terminal."""
    from contextlib import contextmanager

    from rich.console import Console

    @contextmanager
    def live() -> Any:
        console = Console(stderr=True)
        with console.status(title) as status:

            def tell(one: "Iteration") -> None:
                status.update(f"{title}: iteration {one.number}, misfit {one.misfit:.2e}, {one.seconds:.1f} s")

            yield tell

    return live()


def _outcome(case: "Case", scene: "Scene", found: "Reconstruction") -> Outcome:
    from catheter.reconstruction import Quality
    from fem.uncertainty import determined

    quality = Quality.of(found.moduli, case.truth)
    few = case.voxels.count <= MOST_DENSE
    known = determined(case.problem, found, case.variation, scene.tables["inversion"]) if few else None
    unit = "noises" if case.wanted.noise else "of the largest value"
    history = [
        {"iteration": i.number, "seconds": i.seconds, "misfit": i.misfit, "weight": i.weight} for i in found.history
    ]
    values = {
        "simulated": True,
        "title": scene.heading.title,
        "seconds": found.seconds,
        "ended": found.why,
        "peak_memory_bytes": _peak_memory(),
        "misfit": found.misfit,
        "weight": found.weight,
        "strengthened": found.strengthened,
        "at_bounds": {"least": int((found.bounded < 0).sum()), "most": int((found.bounded > 0).sum())},
        "error": asdict(quality),
        "determined": {
            "singular_values": known.singular.tolist(),
            "posterior_sd_log": known.sd.tolist(),
            "undetermined_voxels": int((~known.seen).sum()),
        }
        if known
        else None,
        "history": history,
        "moduli_pa": found.moduli.reshape(case.grid).tolist(),
    }
    rows = [[str(h["iteration"]), f"{h['seconds']:.2f}", f"{h['misfit']:.2e}", f"{h['weight']:.1e}"] for h in history]
    parts = [
        table(["iteration", "s", f"misfit, {unit}", "weight"], rows, f"{scene.heading.title} (simulated)", words=0),
        f"{found.why} after {found.seconds:.1f} s; modulus errors: largest {quality.largest:.2e},"
        f" median {quality.median:.2e}; {100 * quality.right:.1f} % on the right side of stiff/soft.",
        f"At the least modulus {(found.bounded < 0).sum()}, at the most {(found.bounded > 0).sum()} of"
        f" {len(found.moduli)}; the seed was doubled {found.strengthened} times.",
        f"More than {MOST_DENSE} voxels: what the data determine is not worked out."
        if known is None
        else f"Singular values {known.singular[0]:.2e} to {known.singular[-1]:.2e}; posterior sd of log modulus: median"
        f" {np.median(known.sd):.1e}, most {known.sd.max():.1e}; {(~known.seen).sum()} voxels not determined.",
    ]
    return Outcome(values, parts)


def _peak_memory() -> int | None:
    """Return the most memory this process has held [bytes], where the system says."""
    try:
        import resource
    except ImportError:
        return None
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _printable(case: "Case", found: "Reconstruction", palette: Any) -> dict[str, dict[str, float | str]]:
    """Return what each discretisation of a map would do: displacement errors of all nodes [mm], simulated."""
    from catheter.reconstruction import discretised

    rows: dict[str, dict[str, float | str]] = {}
    for name, made in discretised(case, found, palette):
        if isinstance(made, CatheterError):
            rows[name] = {"failed": str(made)}
            continue
        errors = case.errors(made.standings)
        names = [str(case.names(palette)[k]) for k in made.chosen]
        rows[name] = {
            "rms_mm": 1e3 * float(np.sqrt((errors**2).mean())),
            "largest_mm": 1e3 * float(errors.max()),
            "materials": len(set(names)),
            "solved": made.solved,
            "overstretched": palette.overstretched(case.voxels, made.chosen, made.standings),
            "as_true": float((palette.moduli_of(made.chosen) == case.truth).mean()),
        }
    return rows


def _palette_table(printed: dict[str, dict[str, Any]]) -> Any:
    rows = [
        [name, row["failed"], "", "", "", ""]
        if "failed" in row
        else [
            name,
            f"{row['rms_mm']:.4f}",
            f"{row['largest_mm']:.4f}",
            f"{100 * row['as_true']:.1f}",
            str(row["solved"]),
            str(row["overstretched"]),
        ]
        for name, row in printed.items()
    ]
    head = ["printed map (simulated)", "rms error mm", "largest mm", "as the truth %", "solved", "overstretched"]
    return table(head, rows)


def _calibrated(options: argparse.Namespace) -> Outcome:
    """Calibrate a scene's two materials from a recording's pressure and twist."""
    from catheter.filmed import seen
    from catheter.lab.scene import recorded_scene
    from catheter.redesign import calibrated

    source = Path(options.source)
    if options.view:
        check_inputs(Path(options.view), source)
    scene = recorded_scene(source, options.scene, ("tube", "map"))
    found = seen(source, scene.tables.get("cameras"))
    pressure, angle = found.pairs()
    sigma = math.radians(options.camera_noise) if math.isnan(found.sigma) else found.sigma
    shape, pattern = scene.tables["tube"], scene.tables["map"]
    fitted = calibrated(shape, pattern, pressure, angle, angle_sd=sigma, pressure_share=options.pressure_noise)
    seed = np.unique(pattern.moduli(*shape.voxels))
    names = [pattern.soft, pattern.stiff]
    rows = [
        [name, f"{m / 1e6:.4f}", f"{low / 1e6:.4f}", f"{high / 1e6:.4f}", f"{s / 1e6:.4f}"]
        for name, m, (low, high), s in zip(names, fitted.moduli, fitted.interval, seed, strict=True)
    ]
    head = ["material", "c1 MPa", "95 % from", "to", "as in the table"]
    values = {
        "origin": found.kind, "samples": len(pressure), "misfit": fitted.misfit, "steps": fitted.steps,
        "materials": {
            name: {"c1_pa": float(m), "interval_pa": [float(a), float(b)]}
            for name, m, (a, b) in zip(names, fitted.moduli, fitted.interval, strict=True)
        },
    }  # fmt: skip
    title = f"{source.name} ({found.kind}): two moduli from {len(pressure)} samples of pressure and twist"
    return Outcome(
        values, [table(head, rows, title), f"Misfit {fitted.misfit:.2f} of the noise given, {fitted.steps} steps."]
    )
