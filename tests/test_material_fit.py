"""Five laws: their own numbers from their own curves, Drucker's condition, and a fit that becomes a material."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catheter.inflatable import Path as Loads
from catheter.inflatable import Pattern, Shape, build
from catheter.lab import cli
from catheter.laws import columns, drucker, stiffness
from catheter.material import material
from catheter.material_fit import Tensile, fit_material
from catheter.tensile import Specimen
from data.errors import BadInput
from fem.material import Hooke, Law, MooneyRivlin, NeoHooke, Ogden, Yeoh

LAWS: dict[str, Law] = {
    "Hooke": Hooke(young=1.1e6),
    "neo-Hooke": NeoHooke(c1=2e5),
    "Mooney-Rivlin": MooneyRivlin(1.5e5, 4e4),
    "Yeoh": Yeoh(1.8e5, -5e3, 2e3),
    "Ogden": Ogden((1.6e5,), (2.8,)),
}
QUICK = Tensile(resamples=50)
STRAIN = np.linspace(0.01, 1.2, 60)


def _tests(law: Law, noise: float = 0.0, count: int = 3) -> list[Specimen]:
    draw = np.random.default_rng(0)
    return [
        Specimen(f"{k}", STRAIN, law.uniaxial(1 + STRAIN) * (1 + 0.01 * k) + draw.normal(0, noise, len(STRAIN)), True)
        for k in range(-(count // 2), count // 2 + 1)
    ]


@pytest.mark.parametrize("name", ["Hooke", "neo-Hooke", "Mooney-Rivlin", "Yeoh"])
def test_a_law_s_columns_times_its_numbers_are_its_stress(name: str) -> None:
    law = LAWS[name]
    numbers = [law.young] if isinstance(law, Hooke) else law.numbers()
    assert columns(name, 1 + STRAIN) @ numbers == pytest.approx(law.uniaxial(1 + STRAIN), rel=1e-12)


@pytest.mark.parametrize("name", ["neo-Hooke", "Mooney-Rivlin", "Yeoh", "Ogden"])
def test_a_law_is_found_from_its_own_curve(name: str) -> None:
    law = LAWS[name]
    fit = fit_material(_tests(law), QUICK).laws[name]
    # the zero is neo-Hookean: exact for that law, to second order in the strain for Yeoh, to first for the others
    allowed = {"neo-Hooke": 1e-9, "Yeoh": 0.02}.get(name, 0.1)
    assert fit.law.shear == pytest.approx(law.shear, rel=allowed)
    strain = np.linspace(0.1, 1, 20)
    assert fit.law.uniaxial(1 + strain) == pytest.approx(law.uniaxial(1 + strain), rel=max(1e-9, allowed / 2))
    assert (fit.low <= fit.values).all()
    assert (fit.values <= fit.high).all()
    assert fit.each.shape == (3, len(fit.numbers))


def test_a_law_that_would_be_no_solid_is_left_out_and_said() -> None:
    found = fit_material(_tests(LAWS["Hooke"]), QUICK)
    assert "shear modulus of -" in found.left_out["Mooney-Rivlin"]
    assert "Mooney-Rivlin" not in found.laws


def test_least_squares_is_at_its_optimum_and_specimens_count_alike() -> None:
    tests = _tests(LAWS["Yeoh"], noise=500.0)
    tests[0] = Specimen("thin", tests[0].strain[::2], tests[0].stress[::2], True)
    found = fit_material(tests, QUICK)
    fit, slope, size = found.laws["Yeoh"], np.zeros(3), np.zeros(3)
    for one in found.specimens:
        inside = (one.strain > 0) & (one.strain <= 1)
        X = columns("Yeoh", 1 + one.strain[inside])
        slope += X.T @ (one.stress[inside] - X @ fit.values) / inside.sum()
        size += np.abs(X).T @ np.abs(one.stress[inside]) / inside.sum()
    assert np.abs(slope / size).max() < 1e-12


def test_one_specimen_has_no_interval() -> None:
    fit = fit_material(_tests(LAWS["Yeoh"])[:1], QUICK).laws["Yeoh"]
    assert np.isnan(fit.low).all()
    assert np.isnan(fit.high).all()


def test_akaike_prefers_the_law_that_made_the_data() -> None:
    plain = fit_material(_tests(LAWS["neo-Hooke"], noise=300.0), QUICK).laws
    best = min(fit.aicc for fit in plain.values())
    assert plain["neo-Hooke"].aicc - best < 30  # laws that hold it fit the zero's error too
    assert plain["Hooke"].aicc - best > 300
    found = fit_material(_tests(Yeoh(3e5, 3e4, 8e3), noise=300.0), QUICK)
    assert found.preferred.name == "Yeoh"
    assert found.laws["Yeoh"].chosen_by == 3
    assert found.elongation == pytest.approx(1.2, abs=0.02)
    assert found.broke == 3


@pytest.mark.parametrize("name", LAWS)
def test_the_stiffness_is_the_slope_of_true_stress(name: str) -> None:
    law = replace(LAWS[name], nu=0.4999999)  # Saint-Venant-Kirchhoff's shear modulus is young / 3 only then
    e, h = np.linspace(-0.4, 0.6, 11), 1e-6
    along = np.array([1.0, -0.5])
    hessian = np.einsum("i,nij,j->n", along, stiffness(law, e, -e / 2), along)

    def true(log_strain: np.ndarray) -> np.ndarray:
        return np.exp(log_strain) * law.uniaxial(np.exp(log_strain))

    if name == "Hooke":  # uniaxial() is the compressible law's, S = E times the Green strain: only at rest the same
        assert hessian[4] == pytest.approx(((true(e + h) - true(e - h)) / (2 * h))[4], rel=1e-6)
    else:
        assert hessian == pytest.approx((true(e + h) - true(e - h)) / (2 * h), rel=1e-7)


def test_drucker_finds_where_a_law_turns() -> None:
    assert drucker(NeoHooke(c1=2e5), 3.0).everywhere
    assert drucker(Ogden((-1e5,), (-3.0,)), 3.0).everywhere
    assert not drucker(MooneyRivlin(2e5, -1e5), 3.0).everywhere
    assert not drucker(Ogden((2e5, 1e5), (2.0, -1.0)), 3.0).everywhere


def test_drucker_finds_mooney_rivlin_s_limit_when_stretched_both_ways() -> None:
    # W(e, e) = c1 (2 x + x^-2) + c2 (2 / x + x^2), x = exp(2 e): its second derivative over e vanishes there
    x = np.linspace(1, 9, 400_001)
    for c2 in (-1e5, -2e4):
        steep = 2e5 * (8 * x + 16 / x**2) + c2 * (8 / x + 16 * x**2)
        limit = float(np.sqrt(x[np.argmax(steep <= 0)]))
        found = drucker(MooneyRivlin(2e5, c2), 3.0).limits["both ways"][1]
        assert found == pytest.approx(limit, rel=3e-3)  # a step of the search


def test_drucker_agrees_with_the_uniaxial_maximum() -> None:
    law = Yeoh(2e5, -2e4, 0.0)
    found = drucker(law, 3.0)
    stretch = np.linspace(1, 3, 20001)
    turn = stretch[np.argmax(stretch * law.uniaxial(stretch))]  # true stress is greatest
    assert found.limits["tension"][1] <= turn + 0.01
    assert not found.everywhere
    assert "tension" in found.words


def _csv(path: Path) -> Path:
    rows = [
        f"{test.name},{strain},{stress / 1e6}"
        for test in _tests(Yeoh(3e5, 3e4, 8e3), noise=300.0)
        for strain, stress in zip(test.strain, test.stress, strict=True)
    ]
    path.write_text("\n".join(["specimen,strain,stress_MPa", *rows]), encoding="utf-8")
    return path


def test_a_fit_becomes_a_material_of_a_scene(tmp_path: Path, capsys) -> None:
    out, picture = tmp_path / "rubber.toml", tmp_path / "rubber.png"
    command = [
        "fit",
        str(_csv(tmp_path / "t.csv")),
        "--model",
        "material",
        "--specimen",
        "specimen",
        "--resamples",
        "50",
    ]
    more = ["--out", str(out), "--picture", str(picture), "--origin", "simulated", "--name", "rubber", "--json"]
    assert cli.run([*command, *more]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["kind"], found["law"]) == ("simulated", "Yeoh")
    assert set(found["toml"]["row"]) == {"material", "elongation_at_least", "strength", "c1"}
    law = material(str(out))
    assert isinstance(law, Yeoh)
    assert law.c1 == found["laws"]["Yeoh"]["numbers"]["c1"]
    assert (law.name, law.elongation) == ("rubber", found["elongation"])
    small = Shape(divisions=(8, 8, 1), voxels=(8, 8))
    tube = build(small, Pattern(soft=str(out), pattern="strip", width=2), Loads())
    assert tube.material[3, 0] == law
    assert tube.material[0, 0].name == "FLX9785"
    import cv2

    assert cv2.imread(str(picture)).std() > 10  # not blank
    assert cli.run([*command, *more]) == 2
    assert "not overwritten" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[material]\nname = "a"\nlaw = "Yeoh"\nelongation = 1.0\nc1 = "1 MPa"\n', "lacks a number of Yeoh"),
        ('[material]\nname = "a"\nlaw = "Yoh"\nelongation = 1.0\n', "Yeoh"),
        ('[fit]\nmodel = "valve"\n', "name: is missing"),
    ],
)
def test_a_file_that_is_no_material_is_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "m.toml"
    path.write_text(text)
    with pytest.raises(BadInput, match=r"m\.toml, \[material\]") as refused:
        material(str(path))
    assert said in str(refused.value)


def test_the_wrong_range_and_law_are_refused(tmp_path: Path, capsys) -> None:
    path = str(_csv(tmp_path / "t.csv"))
    base = ["fit", path, "--model", "material", "--specimen", "specimen"]
    assert cli.run([*base, "--law", "Yoeh"]) == 2
    assert "Yeoh" in capsys.readouterr().err
    assert cli.run([*base, "--rest-volume", "2 mL"]) == 2
    assert "--rest-volume: given for a material model" in capsys.readouterr().err
    assert cli.run(["fit", path, "--model", "bender", "--where", "specimen=1"]) == 2
    assert "--where: given for a bender model" in capsys.readouterr().err
    assert cli.run([*base, "--most-strain", "0.1"]) == 2
    assert "widen the range" in capsys.readouterr().err
