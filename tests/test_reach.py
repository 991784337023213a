"""A shape as a wish for a printed tube: its mesh, its distance, and that small wishes are reached."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from catheter.centreline import Source, load
from catheter.lab import cli
from catheter.lab.invert_reach import MapFile, known_in
from catheter.motions import Actuator, Motions, Spiral, build
from catheter.reach import Goal, Made, Reach, approach, goal, pressed, printable, within
from catheter.reconstruction import Palette
from data.errors import BadInput
from fem import tube_grid
from fem.inverse import Inversion, Iteration

MM = 1e-3
ACTUATOR = Actuator(inner_radius=0.8 * MM, outer_radius=MM, divisions=(8, 8, 1), voxels=(8, 8))
SEVEN = Palette(materials=("Agilus30", "FLX9740", "FLX9750", "FLX9760", "FLX9770", "FLX9785", "FLX9795"), rounds=2)


@cache
def wish(q: float, initial: str = "vessel") -> Goal:
    vessel = load(Source(file="renal", length=20 * MM))
    spiral = Motions(spiral=Spiral(turns=1.0))
    return goal(build(vessel, replace(ACTUATOR, initial=initial), spiral), replace(ACTUATOR, initial=initial), q)


def test_a_straight_rest_is_the_tubes_own_mesh_and_a_curved_one_is_closed() -> None:
    mesh = wish(1.0, "straight").voxels.mesh
    plain = tube_grid.tube(20 * MM, MM, 0.2 * MM, (8, 8, 1), voxels=(8, 8))
    assert mesh.nodes == pytest.approx(plain.nodes, abs=1e-9)
    for name in ("hexes", "part", "pressed", "fixed", "ring", "tied"):
        assert np.array_equal(getattr(mesh, name), getattr(plain, name)), name
    line = wish(1.0, "straight").line(plain.nodes)
    assert line == pytest.approx(np.outer(np.arange(1, 9), [0, 0, 2.5 * MM]), abs=1e-9)
    curved = wish(1.0).voxels.mesh
    assert len(curved.tied) == len(curved.ring) + 1  # and the hub
    assert np.array_equal(curved.hexes, plain.hexes)
    assert np.linalg.norm(curved.nodes - plain.nodes, axis=1).max() > MM


def test_the_distance_of_a_wish_is_from_its_own_centreline() -> None:
    one = wish(0.5)
    assert one.off(one.x).largest == 0
    off = one.off(one.x + np.array([0.3 * MM, 0, 0.4 * MM]))
    assert (off.rms, off.largest, off.surface) == pytest.approx((0.5 * MM,) * 3, rel=1e-12)


def test_a_small_wish_is_approached_and_printed_nearer_than_by_any_material_alone() -> None:
    inversion = Inversion(most_iterations=3)
    near = approach([wish(0.1), wish(0.2)], 60e3, inversion)[-1]
    still = near.goal.off(near.goal.voxels.mesh.nodes)
    assert near.off.rms < 0.5 * still.rms
    again = within(near, SEVEN, inversion)
    assert SEVEN.moduli()[0] * (1 - 1e-9) <= again.found.moduli.min()
    ways = {name: made for name, made in printable(again, SEVEN).items() if isinstance(made, Made)}
    best = min(ways.values(), key=lambda made: made.off.rms)
    assert best is ways.pop("best of these, swapped by mechanics")
    assert best.off.rms < 0.8 * min(made.off.rms for made in ways.values())
    alone = [pressed(near.goal, SEVEN, np.full(64, k), 1.5 * again.pressure).off.rms for k in (0, 6)]
    assert best.off.rms < min(alone)


def test_overstretched_voxels_are_those_past_their_materials_elongation() -> None:
    one = wish(1.0)
    chosen = np.full(one.voxels.count, 6)
    chosen[5] = 0
    limits = SEVEN.elongations(chosen)
    assert limits[5] > limits[0]
    made = pressed(one, SEVEN, chosen, 1e3)
    stretched = one.voxels.mesh.nodes * (1 + (limits[0] + limits[5]) / 2)
    state = replace(made.standing, state=replace(made.standing.state, x=stretched))
    assert SEVEN.overstretched(one.voxels, chosen, [made.standing]) == 0
    assert SEVEN.overstretched(one.voxels, chosen, [state]) == one.voxels.count - 1


def test_what_makes_no_approach_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(BadInput, match="ascending"):
        Reach(qs=(0.5, 0.2))
    assert cli.run(["invert", "invert_spiral", "--noise", "0.1"]) == 2
    assert "--noise" in capsys.readouterr().err


def test_an_interrupted_approach_goes_on_where_it_was(tmp_path: Path) -> None:
    goals, inversion = [wish(0.1), wish(0.2)], Inversion(most_iterations=2)
    out, told = tmp_path / "map.npz", list[tuple[float, float]]()
    file = MapFile(out, goals, {})

    def each(one: Goal, iteration: Iteration) -> None:
        file.add(60e3, one, iteration)
        told.append((one.q, iteration.misfit))
        if len(told) == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        approach(goals, 60e3, inversion, each=each)
    known = known_in(out, goals, force=False)[60e3]
    assert (known.goal, known.ended) == (1, False)
    assert [q for q, _ in told] == [0.1, 0.1, 0.1, 0.2]
    again = approach(goals[known.goal :], 60e3, inversion, seed=known.moduli)
    assert again[0].goal.q == 0.2
    assert again[0].found.history[0].misfit == pytest.approx(told[-1][1], rel=1e-6)  # the map it was at
    with pytest.raises(BadInput, match="another scene"):
        known_in(out, goals[:1], force=False)
