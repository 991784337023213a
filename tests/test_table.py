"""The thesis's tables: transcription, units, arithmetic that must hold between their numbers, refusals."""

from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

import data.table
from data.errors import BadInput
from data.table import Table, read_table, table, tables
from data.units import UNDOCUMENTED, si_unit

TEXTS = ["3.text", "5.text", "6.text"]  # the numbers of a chapter's text
ALL = sorted(["3.1", "3.2", "3.3", "3.4", "3.5", "3.6", "5.1", "6.1", *TEXTS])  # every table of the thesis but 2.1
FOLDER = Path(data.table.__file__).parent / "tables"


def test_every_table_of_the_thesis_with_data_is_there_under_its_own_number() -> None:
    assert tables() == ALL
    assert [table(number).number for number in ALL] == ALL


@pytest.mark.parametrize("number", ALL)
def test_every_unit_is_known_and_every_unit_not_printed_is_marked(number: str) -> None:
    for column in table(number).columns.values():
        if column.unit == UNDOCUMENTED:
            assert not column.unit_printed
        elif column.unit:
            assert si_unit(column.unit)


@pytest.mark.parametrize("number", ALL)
def test_a_number_has_a_value_exactly_when_nothing_is_said_to_lack(number: str) -> None:
    shown = table(number)
    for row in shown.rows.values():
        for name, cell in row.items():
            if shown.columns[name].unit:
                assert np.isfinite(cell.si) == (not cell.lack)


def cracking() -> tuple[np.ndarray, np.ndarray]:
    """Return forward and reverse cracking pressure [angle, thickness], Pa."""
    t = table("3.5")
    assert np.allclose(np.degrees(t.column("angle")).reshape(6, 4), np.arange(0, 60, 10)[:, None])
    assert np.allclose(t.column("thickness").reshape(6, 4), np.array([50, 75, 100, 110]) * 25.4e-6)
    return t.column("forward").reshape(6, 4), t.column("reverse").reshape(6, 4)


def test_ratios_of_cracking_pressures() -> None:
    forward, reverse = cracking()
    ratios = [  # worked out apart from this file; three decimals
        [0.000, 0.000, 0.000, 0.000],
        [0.933, 0.885, 0.462, 0.268],
        [0.710, 0.592, 0.919, 0.522],
        [1.074, 3.708, 1.507, 1.129],
        [1.208, 3.923, 3.341, 1.871],
        [0.750, 1.720, 3.475, 2.250],
    ]
    assert np.allclose(reverse / forward - 1, ratios, rtol=0, atol=0.5001e-3)  # half a unit of the last digit


def test_cracking_pressures_break_the_texts_rules_just_where_the_notes_say() -> None:
    forward, reverse = cracking()

    def places(wrong: np.ndarray) -> list[tuple[int, ...]]:
        return [tuple(place) for place in np.argwhere(wrong).tolist()]

    # (step from angle 10 i, thickness j): the notes on steeper and on thicker cones
    assert places(np.diff(forward, axis=0) > 0) == [(1, 0), (1, 1), (3, 1), (4, 0)]
    assert places(np.diff(reverse, axis=0) < 0) == [(1, 0), (2, 1), (3, 0), (4, 0), (4, 1)]
    assert places(np.diff(forward, axis=1) < 0) == [(3, 0), (5, 0)]
    assert places(np.diff(reverse, axis=1) < 0) == []
    assert forward[0, 3] == pytest.approx(15.0 * 6894.757, rel=1e-6)


def test_volume_coefficients_at_83_kpa_and_the_rest_state_of_act_3() -> None:
    t = table("3.3")
    rows = np.stack([t.column(f"c{n}") for n in (4, 3, 2, 1)], axis=1)  # [actuator, power 4..1], Pa
    assert t.column("actuator") == ["Act 1", "Act 2", "Act 3"]
    for coefficients, static in zip(rows, (1.3205296, 1.4169465, 1.3739434), strict=True):
        roots = np.roots([*coefficients, -83e3])
        rising = roots[(abs(roots.imag) < 1e-9) & (roots.real > 0)].real
        assert 1 + rising.min() == pytest.approx(static, abs=0.6e-7)  # the oracle has seven decimals
    assert np.any(abs(1 + np.roots(rows[2]) - 1.02725) < 0.6e-5)  # where Act 3 rests


def test_valve_errors_follow_from_the_printed_coefficients_within_their_rounding() -> None:
    t = table("3.4")
    for valve in ("Valve 2", "Valve 3"):
        bounds = []
        for name in ("optimal", "fit", "error"):
            printed = Decimal(t.rows[valve][name].printed)
            half = Decimal(5).scaleb(int(printed.as_tuple().exponent) - 1)
            bounds.append((printed - half, printed + half))
        (optimal_low, optimal_high), (fit_low, fit_high), (error_low, error_high) = bounds
        assert error_high >= 100 * (fit_low / optimal_high - 1)
        assert error_low <= 100 * (fit_high / optimal_low - 1)
        nominal = t.value(valve, "fit") / t.value(valve, "optimal") - 1
        assert t.value(valve, "error") == pytest.approx(nominal, abs=1e-3)  # rounding; a lost % sign is 1
    assert np.isnan(t.column("fit")).tolist() == [True, False, False]
    with pytest.raises(BadInput, match=r"not printed in the thesis: .*largest cross-section"):
        t.value("Valve 1", "fit")


def test_valve_coefficients_belong_to_orifices_of_millimetres() -> None:
    area = table("3.4").column("optimal") / (0.62 * np.sqrt(2 / 997.45))  # (3.8)
    assert np.allclose(np.sqrt(4 * area / np.pi), [8.67e-3, 3.74e-3, 1.404e-3], rtol=1e-3)  # printed to 3 digits


def test_wrap_angles_in_radians_and_the_third_fibre_of_the_extender() -> None:
    t = table("3.2")
    assert np.allclose(t.column("alpha"), [np.pi * 72 / 180, np.pi * 80 / 180], rtol=1e-15)
    assert np.array_equal(t.column("beta"), -t.column("alpha"))
    assert t.value("Spiral", "gamma") == pytest.approx(-np.pi * 14 / 180)
    with pytest.raises(BadInput, match="does not use this fibre"):
        t.value("Extender", "gamma")


def test_design_and_bender_are_in_metres() -> None:
    design, bender = table("3.1"), table("3.6")
    assert design.value("Spiral", "R") == design.value("Spiral", "D") / 2
    assert (design.value("Spiral", "r"), design.value("Spiral", "L")) == (5e-3, 0.3)
    assert (design.value("Spiral", "lambda_x"), design.value("Spiral", "delta")) == (1, 0)
    assert [bender.value("Soft bender", name) for name in ("inner_diameter", "wall", "length")] == [12.7e-3, 2e-3, 0.17]
    assert bender.value("Soft bender", "wrap_angle") == pytest.approx(table("3.2").value("Extender", "alpha"))


def test_materials_in_pascal() -> None:
    t = table("5.1")
    c1 = dict(zip(t.column("material"), t.column("c1"), strict=True))
    printed = {"Agilus30": 0.20, "FLX9740": 0.22, "FLX9750": 0.29, "FLX9760": 0.41, "FLX9770": 0.73}
    printed |= {"FLX9785": 1.89, "FLX9795": 19.8}
    for material, megapascal in printed.items():
        assert c1.pop(material) == t.value(material, "c1") == pytest.approx(megapascal * 1e6, rel=1e-15)
    assert len(c1) == 4
    assert np.isnan(list(c1.values())).all()
    with pytest.raises(BadInput, match=r"Table 5.1, row 'Dragon Skin 10', column 'c1': not printed in the thesis"):
        t.value("Dragon Skin 10", "c1")
    assert t.value("Dragon Skin 10", "strength") == pytest.approx(475 * 0.45359237 * 9.80665 / 0.0254**2, rel=1e-12)
    assert np.array_equal(t.column("elongation_at_least"), [10, 10.6, 16, 24.22, 2.2, 1.2, 1.05, 0.8, 0.7, 0.6, 0.4])


def test_neither_text_nor_a_strength_without_a_unit_can_be_taken_for_a_number() -> None:
    t = table("5.1")
    bare = ["PolyTek 74-20", "PolyTek 74-29", "PolyTek 74-44"]
    for material, number in zip(bare, (217, 281, 462), strict=True):
        with pytest.raises(BadInput, match=f"{material}.*{number} is printed without a unit"):
            t.value(material, "strength")
        with pytest.raises(ValueError, match="could not convert"):
            float(t.rows[material]["strength"].printed)
        assert np.isnan(t.rows[material]["strength"].si)
    with pytest.raises(BadInput, match=", ".join(bare)):
        t.column("strength")
    with pytest.raises(BadInput, match="without a unit"):
        table("6.1").column("diff_min_change")
    with pytest.raises(BadInput, match="'SQP' is text"):
        table("6.1").value("fmincon", "algorithm")


def test_the_stiffest_c1_overshoots_its_own_strength_as_the_note_says() -> None:
    t = table("5.1")
    stretch = 1 + t.column("elongation_at_least")
    stress = 2 * t.column("c1") * (stretch - stretch**-2)  # uniaxial, engineering
    strength = np.array([t.value(material, "strength") for material in t.column("material")[4:]])
    assert (stress[4:] > strength).tolist() == [False] * 6 + [True]
    assert stress[-1] / strength[-1] == pytest.approx(3.8, abs=0.05)


@pytest.mark.parametrize("number", ALL)
def test_text_is_narrow_and_shows_every_digit_gap_and_note(number: str) -> None:
    shown = table(number)
    text = shown.text()
    assert max(map(len, text.splitlines())) <= 100
    unwrapped = " ".join(text.split())
    for row in shown.rows.values():
        line = next(line for line in text.splitlines() if line.startswith(next(iter(row.values())).printed + "  "))
        assert [cell for cell in row.values() if cell.printed not in line and len(cell.printed) < 20] == []
        assert all(" ".join(cell.printed.split()) in unwrapped for cell in row.values())
    assert shown.source in unwrapped
    for note in (*shown.notes, *(c.lack for row in shown.rows.values() for c in row.values())):
        assert note in unwrapped


def test_text_keeps_the_printed_digits_and_marks() -> None:
    assert "Act 1       1.60    5.92" in table("3.3").text()
    assert "[bar*]" in table("3.3").text()
    assert "[psi]" in table("3.5").text()
    assert "4.30e-8" in table("3.4").text()
    assert "475 psi      -" in table("5.1").text()
    assert "217 ?" in table("5.1").text()


@pytest.mark.parametrize(
    ("ask", "nearest"),
    [
        (lambda: table("3.33"), "3.3"),
        (lambda: table("../tables/3.3"), "3.3"),
        (lambda: table("5.1").value("agilus 30", "c1"), "Agilus30"),
        (lambda: table("5.1").value("DRAGON", "c1"), "Dragon Skin 10"),
        (lambda: table("5.1").value("Agilus30", "C1"), "c1"),
        (lambda: table("3.5").column("revers"), "reverse"),
    ],
)
def test_an_unknown_name_is_answered_with_the_nearest(ask: object, nearest: str) -> None:
    with pytest.raises(BadInput, match=f"is unknown; the nearest is '{nearest}'"):
        ask()  # type: ignore[operator]


def altered(folder: Path, old: str, new: str) -> Table:
    """Read Table 5.1 with one spot of its file changed."""
    text = (FOLDER / "5.1_materials.toml").read_text("utf-8")
    assert old in text
    path = folder / "5.1_materials.toml"
    path.write_text(text.replace(old, new, 1), "utf-8")
    return read_table(path)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("title =", "title", "Expected '='"),
        ("title =", "titel =", "field: 'titel' is unknown; the nearest is 'title'"),
        ('number = "5.1"', "", "field 'number': is None"),
        ("notes = [", 'notes = "none"\nrest = [', "field 'notes': is 'none'; expected list"),
        ('meaning = "tensile strength"', "", "missing 1 required keyword-only argument: 'meaning'"),
        ('unit = "MPa"', "unit = 6", "column strength, field 'unit': is 6; expected str"),
        ('unit = "MPa"', 'unit = "MPx"', "unit 'MPx': is unknown"),
        ('unit = "MPa"', 'unit = "MPa"\nunit_printed = "no"', "column strength, field 'unit_printed': is 'no'"),
        ('strength = "psi"', 'strength = "inch pounds of nothing"', "unit 'inch pounds of nothing'"),
        ('strength = "psi"', 'strength = ""', "unit ''"),
        ("c1 = 0.20", "c1 = true", "row 'Agilus30', column 'c1': 'True MPa' is not a number"),
        ("c1 = 0.20", "c1 = nan", "row 'Agilus30', column 'c1': 'nan MPa' is not a number"),
        ("c1 = 0.20", "c2 = 0.20", "row 'Agilus30', column: 'c2' is unknown; the nearest is 'c1'"),
        ("c1 = 0.20", "", "row 'Agilus30', column 'c1': needs either a value or a reason"),
        ("c1 = 0.20", 'c1 = 0.20\nnot_printed = { c1 = "x" }', "column 'c1': needs either a value or a reason"),
        ('{ c1 = "a dash, no fit is given" }', '["c1"]', "column 'not_printed': is ['c1']; expected dict"),
        ("strength = 217", 'strength = "many"', "row 'PolyTek 74-20', column 'strength': 'many 1'"),
        ('material = "Agilus30"', 'material = "FLX9740"', "column 'material': is the first, but no text"),
        ('the material"\nunit = ""', 'the material"\nunit = "m"', "'Dragon Skin 10 m' is not a number"),
    ],
)
def test_a_damaged_table_is_refused_by_file_and_field(tmp_path: Path, old: str, new: str, expected: str) -> None:
    with pytest.raises(BadInput) as refusal:
        altered(tmp_path, old, new)
    assert str(refusal.value).startswith(str(tmp_path / "5.1_materials.toml"))
    assert expected in str(refusal.value)


def test_what_is_no_table_at_all_is_refused_by_file(tmp_path: Path) -> None:
    head = b'number = "9.9"\ntitle = "t"\nsource = "s"\nnotes = []\n[columns.a]\nmeaning = "m"\nunit = "m"\n'
    path = tmp_path / "broken.toml"
    for content in (b"", b"\xff\xfe", b"a = " + b"[" * 5000, b"row = [3]\n" + head, b"row = [{ a = 3 }]\n" + head):
        path.write_bytes(content)
        with pytest.raises(BadInput, match=r"broken\.toml"):
            read_table(path)
    with pytest.raises(BadInput, match=r"absent\.toml"):
        read_table(tmp_path / "absent.toml")
