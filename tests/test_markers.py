"""Markers on a tube: where they stand and move, what a recording of them tells, and the map that explains it."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import ROOT, SIMULATED

from catheter.inflatable import Pattern, Shape
from catheter.lab import cli
from catheter.marked import marked
from catheter.marker_bench import Markers, Stairs
from catheter.reconstruction import Wanted, tube_case, tube_voxels
from data.errors import BadInput
from data.recorder import Recorder
from data.signal import Array, Signal
from data.topics import markers, standard
from fem import tube_grid
from fem.attached import attached
from fem.discrepancy import NEAR, discrepant
from fem.inverse import Inversion

SMALL = Shape(length=16e-3, divisions=(8, 8, 1), voxels=(8, 8))
GLUED = Markers(around=6, along=6)
STAIRS = Stairs(levels=(20e3, 40e3, 0.0), rise=0.5, hold=1.0)
Change = Callable[[Array, Array], Array]


@pytest.mark.parametrize(("order", "divisions"), [(1, (16, 16, 2)), (2, (8, 8, 1))])
def test_what_is_attached_follows_every_affine_motion_and_says_how_far_off_it_is(
    order: int, divisions: tuple[int, int, int]
) -> None:
    mesh = tube_grid.tube(32e-3, 5e-3, 1e-3, divisions, voxels=(8, 8), order=order)
    rng = np.random.default_rng(0)
    angle, z = rng.uniform(0, 2 * np.pi, 60), rng.uniform(0, 32e-3, 60)
    places = np.stack([5e-3 * np.cos(angle), 5e-3 * np.sin(angle), z], axis=1)
    on = attached(mesh, places)
    flat = 5e-3 * (1 - np.cos(np.pi / divisions[0]))  # how far the mesh's flat faces are inside of the round
    assert on.off.max() <= flat * 1.001
    turn, shift = np.eye(3) + 0.3 * rng.standard_normal((3, 3)), rng.standard_normal(3)
    assert on.at(mesh.nodes @ turn.T + shift) == pytest.approx(places @ turn.T + shift, abs=1e-12)
    places[:, :2] *= 1.1
    assert attached(mesh, places).off == pytest.approx(0.5e-3, abs=1.1 * flat)
    places[:, :2] *= 0.95 / 1.1
    assert attached(mesh, places).off == pytest.approx(0.25e-3, abs=1.1 * flat)  # within the wall
    beyond = np.array([[5e-3, 0, 32.4e-3]])
    assert attached(mesh, beyond).off == pytest.approx([0.4e-3], rel=1e-3)


def test_the_noises_own_weight_leaves_a_misfit_of_the_noise() -> None:
    case = tube_case(SMALL, Pattern(pattern="helix", period=4, width=1), Wanted(pressures=(40e3,), noise=0.01))
    seed = np.full(64, 1e6)
    fitted = discrepant(case.voxels, case.observations, seed, case.variation)
    assert fitted.level == 1
    assert abs(fitted.found.misfit - 1) <= NEAR
    assert fitted.found.weight > 1 / Inversion().prior  # more alike than the default holds them
    assert [one.number for one in fitted.found.history] == list(range(len(fitted.found.history)))
    surer = [replace(one, sd=one.sd / 8) for one in case.observations]  # as if another model had made the data
    beyond = discrepant(case.voxels, surer, seed, case.variation, Inversion(robust=0))
    assert beyond.level > 5
    assert beyond.found.noise == beyond.level


def test_a_recordings_markers_give_the_map(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (ROOT / "data" / "scenes" / "marked.toml").read_text(encoding="utf-8")
    text = re.sub(r"\[32, 32(, 1)?\]", lambda found: f"[8, 8{found[1] or ''}]", text)
    text = text.replace('"32 mm"', '"16 mm"').replace("period = 16", "period = 4").replace("width = 4", "width = 1")
    text = text.replace('"20 kPa", "40 kPa", "60 kPa"', '"20 kPa", "40 kPa"').replace("= 12", "= 9")
    scene, recording = tmp_path / "marked.toml", tmp_path / "markers.mcap"
    scene.write_text(text, encoding="utf-8")
    assert cli.run(["record", str(scene), "--out", str(recording)]) == 0
    out, view = tmp_path / "map.npz", tmp_path / "map.rrd"
    capsys.readouterr()
    assert cli.run(["invert", str(recording), "--json", "--out", str(out), "--view", str(view)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["simulated"] is True
    assert found["noise_m"] == pytest.approx(30e-6, rel=0.05)  # of some 10,000 values at rest
    assert found["pressures_pa"] == pytest.approx([20e3, 40e3], rel=2e-3)
    assert found["error"]["right"] >= 0.98
    assert found["error"]["median"] < 0.03
    assert found["misfit"] < 1.1
    with np.load(out) as kept:
        assert kept["moduli_pa"].reshape(8, 8) == pytest.approx(np.array(found["moduli_pa"]))
    assert view.stat().st_size > 10_000
    assert cli.run(["invert", str(recording), "--noise", "0.1"]) == 2
    assert "--noise" in capsys.readouterr().err


def written(path: Path, change: Change = lambda time_s, places: places, names: tuple[str, ...] | None = None) -> Path:
    """Write a recording of markers that move outwards with the pressure, 1 mm at the most, then changed."""
    time_s = np.arange(0, STAIRS.duration, 0.05)
    load, rest = STAIRS.at(time_s), GLUED.places(SMALL)
    out = rest * [1, 1, 0] / 5e-3
    noise = 1e-5 * np.random.default_rng(1).standard_normal((len(time_s), *rest.shape))
    places = change(time_s, rest + 1e-3 * (load / load.max())[:, None, None] * out + noise)
    components = names or GLUED.components()
    seen = Signal(time_s, places.reshape(len(time_s), -1)[:, : len(components)], "m", "base", components)
    with Recorder(path, SIMULATED, flush_s=None) as recorder:
        recorder.add(standard("/pressure"))
        recorder.add(markers(components))
        recorder.write_signals({"/pressure": Signal(time_s, load, "Pa"), "/markers": seen})
    return path


def told(path: Path) -> str:
    """Return what is wrong with a recording of markers."""
    with pytest.raises(BadInput) as caught:
        marked(path).observations(tube_voxels(SMALL), SMALL)
    return str(caught.value)


def _hidden(first_s: float, end_s: float, which: slice) -> Change:
    def change(time_s: Array, places: Array) -> Array:
        places[(time_s >= first_s) & (time_s < end_s), which, 1] = np.nan
        return places

    return change


def test_displacements_are_means_over_a_pressures_stretch(tmp_path: Path) -> None:
    seen = marked(written(tmp_path / "sound.mcap"))
    assert [one.pressure for one in seen.stands] == pytest.approx([20e3, 40e3], rel=1e-3)
    assert seen.noise == pytest.approx(1e-5, rel=0.05)
    one = seen.observations(tube_voxels(SMALL), SMALL)[0]
    samples = [seen.stands[0].samples[0], seen.rest.samples[0]]
    assert one.sd == pytest.approx(seen.noise * np.sqrt((1 / np.array(samples)).sum()), rel=0.02)
    outwards = np.hypot(*one.target.reshape(-1, 3)[:, :2].T)
    assert outwards == pytest.approx(0.5e-3, abs=6 * one.sd)


def test_hidden_markers_are_left_out_and_named(tmp_path: Path) -> None:
    seen = marked(written(tmp_path / "some.mcap", _hidden(0, 1.2, slice(2, 3))))
    assert seen.left_out == ("not seen at rest: m3",)
    assert len(seen.names) == 35
    seen = marked(written(tmp_path / "later.mcap", _hidden(1.3, 3, slice(4, 6))))
    assert len(seen.left_out) == 1
    assert "m5, m6" in seen.left_out[0]
    voxels = tube_voxels(SMALL)
    found = seen.observations(voxels, SMALL)
    for one, hidden in zip(found, ([4, 5], []), strict=True):
        there = np.delete(seen.rest.place, hidden, axis=0)
        assert one.rows @ voxels.mesh.nodes.ravel() == pytest.approx(there.ravel(), abs=1e-12)
        assert len(one.target) == there.size


def _frame(shift: Array, after_s: float = -1.0) -> Change:
    return lambda time_s, places: places + shift * (time_s > after_s)[:, None, None]


def test_markers_that_cannot_be_are_refused_with_numbers(tmp_path: Path) -> None:
    few = GLUED.components()[:15]
    assert "5 of 5 markers" in told(written(tmp_path / "few.mcap", names=few))
    assert "0 of 36 markers" in told(written(tmp_path / "blind.mcap", _hidden(0, 1.2, slice(None))))
    assert "no component m5_z" in told(written(tmp_path / "half.mcap", names=few[:-1]))
    error = told(written(tmp_path / "off.mcap", _frame(np.array([0.8e-3, 0, 0]))))
    off = re.search(r"m\d+: stands (\d\.\d+) mm off.*moved frame", error)
    assert off
    assert 0.7 < float(off[1]) < 1.2  # the shift, and the mesh's flat faces inside of the round
    error = told(written(tmp_path / "bumped.mcap", _frame(np.array([0, 0, 0.5e-3]), 3.0)))
    assert re.search(r"m\d+: rests 0\.5\d\d mm away.*moved", error)
    error = told(written(tmp_path / "dark.mcap", _hidden(1.2, 4.0, slice(None))))
    assert "no pressure but rest" in error
