"""The command `redesign`: from a filmed, printed actuator to materials, a better design and its print files.

Clocks, twist, model beside measurement, calibration, redesign and print files in one go; each is a
command of its own too (`twin`, `invert`, `print`).
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from catheter.lab.outcome import Outcome, progress, table
from data.files import fresh
from data.units import quantity

if TYPE_CHECKING:
    from catheter.calibrate import Calibration
    from catheter.filmed import Filmed
    from catheter.lab.scene import Scene
    from catheter.redesign import Redesign

DEG, MM, KPA = float(np.degrees(1.0)), 1e3, 1e-3


@dataclass(frozen=True)
class _Loop:
    """All that the experiment told."""

    film: "Filmed"
    scene: "Scene"
    calibration: "Calibration"
    redesign: "Redesign"
    model_rmse: tuple[float, float]  # of the twist [rad], with the table's materials and the calibrated ones


def redesign_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `redesign`."""
    parser.add_argument("recording", help="an MCAP file: /pressure, /led, /camera/top and /camera/side")
    parser.add_argument("--scene", help="the actuator's scene (default: the recording's own)")
    parser.add_argument("--pressure", default="60 kPa", help="at which the actuator should move as designed")
    parser.add_argument("--pressure-noise", type=float, default=0.0025, metavar="SHARE", help="of the gauge's reading")
    parser.add_argument(
        "--scatter", type=float, nargs=2, default=(0.05, 0.10), metavar=("SOFT", "STIFF"),
        help="standard deviation of c1 from specimen to specimen, assumed (default: 0.05 0.10)",
    )  # fmt: skip
    parser.add_argument("--out", metavar="DIR", help="map, print files and picture of the new design")
    parser.add_argument("--force", action="store_true", help="overwrite earlier files")


def redesign_(options: argparse.Namespace) -> Outcome:
    """Close the loop from a film to print files."""
    pressure = float(quantity(options.pressure, "Pa", "--pressure"))
    with progress("film, calibration, redesign") as advance:
        loop = _closed(options, pressure, advance)
    values = _values(loop, pressure)
    outcome = Outcome(values, list(_parts(loop, values, pressure)))
    if options.out:
        _files(loop, Path(options.out), options, outcome)
    return outcome


def _closed(options: argparse.Namespace, pressure: float, advance: Callable[[float], None]) -> _Loop:
    from catheter.filmed import Filmed
    from catheter.lab.scene import recorded_scene
    from catheter.printed_bench import Cameras
    from catheter.redesign import calibrated, redesign

    source = Path(options.recording)
    scene = recorded_scene(source, options.scene, ("tube", "map"))
    film = Filmed(source, scene.tables.get("cameras", Cameras()))
    shape, pattern = scene.tables["tube"], scene.tables["map"]
    seen = film.seen
    load, angle = seen.pairs()
    advance(0.1)
    found = calibrated(shape, pattern, load, angle, angle_sd=seen.sigma, pressure_share=options.pressure_noise)
    advance(0.6)
    made = redesign(shape, pattern, found.moduli, pressure)
    advance(0.95)
    stiff = made.before.chosen
    table_moduli = np.unique(made.case.truth)
    residuals = [
        float(np.sqrt(np.mean((_curve(made, moduli[stiff], load) - angle) ** 2)))
        for moduli in (table_moduli, found.moduli)
    ]
    return _Loop(film, scene, found, made, (residuals[0], residuals[1]))


def _curve(made: "Redesign", moduli: Any, load: Any) -> Any:
    """Return a map's twist at pressures (n,), by a spline through a few equilibria."""
    from scipy.interpolate import CubicSpline

    knots = np.linspace(0, 1.0001 * float(load.max()), 13)
    return CubicSpline(knots, np.append(0.0, made.twists(moduli, knots[1:])))(np.clip(load, 0, knots[-1]))


def _rows(loop: _Loop, pressure: float) -> list[tuple[str, float, Any]]:
    made = loop.redesign
    return [
        ("as printed, at the design's pressure", pressure, made.before),
        ("as printed, at a pressure that twists as designed", made.pressure_pa, made.driven),
        ("voxels chosen anew, at that pressure", made.pressure_pa, made.after),
    ]


def _values(loop: _Loop, pressure: float) -> dict[str, Any]:
    film, made = loop.film, loop.redesign
    pattern = loop.scene.tables["map"]
    return {
        "kind": film.kind,
        "clocks": {camera: vars(film.clock(camera)) for camera in ("top", "side")},
        "frames": len(film.twist.time_s),
        "missing": film.missing,
        "most_twist_rad": float(np.nanmax(np.abs(film.twist.value))),
        "most_extension_m": float(np.nanmax(film.extension.value)),
        "model_rmse_rad": {"table": loop.model_rmse[0], "calibrated": loop.model_rmse[1]},
        "materials": {
            name: {"c1_pa": float(c1), "interval_pa": interval.tolist()}
            for name, c1, interval in zip(
                (pattern.soft, pattern.stiff), loop.calibration.moduli, loop.calibration.interval, strict=True
            )
        },
        "design_twist_rad": made.twist(made.case.whole[0]),
        "redesign": [
            {
                "what": what, "pressure_pa": at, "twist_rad": made.twist(one.standings[0]),
                "rms_m": float(np.sqrt((made.errors(one) ** 2).mean())), "largest_m": float(made.errors(one).max()),
            }
            for what, at, one in _rows(loop, pressure)
        ],
        "voxels_changed": int((made.after.chosen != made.before.chosen).sum()),
    }  # fmt: skip


def _parts(loop: _Loop, values: dict[str, Any], pressure: float) -> Any:
    film, made = loop.film, loop.redesign
    for camera, clock in values["clocks"].items():
        yield (
            f"Camera {camera}: its clock {1e3 * clock['offset_s']:+.2f} ms, 95 % from {1e3 * clock['low_s']:.2f} to "
            f"{1e3 * clock['high_s']:.2f} ms, by {clock['steps']} steps of light"
        )
    yield (
        f"{values['frames']} frames ({film.kind}), {film.missing} without a marker; twist to "
        f"{values['most_twist_rad'] * DEG:.2f} deg, extension to {values['most_extension_m'] * MM:.2f} mm"
    )
    rows = [
        [
            name,
            f"{found['c1_pa'] / 1e6:.4f}",
            *(f"{end / 1e6:.4f}" for end in found["interval_pa"]),
            f"{known / 1e6:.4f}",
        ]
        for (name, found), known in zip(values["materials"].items(), np.unique(made.case.truth), strict=True)
    ]
    yield table(
        ["material", "c1 MPa", "95 % from", "to", "in the table"], rows, f"Materials from the film ({film.kind})"
    )
    before, after = (value * DEG for value in loop.model_rmse)
    yield f"Model beside film: {before:.3f} deg rms with the table's materials, {after:.3f} deg with these (simulated)"
    rows = [
        [one["what"], f"{one['pressure_pa'] * KPA:.2f}", f"{one['twist_rad'] * DEG:.3f}", f"{one['rms_m'] * MM:.4f}",
         f"{one['largest_m'] * MM:.4f}"]
        for one in values["redesign"]
    ]  # fmt: skip
    title = f"Designed: {values['design_twist_rad'] * DEG:.3f} deg at {pressure * KPA:g} kPa (simulated)"
    yield table(["", "kPa", "twist deg", "off by, rms mm", "largest mm"], rows, title, words=2)
    yield f"{values['voxels_changed']} voxels changed."


def _files(loop: _Loop, folder: Path, options: argparse.Namespace, outcome: Outcome) -> None:
    """Write the new map, its print files and the picture."""
    from catheter.lab.plot import save, sheet
    from data.files import cannot_write
    from fem.print_files import write_prints
    from fem.voxel_map import Sizes, VoxelMap, write_map

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error) from error
    shape, pattern = loop.scene.tables["tube"], loop.scene.tables["map"]
    voxels = loop.redesign.after.chosen.reshape(shape.voxels)
    title = f"{loop.scene.heading.title}, redesigned for {loop.redesign.pressure_pa * KPA:.2f} kPa"
    sizes = Sizes(length=shape.length, outer_radius=shape.outer_radius, wall=shape.wall)
    made = VoxelMap(title=title, sizes=sizes, materials=(pattern.soft, pattern.stiff), voxels=voxels)
    write_map(made, folder / "redesigned.toml", force=options.force)
    files = write_prints(made, folder, "redesigned", force=options.force)
    with fresh(folder / "redesign.png", options.force) as temporary:
        figure = sheet("a printed actuator, filmed and designed anew", loop.film.kind, size=(11, 8))
        _draw(loop, options.scatter, figure)
        save(figure, temporary)
    paths = [folder / "redesigned.toml", *(one.path for one in files.stl), files.mf[0].path, folder / "redesign.png"]
    outcome.values["files"] = [str(path) for path in paths]
    outcome.parts.append(f"Written, and the print files read back voxel for voxel: {', '.join(map(str, paths))}")


def _draw(loop: _Loop, scatter: tuple[float, float], figure: Any) -> None:
    """Draw the twist curves of thesis Fig. 6.22 with a band, both maps, and the error in each voxel (Fig. 6.18)."""
    from catheter.lab.plot import COLOURS, axes

    film, made = loop.film, loop.redesign
    load = film.pressure.at(film.twist.time_s)
    plot = axes(figure, ("pressure", "kPa"), ("twist", "deg"), at=(2, 2, 1))
    knots = np.linspace(0, float(np.nanmax(load)), 9)[1:]
    stiff = made.before.chosen
    curves = {
        "design, table's materials (simulated)": made.case.truth,
        "as printed, calibrated (simulated)": loop.calibration.moduli[stiff],
        "voxels anew, calibrated (simulated)": loop.calibration.moduli[made.after.chosen],
    }
    drawn = {name: DEG * made.twists(moduli, knots) for name, moduli in curves.items()}
    for colour, (name, angles) in zip(COLOURS, drawn.items(), strict=False):
        plot.plot(KPA * knots, angles, "o-", color=colour, markersize=4, fillstyle="none", label=name)
    spread = np.zeros(len(knots))
    for which, share in enumerate(scatter):  # first order: one specimen's modulus is off by a standard deviation
        off = np.where(np.arange(2) == which, 1 + share, 1.0)
        moved = DEG * made.twists((loop.calibration.moduli * off)[stiff], knots)
        spread = np.hypot(spread, moved - drawn["as printed, calibrated (simulated)"])
    middle = drawn["as printed, calibrated (simulated)"]
    told = f"95 % of specimens, c1 scattering by {scatter[0]:.0%} and {scatter[1]:.0%} (assumed)"
    plot.fill_between(
        KPA * knots, middle - 1.96 * spread, middle + 1.96 * spread, color=COLOURS[1], alpha=0.2, label=told
    )
    plot.plot(KPA * load, DEG * film.twist.value, ".", color="black", markersize=3, label=f"film ({film.kind})")
    plot.legend(fontsize=6)
    grid = made.case.grid
    for at, (title, chosen) in enumerate((("as printed", made.before.chosen), ("anew", made.after.chosen)), start=2):
        image = axes(figure, ("voxel around", ""), ("voxel along", ""), at=(2, 2, at), title=f"stiff voxels, {title}")
        image.grid(visible=False)
        image.imshow(chosen.reshape(grid).T, origin="lower", aspect="auto")
    errors = axes(figure, ("distance from the design", "mm"), ("share of nodes", "%"), at=(2, 2, 4))
    for name, _, one in _rows(loop, float("nan")):
        off_mm = np.sort(MM * made.errors(one))
        errors.plot(off_mm, 100 * np.arange(1, len(off_mm) + 1) / len(off_mm), label=name)
    errors.legend(fontsize=6)
