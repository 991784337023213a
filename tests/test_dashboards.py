"""Every experiment's dashboard says "simulated" in each title, and none of its views is blank."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import DRIVERS, NO_DRIVER, ROOT, view_names

from catheter.inflatable import Pattern, Shape
from catheter.lab import cli
from catheter.lab.invert_live import Sought, live
from catheter.lab.invert_outcome import sure_of
from catheter.lab.robot_run import walked
from catheter.lab.scene import Scene
from catheter.lab.views.picture import take, views_of
from catheter.lab.views.robot import moment_of_interest, save_robot
from catheter.lab.views.viewer import viewer
from catheter.reconstruction import Wanted, solved, tube_case
from data.recording import SIMULATED
from fem.inverse import Inversion

BENDER = str(ROOT / "data" / "recordings" / "bender.mcap")
PICTURED = ("robot", "valve", "inverse")  # test_views has a replay's; the others are left out for time


@pytest.fixture(scope="module")
def dashboards(tmp_path_factory) -> dict[str, tuple[Path, float | None]]:
    """One small dashboard of each kind: its file, and when to look [s]."""
    folder = tmp_path_factory.mktemp("dashboards")
    found: dict[str, tuple[Path, float | None]] = {"robot": _robot(folder / "robot.rrd")}
    short = folder / "short.toml"
    short.write_text((ROOT / "data" / "scenes" / "cracking.toml").read_text("utf-8").replace("60 s", "4 s"), "utf-8")
    for model, scene in (("valve", "valve"), ("cracking", str(short))):
        run, rrd = str(folder / f"{model}.mcap"), folder / f"{model}.rrd"
        assert cli.run(["record", scene, "--out", run]) == 0
        assert cli.run(["fit", run, "--model", model, "--view", str(rrd)]) == 0
        found[model] = rrd, None
    assert cli.run(["fit", BENDER, "--model", "bender", "--resamples", "5", "--view", str(folder / "fit.rrd")]) == 0
    return found | {"bender": (folder / "fit.rrd", None), "inverse": (_inverse(folder / "inverse.rrd"), None)}


def _inverse(path: Path) -> Path:
    shape, wrap = Shape(length=16e-3, divisions=(8, 8, 1), voxels=(8, 4)), Pattern(pattern="helix", period=4, width=1)
    case = tube_case(shape, wrap, Wanted(pressures=(40e3,)))
    sought = Sought("small", SIMULATED, case.grid, case.whole[-1].state.x, case.truth)
    with live(sought, None, path) as (tell, shown):
        found = solved(case, Inversion(), None, tell)
        sure_of(case.problem, found, case.variation, Inversion(), shown)
    return path


def _robot(path: Path) -> tuple[Path, float]:
    """Write the robot's dashboard with a coarse end-effector that works from the start."""
    scene = Scene.load("robot")
    coarse, tables = Shape(divisions=(8, 8, 1), voxels=(8, 8)), dict(scene.tables)
    tables |= {"bender": coarse, "twister": coarse, "walk": replace(tables["walk"], cycles=1, frames=24)}
    tables |= {name: replace(tables[name], start=0.0, most=30e3) for name in ("bender_line", "twister_line")}
    tables |= {"bender_map": Pattern(pattern="bender", period=4, width=1)}
    tables |= {"twister_map": Pattern(pattern="helix", period=4, width=1)}
    robot = walked(replace(scene, tables=tables), tables["circuit"], lambda share: None)
    save_robot(robot, path)
    return path, moment_of_interest(robot)


@pytest.mark.parametrize("name", ["robot", "valve", "cracking", "bender", "inverse"])
def test_every_title_says_simulated(dashboards, name: str) -> None:
    names = view_names(dashboards[name][0])
    assert len(names) >= 4
    assert all("simulated" in one for one in names)


@pytest.mark.viewer
@pytest.mark.skipif(not DRIVERS, reason=NO_DRIVER)
def test_no_view_is_blank(dashboards) -> None:
    with viewer((640, 420)) as running:
        for name in PICTURED:
            rrd, at_s = dashboards[name]
            take(running, rrd, at_s=at_s)
            views = views_of(running)
            assert len(views) >= 4, name
            for title, pixels in views.items():
                _, counts = np.unique(pixels.reshape(-1, 3), axis=0, return_counts=True)
                # an empty view holds its background alone, perhaps a grid of one grey
                assert len(counts) > 40, f"{name}, {title}"
                assert counts.max() < 0.99 * counts.sum(), f"{name}, {title}"


def test_dashboard_and_picture_are_two_files_and_overwrite_nothing(tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.setattr("catheter.lab.robot_run.walked", None)  # what is refused is refused before the work
    taken = tmp_path / "a.png"
    taken.write_bytes(b"precious")
    for arguments, said in (
        (["run", "locomotion", "--view", str(tmp_path / "a"), "--picture", str(tmp_path / "a")], "name two files"),
        (["run", "locomotion", "--picture", str(taken)], "not overwritten"),
        (["fit", BENDER, "--model", "hysteresis", "--view", str(tmp_path / "h.rrd")], "has no dashboard"),
    ):
        assert cli.run(arguments) == 2
        assert said in capsys.readouterr().err
    assert taken.read_bytes() == b"precious"
    assert list(tmp_path.iterdir()) == [taken]
