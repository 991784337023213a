"""The thesis regenerated: every number has its entry, every difference a reason, figures say where they are from."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from catheter.lab import cli, plot, thesis_report
from catheter.lab.thesis.entries import (
    AGREES,
    DIFFERS,
    FAILED,
    MISPRINT,
    RECOVERED,
    UNKNOWN,
    VERDICTS,
    Section,
    claim,
    compare,
    told,
    unknown,
)
from catheter.lab.thesis.locomotion import water_density_kg_m3
from catheter.lab.thesis_report import FIGURES, Regenerated, regenerate
from data.table import table


@pytest.fixture(scope="module")
def made() -> Regenerated:
    return regenerate(quick=True, progress=lambda _: None)


def test_every_number_and_sentence_of_the_texts_has_its_entry(made: Regenerated) -> None:
    named = {entry.quantity for entry in made.entries}
    for number in ("3.text", "5.text", "6.text"):
        assert set(table(number).rows) - named == set()


def test_nothing_failed_and_every_difference_is_explained(made: Regenerated) -> None:
    assert made.failed == []
    assert [entry.quantity for entry in made.unexplained] == []
    assert sum(made.counts.values()) == len(made.entries) > 100
    assert set(made.counts) <= set(VERDICTS)


def test_what_is_known_to_agree_and_to_differ(made: Regenerated) -> None:
    found = {entry.quantity: entry for entry in made.entries}
    for name in ("Spiral, alpha", "Spiral, gamma", "occlusion of the cannula", "tB, rear spiral anchored"):
        assert found[name].verdict == AGREES
    assert found["tF, front spiral lets go"].verdict == DIFFERS
    assert found["tF, front spiral lets go"].mismatch_percent == pytest.approx(3.94, abs=0.05)  # 1205.7 ms for 1160
    assert found["hoop stress at the bore of (6.29) over P"].verdict == MISPRINT
    assert found["F_unc, cubic"].verdict == RECOVERED
    assert found["Extender, alpha"].verdict == UNKNOWN


def test_every_figure_is_drawn_or_said_to_be_missing_and_names_where_its_data_are_from(made: Regenerated) -> None:
    drawn = {figure.number for figure in made.figures}
    assert {number for number in FIGURES if number.startswith("3.")} <= drawn
    missing = {entry.place.removeprefix("Fig ") for entry in made.entries if entry.quantity == "the figure"}
    assert drawn | missing >= set(FIGURES)
    assert not drawn & missing
    assert {figure.kind for figure in made.figures} <= {"simulated", "published data"}
    assert [figure.number for figure in made.figures if figure.kind != "simulated"] == ["3.20"]  # drawn from Table 3.5


@pytest.mark.parametrize(
    ("ours", "verdict", "shown"),
    [(0.0349, AGREES, "0.0349"), (0.0351, DIFFERS, "0.0351"), (0.025, AGREES, "0.025"), (0.0249, DIFFERS, "0.0249")],
)
def test_agreement_is_to_the_last_digit_printed(ours: float, verdict: str, shown: str) -> None:
    entry = compare("3.text", "tB, rear spiral anchored", ours, reason="because")  # printed: 0.03 s
    assert (entry.verdict, entry.ours, entry.unit, entry.published) == (verdict, shown, "s", "0.03")
    assert entry.mismatch_percent == pytest.approx(100 * (ours / 0.03 - 1))


def test_bounds_claims_misprints_and_recoveries() -> None:
    assert compare("3.text", "largest occlusion allowed", 0.37).verdict == AGREES
    assert compare("3.text", "largest occlusion allowed", 0.51).verdict == DIFFERS
    assert not compare("3.text", "largest occlusion allowed", 0.51).explained  # a reason would be missing
    assert compare("6.text", "axial stress of (6.29) over P", 1.78).verdict == MISPRINT
    assert compare("3.text", "F_con, cubic", 6.5e-4, recovered=True).verdict == RECOVERED
    assert compare("3.text", "F_con, cubic", 9e-4, recovered=True).verdict == DIFFERS
    assert claim("3.text", "(3.21)", "x", holds=False).verdict == MISPRINT
    assert claim("3.text", "dynamics play a negligible role", "x", holds=True).verdict == AGREES
    entry = unknown("3.2", "Extender", "alpha", "why")
    assert (entry.verdict, entry.published, entry.ours) == (UNKNOWN, "80", "-")
    assert compare("3.4", "Valve 2", 3.05e-7, "optimal").verdict == AGREES  # a table of the thesis itself


def test_water_is_as_dense_as_tabulated() -> None:
    # IAPWS-95 at 0.1 MPa, as tabulated; Kell's equation is good to 1e-3 of that.
    for celsius, density in ((4.0, 999.975), (20.0, 998.207), (23.0, 997.540), (40.0, 992.216)):
        assert water_density_kg_m3(celsius) == pytest.approx(density, abs=5e-3)


def good(*, quick: bool) -> Section:
    def draw(figure) -> None:
        plot.axes(figure, ("time", "s"), ("force", "N")).plot(np.arange(9), np.arange(9) % 2)

    from catheter.lab.thesis.entries import Figure

    def broken(figure) -> None:
        raise ValueError("nothing to draw")

    return Section(
        entries=[told("here", "a number", "1", "1", verdict=AGREES)],
        figures=[
            Figure(number="3.10", title="t", kind="simulated", draw=draw),
            Figure(number="3.11", title="t", kind="simulated", draw=broken),
        ],
    )


def bad(*, quick: bool) -> Section:
    raise RuntimeError("too stiff")


def test_a_part_that_fails_costs_no_other_and_is_a_row(tmp_path: Path, capsys, monkeypatch) -> None:
    import catheter.lab.thesis.materials as place

    monkeypatch.setattr(place, "bad", bad, raising=False)
    monkeypatch.setattr(place, "good", good, raising=False)
    monkeypatch.setattr(thesis_report, "SECTIONS", ("thesis.materials.bad", "thesis.materials.good"))
    arguments = ["report", "thesis", "--quick", "--json", "--out", str(tmp_path)]
    assert cli.run(arguments) == 1
    rows = json.loads(capsys.readouterr().out)["rows"]
    failed = {row["place"]: row["reason"] for row in rows if row["verdict"] == FAILED}
    assert failed == {
        "thesis.materials.bad": "RuntimeError: too stiff",
        "Fig 3.11": "ValueError: nothing to draw",
    }
    assert any(row["quantity"] == "a number" for row in rows)
    with (tmp_path / "thesis.csv").open(newline="") as file:
        assert len(list(csv.DictReader(file))) == len(rows)
    assert sorted(p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*.*")) == [
        *("thesis.csv", "thesis.json", "thesis.rrd", "thesis/fig_3.10.png")
    ]
    import cv2

    assert cv2.imread(str(tmp_path / "thesis" / "fig_3.10.png")).std() > 10  # not blank
    assert cli.run(arguments) == 2  # nothing is overwritten unasked
    assert "not overwritten" in capsys.readouterr().err
    assert cli.run([*arguments, "--recording", "x"]) == 2


def test_the_printed_report_is_narrow_and_gives_each_reason_once(made: Regenerated, capsys) -> None:
    from catheter.lab.outcome import Outcome

    Outcome({}, thesis_report.parts(made)).show()
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 100
    text = " ".join(" ".join(lines).split())
    for reason in {entry.reason for entry in made.entries if entry.reason}:
        assert text.count(" ".join(reason.split())) >= 1
