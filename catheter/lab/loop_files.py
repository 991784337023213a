"""The files a design loop ends in: the new map, its print files, and the picture of Figs. 6.18 and 6.22."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from catheter.lab.outcome import Outcome
from data.files import cannot_write, check_free, fresh

if TYPE_CHECKING:
    from catheter.design_loop import DesignLoop, Specimen

DEG, KPA = float(np.degrees(1.0)), 1e-3
STEM, PICTURE = "redesigned", "redesign.png"


def check_folder(folder: Path, first: "Specimen", force: bool) -> None:
    """Make the folder. Raises CannotWrite where that cannot be, or a file that is to be written is there already."""
    from fem.print_files import names

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error) from error
    printed = names(_map(first, first.stiff, "", 0.0), folder, STEM).values()
    for path in (folder / f"{STEM}.toml", *printed, folder / f"{STEM}.3mf", folder / PICTURE):
        check_free(path, force)


def write_files(loop: "DesignLoop", title: str, folder: Path, force: bool) -> Outcome:
    """Write map, print files, which are read back, and picture. Raises CannotWrite."""
    from fem.print_files import write_prints
    from fem.voxel_map import write_map

    made = _map(loop.first, loop.redesign.after.chosen, title, loop.redesign.pressure_pa)
    drawn = folder / f"{STEM}.toml"
    write_map(made, drawn, force=force)
    files = write_prints(made, folder, STEM, force=force)
    with fresh(folder / PICTURE, force) as temporary:
        picture(loop, temporary)
    paths = [drawn, *(one.path for one in files.stl), files.mf[0].path, folder / PICTURE]
    read = {one.material: one.voxels for one in files.stl}
    told = ", ".join(f"{count} of {material}" for material, count in read.items() if count)
    text = f"Print files read back voxel for voxel ({told}); written: {', '.join(map(str, paths))}"
    return Outcome({"files": [str(path) for path in paths], "read_back": read}, [text])


def _map(first: "Specimen", stiff: Any, title: str, pressure_pa: float) -> Any:
    """Return the voxel map of a tube (around, along) whose stiff voxels are given."""
    from fem.voxel_map import Sizes, VoxelMap

    shape, pattern = first.shape, first.pattern
    return VoxelMap(
        title=f"{title}, redesigned for {pressure_pa * KPA:.2f} kPa",
        sizes=Sizes(length=shape.length, outer_radius=shape.outer_radius, wall=shape.wall),
        materials=(pattern.soft, pattern.stiff),
        voxels=np.asarray(stiff, dtype=np.int64).reshape(shape.voxels),
    )


def picture(loop: "DesignLoop", path: Path) -> None:
    """Write a picture of the twist curves (thesis Fig. 6.22), both maps, and the errors (Fig. 6.18)."""
    from catheter.lab.plot import axes, draw_errors, save, sheet

    figure = sheet("a printed actuator, filmed and designed anew", loop.first.film.kind, size=(14, 9))
    draw_curves(loop, axes(figure, ("pressure", "kPa"), ("twist", "deg"), at=(2, 3, 1)))
    made, grid = loop.redesign, loop.first.shape.voxels
    for at, (title, chosen) in enumerate((("design", made.before.chosen), ("redesign", made.after.chosen)), start=2):
        plot = axes(figure, ("voxel around", ""), ("voxel along", ""), at=(2, 3, at), title=f"stiff voxels, {title}")
        plot.grid(visible=False)
        plot.imshow(chosen.reshape(grid).T, origin="lower", aspect="auto", cmap="Greys")
    draw_errors(figure, loop.errors[-1], (2, 3, 4))
    save(figure, path)


def error_picture(loop: "DesignLoop", path: Path) -> None:
    """Write a picture of the errors alone (thesis Fig. 6.18)."""
    from catheter.lab.plot import draw_errors, save, sheet

    figure = sheet("redesign minus design, in every voxel", "simulated", size=(12, 3.6))
    draw_errors(figure, loop.errors[-1], (1, 3, 1))
    save(figure, path)


def draw_curves(loop: "DesignLoop", plot: Any) -> None:
    """Draw twist over pressure: circles the model, points the films, and the band in which 95 % of specimens lie."""
    from catheter.lab.plot import COLOURS

    colours = dict(zip(("design", "redesign", "drawn"), COLOURS, strict=False))
    for one in loop.curves:
        style = {"marker": ".", "linestyle": "", "markersize": 3} if one.film else {"marker": "o", "markersize": 5}
        style |= {} if one.film else {"fillstyle": "none", "linewidth": 0.8}
        plot.plot(KPA * one.pressure, DEG * one.twist, color=colours[one.map], label=one.name, **style)
    middle, soft, stiff = loop.calibrated.response, *loop.closing.scatter
    around = loop.scatter(middle.pressure)
    ends = [DEG * (middle.values["twist"] + side * around) for side in (-1, 1)]
    told = f"95 % of specimens (assumed: c1 scatters by {soft:.0%}, {stiff:.0%})"
    plot.fill_between(KPA * middle.pressure, *ends, color=COLOURS[0], alpha=0.15, label=told)
    low, high = plot.get_ylim()
    if high < -low:  # room for the names, above what turns clockwise, below what does not
        plot.set_ylim(low, high + 0.4 * (high - low))
    else:
        plot.set_ylim(low - 0.4 * (high - low), high)
    plot.legend(fontsize=7, loc="upper right" if high < -low else "lower right")
