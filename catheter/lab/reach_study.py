"""The study of a shape nobody has reached: how near the best map comes, and the best that could be printed."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from catheter.lab.report import Progress, Report, Row
from catheter.lab.scene import Scene
from catheter.motions import build
from catheter.reach import Goal, Made, Off, Reached, approach, goal, pressed, printable, within
from catheter.reconstruction import Palette
from data.errors import BadInput, CatheterError
from data.signal import Array
from fem.inverse import Iteration
from fem.palette import binned

MM, MPA = 1e3, 1e-6
SCENE = "invert_spiral"


@dataclass(frozen=True, eq=False)
class Study:
    """What was found for a scene's wish: rows, how it ended, and the shapes and maps to draw.

    chosen (v,) and x (n, 3): the moduli [Pa] of the best printed map and where it puts the nodes, None: there is none.
    """

    title: str
    rows: list[Row]
    notes: list[str]
    best: Reached
    chosen: Array | None
    x: Array | None


def inverse_spiral(*, quick: bool, progress: Progress) -> Report:
    """Seek the map whose inflated centreline is nearest to the spiral in a renal-like branch, then print it."""
    found = studied(_smaller(Scene.load(SCENE)) if quick else Scene.load(SCENE), progress)
    return Report(
        name="inverse-spiral",
        title=f"{found.title} (simulated): distance of the centreline",
        level="how it ended",
        error="rms distance [mm]",
        rows=found.rows,
        notes=found.notes,
        draw=lambda figure: draw(figure, found),
    )


def _smaller(scene: Scene) -> Scene:
    """Return a scene that takes seconds: few voxels, one turn, half the way."""
    tables = dict(scene.tables)
    tables["actuator"] = replace(tables["actuator"], divisions=(16, 16, 1), voxels=(8, 8))
    tables["spiral"] = replace(tables["spiral"], turns=1.0)
    tables["reach"] = replace(tables["reach"], pressures=(60e3,), qs=(0.2, 0.4))
    tables["inversion"] = replace(tables["inversion"], most_iterations=4)
    tables["palette"] = replace(tables["palette"], rounds=2)
    return replace(scene, tables=tables)


@dataclass(frozen=True, eq=False)
class Known:
    """What an interrupted study knew at a pressure: which goal it was at, its map (v,) [Pa], whether it ended."""

    goal: int
    moduli: Array
    ended: bool


def goals_of(scene: Scene) -> list[Goal]:
    """Return a scene's wish and the nearer ones on the way to it. Raises BadInput for a scene without one."""
    from catheter.lab.shape_view import placed

    if scene.heading.kind != "inverse-shape":
        raise BadInput("scene", f"is a {scene.heading.kind} scene", "an inverse-shape scene has a [reach]")
    vessel, motions = placed(scene)
    shape, reach = build(vessel, scene.tables["actuator"], motions), scene.tables["reach"]
    return [goal(shape, scene.tables["actuator"], q, reach.nu) for q in reach.qs]


def studied(
    scene: Scene,
    progress: Progress,
    each: Callable[[float, Goal, Iteration], None] | None = None,
    known: Mapping[float, Known] | None = None,
) -> Study:
    """Return what is found for a scene's wish. Raises BadInput for a scene without one.

    each takes the pressure [Pa], the goal and every iteration towards it; known: by pressure, what an interrupted
    study knew. What had ended is looked at once more, the rest goes on.
    """
    tables, goals = scene.tables, goals_of(scene)
    reach = tables["reach"]
    last, total = goals[-1], len(goals) * len(reach.pressures) + 2
    started = time.perf_counter()
    rows = [_row("not inflated", last.off(last.voxels.mesh.nodes), f"q = {last.q:g}", 0.0)]
    ends, done = list[Reached](), 0
    for pressure in reach.pressures:

        def tell(near: Reached) -> None:
            nonlocal done
            done += 1
            progress(done / total)
            rows.append(_row(f"map, {near.pressure / 1e3:g} kPa", near.off, _ended(near), near.found.seconds))

        begun = (known or {}).get(pressure)
        inversion = replace(tables["inversion"], most_iterations=1) if begun and begun.ended else tables["inversion"]
        left, seed = (goals[begun.goal :], begun.moduli) if begun else (goals, None)
        try:
            ends.append(approach(left, pressure, inversion, tell, partial(each, pressure) if each else None, seed)[-1])
        except CatheterError as error:
            rows.append(
                Row(
                    method=f"map, {pressure / 1e3:g} kPa", level="refused", error=np.nan, seconds=0.0, failed=str(error)
                )
            )
    if not ends:
        raise BadInput("reach, pressures", "no map in bounds bears any of them", "expected lower ones")
    best = min(ends, key=lambda one: one.off.rms)
    notes = [*_notes(best), f"Sought for {time.perf_counter() - started:.0f} s."]
    palette = tables["palette"]
    chosen, x = None, None
    if palette.materials:
        more, chosen, x = _printed(best, palette, tables["inversion"])
        rows += more
        nearest = binned(best.found.moduli, palette.moduli(), log=True)
        over = palette.overstretched(last.voxels, nearest, best.found.standings)
        notes.append(f"Of the nearest map {over} voxels are stretched past the elongation of the nearest material.")
    progress(1.0)
    return Study(scene.heading.title, rows, notes, best, chosen, x)


def _printed(best: Reached, palette: Palette, inversion: Any) -> tuple[list[Row], Array | None, Array | None]:
    """Return rows of every printed map and of each material alone; the moduli and nodes of the best printed one."""
    again = within(best, palette, inversion)
    one, where = best.goal, f"{again.pressure / 1e3:.4g} kPa"
    rows = [_row(f"map in the palette's bounds, {where}", again.off, _ended(again), again.found.seconds)]
    good = list[Made]()
    for name, made in printable(again, palette).items():
        rows.append(_made_row(f"printed, {name}", one, palette, made))
        good += [made] if isinstance(made, Made) else []
    for k, name in enumerate(palette.names()):
        alone: Made | CatheterError
        try:
            alone = pressed(one, palette, np.full(one.voxels.count, k), 1.5 * again.pressure)
        except CatheterError as error:
            alone = error
        rows.append(_made_row(f"{name} alone", one, palette, alone))
    if not good:
        return rows, None, None
    nearest = min(good, key=lambda made: made.off.rms)
    return rows, palette.moduli_of(nearest.chosen), nearest.standing.state.x


def _made_row(method: str, one: Goal, palette: Palette, made: Made | CatheterError) -> Row:
    if isinstance(made, CatheterError):
        return Row(method=method, level="refused", error=np.nan, seconds=0.0, failed=str(made)[:200])
    over = palette.overstretched(one.voxels, made.chosen, [made.standing])
    edge = ", the most it bears" if made.highest else ""
    count = len(np.unique(made.chosen))
    level = f"{made.pressure / 1e3:.4g} kPa{edge}; {count} materials; {over} voxels overstretched"
    return _row(method, made.off, level, made.seconds)


def _row(method: str, off: Off, level: str, seconds: float) -> Row:
    far = f"largest {MM * off.largest:.3f} mm, wall rms {MM * off.surface:.3f} mm"
    return Row(method=method, level=f"{level}; {far}", error=MM * off.rms, seconds=seconds)


def _ended(near: Reached) -> str:
    bounded = near.found.bounded
    return f"q = {near.goal.q:g}; {near.found.why}; at bounds {(bounded < 0).sum()} least, {(bounded > 0).sum()} most"


def _notes(best: Reached) -> list[str]:
    one, off = best.goal, best.off
    moved = np.linalg.norm(one.line(one.x) - one.line(one.voxels.mesh.nodes), axis=1).max()
    stretch = one.voxels.stretch(best.found.standings[0].state.x)
    bounded = best.found.bounded
    return [
        f"Nearest: {best.pressure / 1e3:g} kPa, rms {MM * off.rms:.3f} mm, largest {MM * off.largest:.3f} mm, where"
        f" the wish moves the centreline by up to {MM * moved:.3f} mm.",
        f"There {(bounded < 0).sum()} of {len(bounded)} voxels at the least modulus, {(bounded > 0).sum()} at the"
        f" most; largest stretch {stretch.max():.2f}, median {np.median(stretch):.2f}.",
        "Wanted is the centreline, ring by ring (not only the curve); q: the share of the way from the vessel's"
        " centreline to the spiral. The wall's distance counts twist and bore, which were not wanted.",
        "Moduli over pressure decide the shape: printed maps are sought again in the palette's bounds, scaled.",
    ]


def draw(figure: Any, found: Study) -> None:
    """Draw the centrelines on the wanted wall, their distance from it, and the maps unwrapped."""
    figure.set_size_inches(13, 8)
    one, best = found.best.goal, found.best
    x = best.found.standings[0].state.x
    lines = {"wanted": one.x, "not inflated": one.voxels.mesh.nodes, "best map": x}
    if found.x is not None:
        lines["best printed"] = found.x
    styles = dict(zip(lines, (("black", "-"), ("grey", ":"), ("#0072B2", "-"), ("#D55E00", "--")), strict=False))
    grid = figure.add_gridspec(2, 3)
    space, plane = figure.add_subplot(grid[:, 0], projection="3d"), figure.add_subplot(grid[0, 1:])
    for name, nodes in lines.items():
        colour, style = styles[name]
        line = one.line(nodes)
        space.plot(*(MM * line).T, color=colour, linestyle=style, label=name)
        if name != "wanted":
            off = np.linalg.norm(line - one.line(one.x), axis=1)
            plane.plot(np.arange(1, len(off) + 1), MM * off, color=colour, linestyle=style, label=name)
    for nodes, colour in ((one.x, "black"), (x, "#0072B2")):
        wall = np.stack([nodes[ring] for ring in one.rings])
        outer = MM * wall[:, 1::2]  # of bore and outer wall in turn
        space.plot_wireframe(*np.moveaxis(outer, -1, 0), color=colour, linewidth=0.2, alpha=0.4)
    space.set_aspect("equal")
    space.set_title("centrelines and walls, mm, frame of the base; black: wanted", fontsize=8)
    plane.set(xlabel="ring from the base", ylabel="distance of the centreline [mm]")
    plane.legend(fontsize=7)
    _map(figure, grid[1, 1], one, best.found.moduli, f"best map, {best.pressure / 1e3:g} kPa")
    if found.chosen is not None:
        _map(figure, grid[1, 2], one, found.chosen, "best printed map")


def _map(figure: Any, at: Any, one: Goal, moduli: Array, title: str) -> None:
    made = figure.add_subplot(at)
    shown = made.imshow(np.log10(MPA * moduli.reshape(one.grid)).T, origin="lower", cmap="viridis", aspect="auto")
    made.set(xlabel="voxel around", ylabel="voxel along", title=title)
    figure.colorbar(shown, ax=made, label="log10 of c1 in MPa")
