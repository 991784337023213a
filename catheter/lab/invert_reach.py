"""`invert` for a shape that is wanted: how near a printed tube comes to it; kept as it goes, and taken up again."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from catheter.lab.dashboard import where
from catheter.lab.invert_live import Sought, keep, kept_in, live, outputs
from catheter.lab.outcome import Outcome, table
from catheter.lab.reach_study import Known, goals_of, studied
from data.errors import BadInput
from data.recording import SIMULATED

if TYPE_CHECKING:
    from catheter.lab.scene import Scene
    from catheter.reach import Goal
    from fem.inverse import Iteration


def reached(options: argparse.Namespace, scene: "Scene") -> Outcome:
    """Say how near a scene's shape is reached. Raises BadInput for options that are for other scenes."""
    for name in ("seed", "seen", "noise", "number", "sweep"):
        if getattr(options, name) not in (None, []):
            raise BadInput(f"--{name}", "is given for a shape that is wanted", "set [reach] in the scene")
    out, view = outputs(options)
    goals = goals_of(scene)
    first, file = goals[0], MapFile(out, goals, known_in(out, goals, options.force))
    now = first.q
    sought = Sought(scene.heading.title, SIMULATED, first.grid, first.x, np.empty(0))
    with live(sought, None, view) as (tell, shown):

        def each(pressure: float, goal: "Goal", one: "Iteration") -> None:
            nonlocal now
            if shown and goal.q != now:
                shown.want(goal.x)
            now = goal.q
            tell(one)
            file.add(pressure, goal, one)

        found = studied(scene, lambda _: None, each, dict(file.known))
    best = found.best
    if out:
        file.write(moduli_pa=best.found.moduli, pressure_pa=best.pressure, ended=True)
    values = {
        "simulated": True,
        "title": found.title,
        "pressure_pa": best.pressure,
        "rms_mm": 1e3 * best.off.rms,
        "largest_mm": 1e3 * best.off.largest,
        "rows": [vars(row) for row in found.rows],
        "moduli_pa": best.found.moduli.reshape(best.goal.grid).tolist(),
        "printed_pa": None if found.chosen is None else found.chosen.reshape(best.goal.grid).tolist(),
        "view": options.view,
    }
    rows = [[r.method, r.level, r.error_text, f"{r.seconds:.3g}"] for r in found.rows]
    shown_rows = table(
        ["map", "how it ended", "rms mm", "s"], rows, f"{found.title} (simulated): distance of the centreline"
    )
    more = [f"Map: {out}"] if out else []
    more += [where(view)] if view else []
    return Outcome(values, [shown_rows, *found.notes, *more])


class MapFile:
    """The map's file: at each pressure the number of the goal that is sought, and the map so far."""

    def __init__(self, out: Path | None, goals: "list[Goal]", known: dict[float, Known]) -> None:
        self.out, self.grid, self.known = out, goals[0].grid, known
        self.qs = tuple(one.q for one in goals)
        self.now: float | None = None

    def add(self, pressure: float, goal: "Goal", one: "Iteration") -> None:
        """Keep an iteration; a pressure that follows another says that the other has ended."""
        if self.now is not None and self.now != pressure:
            self._end(self.now)
        self.now = pressure
        self.known[pressure] = Known(self.qs.index(goal.q), np.exp(one.log), ended=False)
        self.write(moduli_pa=np.exp(one.log), pressure_pa=pressure, ended=False)

    def write(self, *, ended: bool, **values: Any) -> None:
        """Write all that is known, in one step."""
        if self.out is None:
            return
        if ended and self.now is not None:
            self._end(self.now)
        keep(
            self.out,
            grid=np.array(self.grid),
            qs=np.array(self.qs),
            at_pa=np.array(list(self.known)),
            at_goal=np.array([one.goal for one in self.known.values()]),
            at_ended=np.array([one.ended for one in self.known.values()]),
            at_moduli_pa=np.array([one.moduli for one in self.known.values()]),
            origin=SIMULATED,
            **values,
        )

    def _end(self, pressure: float) -> None:
        one = self.known[pressure]
        self.known[pressure] = Known(one.goal, one.moduli, ended=True)


def known_in(out: Path | None, goals: "list[Goal]", force: bool) -> dict[float, Known]:
    """Return what an interrupted run's file knows by pressure. Raises BadInput for one of another scene."""
    kept = kept_in(out, force)
    if kept is None:
        return {}
    grid, qs = goals[0].grid, tuple(one.q for one in goals)
    if tuple(kept.get("grid", ())) != grid or tuple(kept.get("qs", ())) != qs or "at_moduli_pa" not in kept:
        raise BadInput(str(out), "is of another scene", f"expected {grid} voxels and q {qs}; name another, or --force")
    columns = kept["at_pa"], kept["at_goal"], kept["at_moduli_pa"], kept["at_ended"]
    return {
        float(pressure): Known(int(goal), moduli, bool(ended))
        for pressure, goal, moduli, ended in zip(*columns, strict=True)
    }
