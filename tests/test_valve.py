"""Cones crack where they were measured to, between is between, beyond is refused; the text is held to its table."""

import json
from dataclasses import replace

import numpy as np
import pytest

from catheter.circuit import Circuit, ConicalValve, thesis_circuit
from catheter.circuit_kernel import flow
from catheter.free import Infeasible
from catheter.lab import cli
from catheter.valve import INCH, Wanted, choose, cone, measured
from catheter.valve_claims import claims
from data.errors import BadInput

PSI = 6894.757293168
DEG = np.pi / 180


def test_measured_cones_come_back_exactly() -> None:
    known = measured()
    found = cone(known.angle_rad[:, None], known.thickness_m)
    assert found.forward_pa == pytest.approx(known.forward_pa, rel=1e-14)
    assert found.reverse_pa == pytest.approx(known.reverse_pa, rel=1e-14)
    assert float(cone(40 * DEG, 0.075 * INCH).reverse_pa) == pytest.approx(12.8 * PSI, rel=1e-9)
    assert float(cone(40 * DEG, 0.075 * INCH).ratio) == pytest.approx(3.923, abs=0.6e-3)


def test_between_is_between_and_continuous() -> None:
    known = measured()
    draw = np.random.default_rng(1)
    angle, thickness = draw.uniform(0, 50 * DEG, 500), draw.uniform(0.05 * INCH, 0.11 * INCH, 500)
    found = cone(angle, thickness)
    i, j = np.searchsorted(known.angle_rad, angle), np.searchsorted(known.thickness_m, thickness)
    for pressure, table in ((found.forward_pa, known.forward_pa), (found.reverse_pa, known.reverse_pa)):
        corners = np.stack([table[i - a, j - b] for a in (0, 1) for b in (0, 1)])
        assert (pressure >= corners.min(axis=0) - 1e-9).all()
        assert (pressure <= corners.max(axis=0) + 1e-9).all()
    knots = known.angle_rad[1:-1, None]
    near = [cone(knots + e, known.thickness_m).forward_pa for e in (-1e-9, 1e-9)]
    assert near[0] == pytest.approx(near[1], rel=1e-6)
    # by hand, in the middle of a cell: the mean of its corners
    assert float(cone(25 * DEG, 0.0625 * INCH).forward_pa) == pytest.approx(
        np.mean([3.1, 7.6, 2.7, 2.4]) * PSI, rel=1e-9
    )
    assert float(cone(35 * DEG, 0.075 * INCH).ratio) == pytest.approx(3.82, abs=5e-3)


@pytest.mark.parametrize(
    ("angle", "thickness", "said"),
    [
        (55, 0.075, "cone angle: is 55 deg; measured are 0 to 50 deg"),
        (-1, 0.075, "cone angle: is -1 deg"),
        (35, 0.025, "cone thickness: is 0.025 in; measured are 0.05 to 0.11 in"),
        (np.nan, 0.075, "cone angle: is nan"),
    ],
)
def test_beyond_the_measured_is_refused_with_the_range(angle, thickness, said) -> None:
    with pytest.raises(BadInput, match=said):
        cone([10 * DEG, angle * DEG], thickness * INCH)


def test_a_choice_cracks_as_wanted() -> None:
    for wanted in (Wanted(ratio=2.0), Wanted(reverse=83e3), Wanted(ratio=1.0, forward=40e3), Wanted(ratio=0.0)):
        found = choose(wanted)
        cones = cone(found.angle_rad, found.thickness_m)
        assert (found.forward_pa, found.ratio) == (
            pytest.approx(float(cones.forward_pa)),
            pytest.approx(float(cones.ratio)),
        )
        assert found.miss <= 0.02
        for name, size in (("forward", found.forward_pa), ("reverse", found.reverse_pa)):
            target = getattr(wanted, name)
            assert not target or size == pytest.approx(target, rel=0.02)
        assert wanted.ratio is None or 1 + found.ratio == pytest.approx(1 + wanted.ratio, rel=0.02)
    exact = choose(Wanted(forward=2.6 * PSI, reverse=12.8 * PSI))
    assert exact.measured
    assert (exact.angle_rad, exact.thickness_m) == (pytest.approx(40 * DEG), pytest.approx(0.075 * INCH))


def test_a_choice_that_is_not_there_names_the_nearest() -> None:
    with pytest.raises(
        Infeasible, match=r"within 2.0% of a ratio of 9; the nearest is 40 deg, 0.075 in: .* ratio 3.92"
    ):
        choose(Wanted(ratio=9.0))
    for wanted in (Wanted(), Wanted(ratio=1.0, forward=1e4, reverse=1e4)):
        with pytest.raises(BadInput, match="give one or two"):
            choose(wanted)


def test_a_measured_cone_in_a_circuit_is_shut_between_its_pressures_and_an_orifice_beyond() -> None:
    found = cone(np.radians(40), 0.075 * INCH)
    forward, reverse, factor = float(found.forward_pa), float(found.reverse_pa), 3e-7
    valve = ConicalValve(coefficient=factor, forward=forward, reverse=reverse)
    table = Circuit(segments=(replace(thesis_circuit().segments[0], valve=valve),)).table()
    drop = np.linspace(-200e3, 100e3, 30_001)
    q = np.array([flow(table, 0, float(p))[0] for p in drop])
    assert (np.diff(q) >= 0).all()
    assert (q[(drop >= -reverse) & (drop <= forward)] == 0).all()
    assert (q[drop > forward + 10] > 0).all()
    assert (q[drop < -reverse - 10] < 0).all()
    for p in (forward + 40e3, -reverse - 40e3):
        assert flow(table, 0, p)[0] == pytest.approx(np.sign(p) * factor * 200, rel=1e-5)  # K sqrt(40 kPa)


def test_claims_of_the_text_against_its_table() -> None:
    found = claims()
    assert [claim.holds for claim in found] == [False, False, True, False, False, False, False, True]
    against = {claim.text: claim.against for claim in found}
    assert len(against["Steeper cones crack at a lower forward pressure"]) == 5
    assert len(against["Steeper cones crack at a higher reverse pressure"]) == 6
    assert (
        "30 deg, 0.050 in to 30 deg, 0.075 in: 2.7 to 2.4 psi"
        in against["Thicker cones crack at a higher forward pressure"]
    )
    assert "0.025 in is not" in found[0].against
    assert "3.82; the largest is 3.923 at 40 deg, 0.075 in" in found[1].table
    assert "saddles: none" in found[3].table


def test_the_command_lists_interpolates_and_chooses(capsys, tmp_path) -> None:
    def run(*arguments: str) -> tuple[int, str, str]:
        code = cli.run(["valve", *arguments])
        return code, *capsys.readouterr()

    code, out, _ = run("--json")
    assert (code, len(json.loads(out)["measured"])) == (0, 24)
    code, out, _ = run()
    assert max(map(len, out.splitlines())) <= 100
    assert out.count("FAILS") == 6
    code, out, _ = run("--angle", "35 deg", "--thickness", "0.075 inch", "--json")
    assert json.loads(out)["cone"]["ratio"] == pytest.approx(3.82, abs=5e-3)
    code, out, _ = run("cone", "--json")
    assert json.loads(out)["cone"]["ratio"] == pytest.approx(2.0, abs=0.06)
    for arguments, said in (
        (("--angle", "35 deg"), "give both"),
        (("--angle", "60 deg", "--thickness", "0.075 inch"), "measured are 0 to 50 deg"),
        (("--ratio", "9"), "the nearest is 40 deg"),
        (("free",), "is a free scene"),
    ):
        code, _, err = run(*arguments)
        assert code == 2
        assert said in err
    assert cli.run(["report", "valves", "--out", str(tmp_path)]) == 0
    assert "0.110 in is in the table" in capsys.readouterr().out
