"""Dashboards of a design are files that rerun accepts; the tube they show has the right geometry."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from catheter.free import inflate
from catheter.helix import bend
from catheter.lab import cli
from catheter.lab.views.designs import surface

DEG = np.pi / 180


def test_the_drawn_limiter_has_its_own_length_and_the_tube_its_radius() -> None:
    pair = inflate(72 * DEG, -72 * DEG, 1.3)
    helix = bend(pair, -14 * DEG, radius=5e-3, length=0.3, torsion="exact")
    k, tau, radius = float(helix.curvature), float(helix.torsion), float(pair.radial) * 5e-3
    arc = float(pair.axial) * np.linspace(0, 0.3, 20_001)
    limiter, centre = surface(k, tau, arc, 0 * arc, radius), surface(k, tau, arc, 0 * arc, 0.0)
    length = np.linalg.norm(np.diff(limiter, axis=0), axis=1).sum()
    assert length * np.cos(14 * DEG) == pytest.approx(0.3, rel=1e-6)  # chords for arcs: their number squared
    assert np.linalg.norm(np.diff(centre, axis=0), axis=1).sum() == pytest.approx(arc[-1], rel=1e-6)
    around = np.linspace(0, 2 * np.pi, 7)
    ring = surface(k, tau, np.full(7, 0.1), around, radius) - surface(k, tau, np.array([0.1]), np.zeros(1), 0.0)
    assert np.linalg.norm(ring, axis=1) == pytest.approx(radius, rel=1e-12)
    step = surface(k, tau, np.array([0.1 + 1e-7]), np.zeros(1), 0.0) - surface(
        k, tau, np.array([0.1]), np.zeros(1), 0.0
    )
    assert ring @ step[0] == pytest.approx(0, abs=1e-12)  # square to the centre line
    assert np.hypot(*limiter[0, 1:]) == pytest.approx(float(helix.radius_m) - radius, rel=1e-9)  # inside of the bend


@pytest.mark.parametrize(
    "command",
    [("free", "--step", "5 deg"), ("valve",), ("shape", "renal_spiral", "--q", "1", "--voxel", "3,7")],
    ids=" ".join,
)
def test_dashboards_are_accepted_and_never_overwritten(tmp_path: Path, capsys, command) -> None:
    out = tmp_path / "design.rrd"
    assert cli.run([*command, "--out", str(out)]) == 0
    assert str(out) in " ".join(capsys.readouterr().out.split())
    rerun = Path(sys.executable).with_name("rerun")
    subprocess.run([rerun, "rrd", "verify", out], check=True, capture_output=True, timeout=120)
    assert cli.run([*command, "--out", str(out)]) == 2
    assert "not overwritten" in capsys.readouterr().err
