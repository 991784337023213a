"""`inflate` on the command line, and the scene it shows."""

import json

import numpy as np
import pytest

from catheter.inflatable import Path, Pattern, Shape, inflated
from catheter.lab import cli
from catheter.lab.scene import Scene
from data.errors import BadInput


def test_the_shipped_scene_gives_the_spec_s_numbers(capsys) -> None:
    assert cli.run(["inflate", "twist", "--json", "--pressure", "5 kPa", "--pressure", "10 kPa"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["simulated"] is True
    assert [row["twist_deg"] for row in found["loads"]] == pytest.approx([-1.00741, -2.11716], abs=0.6e-5)
    assert all(row["stable"] for row in found["loads"])


def test_text_and_volumes(tmp_path, capsys) -> None:
    scene = tmp_path / "small.toml"
    scene.write_text(
        '[scene]\nkind = "tube"\ntitle = "t"\n[tube]\ndivisions = [8, 8, 1]\nvoxels = [8, 8]\n'
        '[map]\npattern = "bender"\nperiod = 4\nwidth = 1\n[path]\nvolume_ratios = [1.1, 1.2]\n'
    )
    assert cli.run(["inflate", str(scene)]) == 0
    out = capsys.readouterr().out
    assert "1.1000" in out
    assert "simulated" in out
    assert "block-tridiagonal" in out
    assert cli.run(["inflate", str(scene), "--pressure", "900 kPa"]) == 2
    assert "control='volume'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["inflate", "bender"], "a tube scene has a [tube]"),
        (["inflate", "twist", "--pressure", "20"], "expected something in Pa"),
    ],
)
def test_refusals(arguments, said, capsys) -> None:
    assert cli.run(arguments) == 2
    assert said in capsys.readouterr().err


def test_a_path_has_one_kind_of_load() -> None:
    with pytest.raises(BadInput, match="give one of them"):
        inflated(Shape(), Pattern(), Path())


def test_patterns_and_a_material_without_c1() -> None:
    scene = Scene.load("twist")
    stiff = scene.tables["map"].stiff_voxels(32, 32)
    i, j = np.indices((32, 32))
    assert (stiff == ((i - j) % 16 < 4)).all()
    with pytest.raises(BadInput, match="no fit is given"):
        inflated(scene.tables["tube"], Pattern(stiff="Dragon Skin 10", pattern="strip"), scene.tables["path"])


def test_a_peer_that_fails_is_a_row_that_says_so(monkeypatch) -> None:
    from catheter.lab import fem_peers
    from catheter.lab.fem_study import twist_tube
    from data.errors import CatheterError

    def refuse(*_: object) -> None:
        raise CatheterError("felupe cannot be installed")

    monkeypatch.setattr(fem_peers, "run_peer", refuse)
    rows, _ = fem_peers.peer_rows(twist_tube((32, 32, 1)), peers=True)
    assert [row.failed for row in rows] == ["", *["felupe cannot be installed"] * 3]
    rows, notes = fem_peers.peer_rows(twist_tube((32, 32, 1)), peers=False)
    assert [row.method for row in rows] == ["TWIST to 20 kPa, this project"]
    assert rows[0].error < 1e-9
    assert "left out" in notes[-1]
