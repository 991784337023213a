"""Chapter 6, what inverse design gives: the three motions found again, a printable twist, Figs. 6.7 to 6.22.

All is simulated. The printable actuator is found from its outer surface with noise, for from exact
data every voxel is found exactly and Fig. 6.18 would be empty.
"""

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from catheter.error_map import error_map
from catheter.lab.plot import COLOURS, axes, draw_errors, image
from catheter.lab.scene import Scene
from catheter.lab.thesis.entries import AGREES, DIFFERS, Entry, Figure, Section, told
from catheter.reconstruction import Case, discretised, solved, tube_case
from data.errors import CatheterError
from data.signal import Array
from fem.grid import skin
from fem.inverse import Inversion, Reconstruction
from fem.palette import Printed, dithered

MM, MPA, DEG = 1e3, 1e-6, float(np.degrees(1.0))
MOTIONS = {  # scene: its figures of residual and shape, and how many iterations the thesis took
    "invert_balloon": ("6.9", "6.10", "ballooning", "12"),
    "invert_bend": ("6.11", "6.12", "bending", "3"),
    "invert_twist": ("6.14", "6.15", "twisting", "7"),
}
NOISE = 0.01
BAR_MM = 0.3  # section 6.5: the displacement error was below it everywhere
OTHER = "another method: Gauss-Newton in log modulus from one modulus everywhere, not an SQP from a seed"


@dataclass(frozen=True, eq=False)
class Found:
    """A case with the map that was found."""

    case: Case
    map: Reconstruction
    options: Inversion


def reconstructions(*, quick: bool) -> Section:
    """Return the three motions' reconstructions and the printable twist; on 8 x 8 voxels for `quick`."""
    found = {name: _found(name, quick) for name in MOTIONS}
    noisy = _found("invert_twist", quick, seen="outer", noise=NOISE)
    printed, names = _printed(noisy)
    entries = [_iterations(found[name], *MOTIONS[name][2:]) for name in MOTIONS]
    figures = []
    for name, (residual, shape, motion, _) in MOTIONS.items():
        figures += [
            _figure(residual, f"residual of the {motion} actuator", partial(_residual, found[name])),
            _figure(shape, f"{motion}: wanted and found", partial(_shapes, found[name].case, found[name].map.moduli)),
        ]
    figures += _printable(noisy, printed, names, found["invert_twist"])
    entries.append(_error(noisy.case, printed))
    return Section(entries=entries, figures=figures)


def _figure(number: str, title: str, draw: Any) -> Figure:
    return Figure(number=number, title=title, kind="simulated", draw=draw, size=(10.0, 5.0))


def _found(name: str, quick: bool, **wanted: Any) -> Found:
    tables = Scene.load(name).tables
    shape = tables["tube"]
    if quick:
        shape = replace(shape, divisions=(8, 8, 1), voxels=(8, 8), length=shape.length / 4)
    case = tube_case(shape, tables["map"], replace(tables["wanted"], **wanted))
    return Found(case, solved(case, tables["inversion"]), tables["inversion"])


def _printed(found: Found) -> tuple[Printed, list[str]]:
    """Return what would be printed of the scene's palette, chosen by mechanics, and the materials' names."""
    palette = Scene.load("invert_twist").tables["palette"]
    choices = dict(discretised(found.case, found.map, palette))
    best = choices["best of these, swapped by mechanics"]
    if isinstance(best, CatheterError):
        raise best
    return best, found.case.names(palette)


def _iterations(found: Found, motion: str, published: str) -> Entry:
    ours, error = len(found.map.history) - 1, float(np.abs(found.map.moduli / found.case.truth - 1).max())
    return told(
        "6.4", f"iterations, {motion}", published, f"{ours}; every modulus to {error:.0e} in {found.map.seconds:.0f} s",
        verdict=AGREES if ours <= int(published) else DIFFERS, reason="" if ours <= int(published) else OTHER,
    )  # fmt: skip


def _error(case: Case, printed: Printed) -> Entry:
    most = MM * float(case.errors(printed.standings).max())
    return told(
        "6.5, page 144", "largest displacement error of the printable twist", f"< {BAR_MM} mm", f"{most:.3f} mm",
        verdict=AGREES if most < BAR_MM else DIFFERS, reason="" if most < BAR_MM else "found from noisy data",
    )  # fmt: skip


def _printable(noisy: Found, printed: Printed, names: list[str], exact: Found) -> list[Figure]:
    return [
        _figure("6.7", "a graded map, and dithered to two materials", _dithering),
        _figure("6.13", "the twisting actuator's map", partial(_map, exact.case, exact.case.truth)),
        _figure("6.16", f"residual, outer surface with {100 * NOISE:g} % noise", partial(_residual, noisy)),
        _figure("6.17", f"printable: {', '.join(names)}", partial(_shapes, noisy.case, np.exp(_log(printed)))),
        _figure("6.18", "errors of modulus, displacement and strain", partial(_errors, noisy.case, printed)),
        _figure("6.22", "twist against pressure", partial(_twists, noisy.case, printed)),
    ]


def _log(printed: Printed) -> Array:
    return printed.standings[0].log


def _residual(found: Found, figure: Any) -> None:
    history = found.map.history
    left = axes(figure, ("iteration", ""), ("misfit", "noises" if found.map.noise else "of the largest value"),
                at=(1, 2, 1), log="y")  # fmt: skip
    left.plot([one.number for one in history], [max(one.misfit, 1e-17) for one in history], "o-")
    right = axes(figure, ("iteration", ""), ("c1", "MPa"), at=(1, 2, 2), title="every voxel; dashed: bounds", log="y")
    for one in history:
        right.plot(np.full(len(one.log), one.number), MPA * np.exp(one.log), ".", color=COLOURS[0], alpha=0.05)
    for level in np.unique(found.case.truth):
        right.axhline(MPA * level, color=COLOURS[1])
    for bound in (found.options.least, found.options.most):
        right.axhline(MPA * bound, color=COLOURS[0], linestyle="--")


def _shapes(case: Case, moduli: Array, figure: Any) -> None:
    standings = case.voxels.inflate(np.log(moduli), case.whole[-1].state.load)
    for at, (what, x, map_) in enumerate(
        (("wanted", case.whole[-1].state.x, case.truth), ("found", standings.state.x, moduli)), start=1
    ):
        _draw_body(figure.add_subplot(1, 2, at, projection="3d"), case, x, map_, what)


def _draw_body(plot: Any, case: Case, x: Array, moduli: Array, title: str) -> None:
    from matplotlib import colormaps
    from matplotlib.colors import LogNorm
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    quads, part = skin(case.voxels.mesh)
    shade = colormaps["viridis"](LogNorm(0.05, 20)(MPA * np.append(moduli, moduli.max())[part]))
    plot.add_collection3d(Poly3DCollection(MM * x[quads], facecolors=shade, edgecolors="none"))
    reach = MM * np.abs(x[:, :2]).max()
    plot.set(xlim=(-reach, reach), ylim=(-reach, reach), zlim=(0, MM * x[:, 2].max()), title=f"{title}, mm")
    plot.set_box_aspect((2 * reach, 2 * reach, MM * x[:, 2].max()))


def _map(case: Case, moduli: Array, figure: Any) -> None:
    plot = axes(figure, ("voxel around", ""), ("voxel along", ""))
    image(figure, plot, MPA * moduli.reshape(case.grid), "c1 MPa")


def _dithering(figure: Any) -> None:
    tables = Scene.load("invert_graded").tables
    moduli = tables["map"].moduli(*tables["tube"].voxels)
    levels = (float(moduli.min()), float(moduli.max()))
    for at, (title, values) in enumerate(
        (("graded", moduli), ("dithered to two", np.array(levels)[dithered(moduli, levels)])), start=1
    ):
        plot = axes(figure, ("voxel around", ""), ("voxel along", ""), at=(1, 2, at), title=title)
        image(figure, plot, MPA * values, "c1 MPa")


def _errors(case: Case, printed: Printed, figure: Any) -> None:
    draw_errors(figure, error_map(case, printed.standings[-1]), (1, 3, 1))


def _twists(case: Case, printed: Printed, figure: Any) -> None:
    from fem.observation import twist

    plot = axes(figure, ("pressure", "kPa"), ("twist", "deg"))
    ring, rest = case.voxels.mesh.ring, case.voxels.mesh.nodes
    loads = np.linspace(0, case.whole[-1].state.load, 9)[1:].tolist()
    for name, log, style in (("designed", np.log(case.truth), "o"), ("reconstructed, printable", _log(printed), "x")):
        path = case.voxels.path(log, loads)
        angles = [DEG * twist(rest[ring], one.state.x[ring]) for one in path]
        plot.plot([0, *(1e-3 * load for load in loads)], [0, *angles], style, label=name, fillstyle="none")
    plot.legend()
