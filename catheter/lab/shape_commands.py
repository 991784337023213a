"""The commands that shape and print: an actuator for a vessel, and a voxel map's files."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from catheter.lab.dashboard import check_view, save_view, view_options
from data.errors import BadInput

if TYPE_CHECKING:
    from catheter.lab.outcome import Outcome
    from catheter.lab.shape_view import Shaped
    from fem.print_files import Printed
    from fem.slices import Sliced
    from fem.voxel_map import VoxelMap


def shape_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `shape`."""
    parser.add_argument("scene", nargs="?", default="renal_spiral", help="a shipped scene, or a .toml file")
    parser.add_argument("--vessel", metavar="FILE", help="a .csv, .vtp or .vtk centreline instead of the scene's")
    parser.add_argument("--unit", choices=("mm", "cm", "m"), help="the unit of that file, if it states none")
    parser.add_argument("--q", action="append", type=float, metavar="Q", help="joint parameter, 0 to 1; repeatable")
    parser.add_argument("--voxel", metavar="I,J", help="query a voxel (around, along): gradient, strain, det F")
    parser.add_argument("--map", metavar="MAP", help="flag voxels stretched past their material in this voxel map")
    parser.add_argument("--target", metavar="FILE.npz", help="write the nodes at rest and at the last q for a solver")
    view_options(parser, "q from 0 to 1 inside the vessel", flag="--out")
    parser.add_argument("--force", action="store_true", help="overwrite outputs")


def print_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `print`."""
    parser.add_argument("map", help="a shipped voxel map (twist, twist7), or a .toml file")
    parser.add_argument("--out", metavar="FOLDER", required=True, help="the folder to write to, made if need be")
    parser.add_argument("--slices", action="store_true", help="also write a picture of every layer")
    parser.add_argument("--pixel", metavar="LENGTH", help="of a slice, as '42.3 um' (default: 600 dots an inch)")
    parser.add_argument("--layer", metavar="LENGTH", help="height of a slice, as '27 um' (default)")
    parser.add_argument("--force", action="store_true", help="overwrite earlier files")


def shape_(options: argparse.Namespace) -> "Outcome":
    """Shape an actuator and say what it fills, how it is strained, and whether its volume is kept."""
    from catheter.lab.shape_view import shape_outcome, shaped
    from data.files import check_free, check_inputs

    inputs = [options.vessel] if options.vessel else []
    drawn = check_view(options, *inputs)
    if options.target:
        check_free(Path(options.target), options.force)
        check_inputs(Path(options.target), *map(Path, inputs))
    found = shaped(options.scene, options.q, options.vessel, options.unit)
    voxel = _voxel(options.voxel)
    outcome = shape_outcome(found, voxel, options.map)
    if options.target:
        _save_target(outcome, found, Path(options.target), options.force)
    if drawn:
        from catheter.lab.views.shapes import TIMELINE, save_shape

        save_view(outcome, options, lambda path: save_shape(found, voxel, path), count=TIMELINE)
    return outcome


def _voxel(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    try:
        i, j = (int(word) for word in text.split(","))
    except ValueError as error:
        raise BadInput("--voxel", f"is {text!r:.40}", "expected two numbers, as 3,7") from error
    return i, j


def _save_target(outcome: "Outcome", found: "Shaped", path: Path, force: bool) -> None:
    from catheter.target import target
    from data.files import fresh

    made = target(found.shape, found.actuator, found.qs[-1])
    with fresh(path, force) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            undeformed=made.undeformed.nodes,
            deformed=made.deformed,
            hexes=made.undeformed.hexes,
            index=made.undeformed.index,
            q=made.q,
            about=f"{found.title}; simulated; nodes (n, 3) in m, frame of the base, order of fem's tube lattice",
        )
    outcome.values["target"] = {"file": str(path), "nodes": len(made.deformed), "base_moves_mm": 1e3 * made.base}
    outcome.parts.append(
        f"Target: {path}, {len(made.deformed)} nodes at rest and at q = {made.q:g}; the base ring moves by up to"
        f" {1e3 * made.base:.3g} mm."
    )


def print_(options: argparse.Namespace) -> "Outcome":
    """Write a voxel map's files and say what was read back from each."""
    from catheter.lab.outcome import progress
    from data.files import cannot_write, check_free
    from data.options import read
    from fem.print_files import names, write_prints
    from fem.slices import Resolution, write_slices
    from fem.voxel_map import load_map

    given = {name: getattr(options, name) for name in ("pixel", "layer") if getattr(options, name)}
    if given and not options.slices:
        raise BadInput(f"--{next(iter(given))}", "is given without --slices", "add --slices")
    resolution = read(Resolution, given, "command line")
    made, folder, stem = load_map(options.map), Path(options.out), Path(options.map).stem
    if folder.exists() and not folder.is_dir():
        raise BadInput(folder, "is no folder", "name one")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error) from error
    for path in (*names(made, folder, stem).values(), folder / f"{stem}.3mf"):
        check_free(path, options.force)
    with progress(f"print {stem}") as advance:
        share = 0.5 if options.slices else 1.0
        found = write_prints(made, folder, stem, force=options.force, progress=lambda x: advance(share * x))
        sliced = None
        if options.slices:
            place = folder / f"{stem}_slices"
            later = lambda x: advance(0.5 + x / 2)  # noqa: E731
            sliced = write_slices(made, place, resolution, force=options.force, progress=later)
    return _print_outcome(made, found, sliced)


def _print_outcome(made: "VoxelMap", found: "Printed", sliced: "Sliced | None") -> "Outcome":
    from catheter.lab.outcome import Outcome, table
    from fem.voxel_map import UNCERTAIN

    rows = [
        [w.material, w.path.name, f"{w.triangles:,}", f"{w.volume:.4f}", f"{w.error:.0e}", str(w.voxels)]
        for w in found.stl
    ]
    head = ["material", "file", "triangles", "volume mm^3", "rel. error", "voxels"]
    around, along = made.voxels.shape
    worst = max(w.error for w in found.mf)
    parts: list[Any] = [
        table(head, rows, f"{made.title}: {around} x {along} voxels, read back from every STL", words=2),
        f"All closed; their volumes sum to the solid's within {abs(found.closure):.0e}; no face twice; every voxel as"
        f" in the map.\nCorners rounded to what STL holds: the solid's volume changes by {found.rounded:.0e}.",
        f"{found.mf[0].path}: {len(found.mf)} objects, each as its STL, volumes within {worst:.0e}.",
    ]
    if found.edges:
        parts.insert(2, f"{found.edges} edges where voxels of one material met were opened by a thousandth of a voxel.")
    if made.sizes.cap:
        s = made.sizes
        parts.append(f"Caps: {1e3 * s.cap:g} mm beyond each end, {s.cap_material}, hole {1e3 * s.hole:g} mm.")
    if loose := [part for part in made.parts if part in UNCERTAIN]:
        parts.append(f"{', '.join(loose)}: specimens scatter (thesis Fig. 5.4) or no fit is named; expect others.")
    values: dict[str, Any] = {
        "files": [
            {
                "path": str(w.path),
                "material": w.material,
                "triangles": w.triangles,
                "volume_mm3": w.volume,
                "relative_error": w.error,
                "voxels": w.voxels,
            }
            for w in (*found.stl, *found.mf)
        ],
        "closure": found.closure,
        "rounded": found.rounded,
        "opened_edges": found.edges,
    }
    if sliced:
        um = 1e6 * sliced.resolution.pixel, 1e6 * sliced.resolution.layer
        parts.append(
            f"{sliced.folder}: {sliced.layers} layers of {sliced.pixels} x {sliced.pixels} pixels, {um[0]:.1f} um,"
            f" {um[1]:.1f} um high; voxels as in the map."
        )
        values["slices"] = {
            "folder": str(sliced.folder),
            "layers": sliced.layers,
            "pixels": sliced.pixels,
            "pixel_um": um[0],
            "layer_um": um[1],
            "voxels": sliced.voxels,
        }
    return Outcome(values, parts)
