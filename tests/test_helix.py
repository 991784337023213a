"""The third fibre: published helices, a limiter whose length is kept, and no singularity on the way."""

import numpy as np
import pytest

from catheter.free import Infeasible, Stretches, inflate
from catheter.helix import HelixState, bend, design
from data.errors import BadInput

DEG = np.pi / 180
TUBE = {"radius": 5e-3, "length": 0.3}


def spiral(**differs: object):
    angles = (72 * DEG, -72 * DEG, -14 * DEG)
    return design(*angles, **{"volume_ratio": 1.3, **TUBE, **differs})  # type: ignore[arg-type]


def test_the_published_spiral() -> None:
    found = spiral()
    assert 1e3 * found.radius_m == pytest.approx(9.45837, abs=0.6e-5)
    assert np.degrees(found.angle_rad) == pytest.approx(-35.306, abs=0.6e-3)
    assert found.length_ratio == pytest.approx(0.863922, abs=0.6e-6)
    assert (1e3 * found.pitch_m, found.turns) == (pytest.approx(-42.088, abs=0.6e-3), pytest.approx(6.158, abs=0.6e-3))
    assert found.twist_rad == pytest.approx(0, abs=1e-12)
    exact = spiral(torsion="exact")
    assert (1e3 * exact.radius_m, exact.length_ratio) == (
        pytest.approx(11.60, abs=5e-3),
        pytest.approx(0.640, abs=5e-4),
    )
    assert np.degrees(exact.angle_rad) == pytest.approx(-25.35, abs=5e-3)


def test_radius_over_volume_is_not_monotone() -> None:
    found = [spiral(volume_ratio=volume) for volume in (1.13, 1.20, 1.30, 1.35)]
    assert [1e3 * f.radius_m for f in found] == pytest.approx([8.95, 10.00, 9.458, 8.68], abs=5e-3)
    assert found[0].length_ratio == pytest.approx(1.0035, abs=0.6e-4)


def random_helices(torsion: str):
    draw = np.random.default_rng(7)
    alpha, beta = draw.uniform(5, 89, (2, 4000)) * DEG * draw.choice([-1, 1], (2, 4000))
    pair = inflate(alpha, beta, draw.uniform(1.02, 1.5, 4000))
    gamma = draw.uniform(-60, 60, 4000) * DEG
    helix = bend(pair, gamma, **TUBE, torsion=torsion)
    return pair, gamma, helix, helix.state == HelixState.VALID


def inner_line(pair: Stretches, helix) -> np.ndarray:
    """Length of the line at the inside of the bend: a helix around the same axis, closer by l2 r."""
    inside = helix.radius_m - pair.radial * TUBE["radius"]
    return 2 * np.pi * helix.turns * np.hypot(inside, helix.pitch_m / (2 * np.pi))


def test_exact_torsion_gives_the_limiter_its_own_length() -> None:
    pair, gamma, helix, valid = random_helices("exact")
    assert valid.sum() > 300
    assert inner_line(pair, helix)[valid] * np.cos(gamma[valid]) == pytest.approx(TUBE["length"], rel=1e-9)
    arc = helix.axial * helix.length  # and the centre line that of the stretched tube
    turn = np.hypot(2 * np.pi * helix.radius_m, helix.pitch_m)
    assert (helix.turns * turn)[valid] == pytest.approx(arc[valid], rel=1e-12)


def test_thesis_torsion_makes_the_published_limiter_three_percent_too_long() -> None:
    pair = inflate(72 * DEG, -72 * DEG, 1.3)
    helix = bend(pair, -14 * DEG, **TUBE)
    assert inner_line(pair, helix) * np.cos(14 * DEG) / TUBE["length"] - 1 == pytest.approx(0.031, abs=5e-4)


def test_curvature_and_torsion_are_those_of_the_thesis() -> None:
    pair, gamma, helix, valid = random_helices("thesis")
    rho = (pair.axial * pair.radial * TUBE["radius"] / (pair.axial - helix.limiter))[valid]
    turning = ((helix.twist_rad + TUBE["length"] * np.tan(gamma) / TUBE["radius"]) / TUBE["length"])[valid]
    assert helix.radius_m[valid] == pytest.approx(rho / (1 + (turning * rho) ** 2), rel=1e-9)  # (3.15)
    phi = np.arctan(turning * rho)
    assert helix.angle_rad[valid] == pytest.approx(phi, rel=1e-9)  # (3.16)
    lambda_x = (pair.axial[valid] * np.cos(phi)) * np.sqrt(np.cos(phi) ** -2 - 1)
    assert helix.length_ratio[valid] == pytest.approx(lambda_x, rel=1e-7, abs=1e-7)  # (3.17) over L; its root cancels
    limiter = (helix.limiter * np.cos(gamma)) ** 2 + (pair.radial * (np.sin(gamma) + pair.twist * np.cos(gamma))) ** 2
    assert limiter[valid] == pytest.approx(1, abs=1e-12)  # (3.11)


def test_a_planar_ring_and_its_neighbours_are_no_singularity() -> None:
    pair = inflate(72 * DEG, -72 * DEG, 1.3)
    helix = bend(pair, np.array([-1e-6, 0.0, 1e-6]), **TUBE)
    assert (helix.state == HelixState.VALID).all()
    assert helix.radius_m == pytest.approx(1 / helix.curvature[1], rel=1e-6)
    assert (helix.angle_rad[1], helix.length_ratio[1], helix.pitch_m[1]) == (0, 0, 0)
    assert helix.turns[1] == pytest.approx(pair.axial * TUBE["length"] * helix.curvature[1] / (2 * np.pi), rel=1e-12)
    straight = bend(Stretches(*(np.array(x) for x in (1.0, 1.0, 0.0, 1.0, 0))), 0.5, **TUBE)
    assert straight.radius_m == pytest.approx(0, abs=1e-12)  # k = 0: the tube stays straight


def test_mirror_and_scale() -> None:
    pair = inflate(70 * DEG, -60 * DEG, 1.1)
    mirrored = inflate(-70 * DEG, 60 * DEG, 1.1)
    for torsion in ("thesis", "exact"):
        one, other = (bend(p, g, **TUBE, torsion=torsion) for p, g in ((pair, 10 * DEG), (mirrored, -10 * DEG)))
        assert one.radius_m == pytest.approx(other.radius_m, rel=1e-12)
        assert (one.pitch_m + other.pitch_m, one.twist_rad + other.twist_rad) == (pytest.approx(0, abs=1e-12),) * 2
        small = bend(pair, 10 * DEG, radius=5e-9, length=0.3, torsion=torsion)
        assert 1e6 * small.radius_m == pytest.approx(one.radius_m, rel=1e-12)
        assert small.length_ratio == pytest.approx(one.length_ratio, rel=1e-12)


@pytest.mark.parametrize(
    ("gamma", "differs", "error", "said"),
    [
        (90, {}, Infeasible, r"tan\(gamma\) is infinite"),
        (72, {}, Infeasible, "slack, its line stretches by 1.49481 as the tube does"),
        (80, {}, Infeasible, "slack, its line would stretch by 2.27"),
        (-14, {"volume_ratio": 1.0}, Infeasible, "slack"),
        (-14, {"volume_ratio": 1.38}, Infeasible, "beyond the lock"),
        (-14, {"radius": 0.0}, BadInput, "tube radius: is 0 m"),
        (-14, {"length": -1.0}, BadInput, "tube length: is -1 m"),
        (-14, {"torsion": "exat"}, BadInput, "did you mean 'exact'"),
        (100, {}, BadInput, "gamma: is 100 deg"),
    ],
)
def test_what_makes_no_helix_is_refused_by_name(gamma, differs, error, said) -> None:
    with pytest.raises(error, match=said):
        design(72 * DEG, -72 * DEG, gamma * DEG, **{"volume_ratio": 1.3, **TUBE, **differs})


def test_an_over_constrained_third_fibre_is_refused() -> None:
    with pytest.raises(Infeasible, match=r"over-constrained, its hoop share would have to be 1\.\d+ of its length"):
        design(30 * DEG, 60 * DEG, -80 * DEG, volume_ratio=1.3, **TUBE)
