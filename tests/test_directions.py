"""Which way is positive, and that the pictures' skin is the whole surface."""

import numpy as np
import pytest

from catheter.lab import cli
from catheter.lab.direction_study import tube
from catheter.lab.views.labels import view_name
from fem.grid import skin


def test_directions_report_finds_mirrored_and_turned_tubes_answer_so(tmp_path, capsys) -> None:
    import json

    assert cli.run(["report", "directions", "--json", "--out", str(tmp_path)]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert len(rows) == 3
    assert max(row["error"] for row in rows) < 1e-9  # symmetries, not approximations
    assert (tmp_path / "directions.png").stat().st_size > 50_000


@pytest.mark.parametrize("cap", [0.0, 1e-3])
def test_the_skin_is_closed_and_holds_the_wall(cap: float) -> None:
    from dataclasses import replace

    made = replace(tube(np.zeros((16, 16), dtype=bool)), cap=cap, divisions=(16, 16, 2))
    mesh = made.mesh()
    quads, part = skin(mesh)
    corners = mesh.nodes[quads]
    area = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]) / 2
    assert np.abs(area.sum(axis=0)).max() < 1e-12 * np.abs(area).sum()
    # plane faces: the volume by the divergence theorem is that of the elements
    volume = float((corners.mean(axis=1) * area).sum() / 3)
    assert volume == pytest.approx(float(made.body().weight.sum()), rel=1e-9)
    assert set(np.unique(part)) == set(np.unique(mesh.part))


def test_a_model_s_topic_beside_a_measurement_says_simulated_itself() -> None:
    assert view_name("simulated/twist", "rad", "measured") == "simulated/twist [rad]"
    assert view_name("twist", "rad", "measured") == "measured twist [rad]"
