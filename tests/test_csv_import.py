"""Logs come in unchanged; every repair is named, what would be a guess is refused."""

from pathlib import Path

import numpy as np
import pytest
from helpers import REAL

from data import csv_import
from data.csv_import import import_log
from data.errors import BadInput, CannotWrite
from data.mapping import Mapping, load, names
from data.recording import Recording

HEAD = """
[source]
title = "test"
who = "us"
licence = "Apache-2.0"
[format]
columns = ["t", "x", "f"]
{format}
[clock]
column = "t"
{clock}
[[topic]]
topic = "/stroke"
columns = ["x"]
unit = "mm"
[[topic]]
topic = "/force"
columns = ["f"]
unit = "N"
{nan}
"""


def mapping(folder: Path, *, text: str = "", clock: str = "", nan: str = "") -> Mapping:
    path = folder / "map.toml"
    path.write_text(HEAD.format(format=text, clock=clock, nan=nan))
    return load(str(path))


def bring_in(folder: Path, log: str, **options: str) -> tuple[list[str], Path]:
    source, out = folder / "log.csv", folder / "out.mcap"
    source.write_text(log)
    return import_log(source, mapping(folder, **options), out), out


ROWS = [(0.0, 1.0, 2.0), (0.1, 1.5, 2.5), (0.2, -3.25, 1e-3), (0.30001, 0.0, 0.0)]


@pytest.mark.parametrize(("name", "cell"), [("comma", ","), ("tab", "\t"), ("semicolon", ";"), ("space", "  ")])
@pytest.mark.parametrize("ending", ["\n", "\r\n"])
@pytest.mark.parametrize("header", [True, False])
def test_numbers_come_in_as_written_whatever_the_dialect(tmp_path, name, cell, ending, header) -> None:
    lines = [cell.join(map(repr, row)) for row in ROWS]
    log = ending.join(([cell.join("txf")] if header else []) + lines)  # no final newline
    repairs, out = bring_in(tmp_path, log, text=f'separator = "{name}"\nheader = {str(header).lower()}')
    assert repairs == []
    with Recording(out) as recording:
        assert recording.kind == "measured"
        assert recording.signal("/force").value.tolist() == [row[2] for row in ROWS]
        assert recording.signal("/stroke").value == pytest.approx([row[1] / 1e3 for row in ROWS], rel=1e-15)
        assert recording.signal("/stroke").time_s == pytest.approx([row[0] for row in ROWS], abs=1e-9)


def test_blocks_join_without_a_seam(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = "\n".join(f"{i / 100},{i},{-i}" for i in range(1000))
    monkeypatch.setattr(csv_import, "BLOCK_ROWS", 77)
    _, out = bring_in(tmp_path, log)
    with Recording(out) as recording:
        assert recording.signal("/force").value.tolist() == [-i for i in range(1000)]


def test_lines_are_counted_over_blocks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(csv_import, "BLOCK_ROWS", 77)
    rows = [f"{i / 100},{i},{-i}" for i in range(1000)]
    with pytest.raises(BadInput, match=r"line 501, column 'f': 'x'"):
        bring_in(tmp_path, "\n".join([*rows[:500], "5,1,x", *rows[501:]]))
    with pytest.raises(BadInput, match=r"line 502: time 4"):
        bring_in(tmp_path, "\n".join([*rows[:501], "4,1,1", *rows[502:]]))


@pytest.mark.parametrize(
    ("log", "options", "found"),
    [
        ("0,1,2\n0.1,1\n", {}, r"line 2: has 2 cells; expected 3"),
        ("0,1,2\n0.1,1,2,3\n", {}, r"line 2: has 4 cells"),
        ("0,1,2\n\n0.1,1,2\n", {}, r"line 2: is empty"),
        ("0,1,2\n0.1,one,2\n", {}, r"line 2, column 'x': 'one' is not a number"),
        ("0,1,2\n0.1,,2\n", {}, r"line 2, column 'x': '' is not a number"),
        ("0,1,2\n0.1,1,nan\n", {}, r"line 2, topic /force: value is NaN"),
        ("0,1,nan\n0.1,1,2\n0.2,1,nan\n", {"nan": 'nan = "head"'}, r"line 3, topic /force: value is NaN"),
        ("0,1,2\n0.1,1,inf\n", {"nan": 'nan = "keep"'}, r"line 2, topic /force: value is NaN or infinite"),
        ("nan,1,2\n0.1,1,1\n", {}, r"line 1: time is nan"),
        ("0,1,2\n0.2,1,1\n0.1,1,1\n", {}, r"line 3: time 0.1 s does not come after.*\(1 such rows"),
        ("0,1,2\n0.2,1,1\n0.2,1,1\n", {}, r"line 3: time 0.2 s does not come after"),
        ("0,1,2\n0.2,1,1\n0.1,1,1\n", {"clock": 'duplicates = "drop"'}, r"line 3: time 0.1 s"),
        (
            "0,1,2\n0.1,1,1\n0.25,1,1\n",
            {"clock": 'period = "100 ms"\ndigits = 5'},
            r"line 3: stamp 0.25 s is 0.05 s off",
        ),
        ("0,1,2\n0.11,1,1\n", {"clock": 'period = "100 ms"\ndigits = 2'}, r"line 2: stamp 0.11 s is 0.01 s off"),
        (
            "0,1,2\n1e5,1,1\n",
            {"clock": 'period = "10 ms"\ndigits = 5'},
            r"line 2: stamps are printed to 10 s; too",
        ),
        ("0,1,2\n1,1,1\n", {"clock": 'period = "1 s"'}, r"digits: is missing"),
        ("", {}, r"has no rows"),
        ("a,b,c\n0,1,2\n", {"text": "header = true"}, r"line 1: column 1 is 'a'; the mapping expects 't'"),
        ("t,x\n0,1\n", {"text": "header = true"}, r"line 1: has 2 columns"),
        ("0;1;2\n", {}, r"line 1: has 1 cells"),
    ],
)
def test_what_would_be_a_guess_is_refused_naming_line_and_column(tmp_path, log, options, found) -> None:
    with pytest.raises(BadInput, match=found):
        bring_in(tmp_path, log, **options)
    assert not (tmp_path / "out.mcap").exists()


def test_binary_rubbish_is_refused(tmp_path: Path) -> None:
    source = tmp_path / "log.csv"
    source.write_bytes(bytes(range(256)) * 20)
    with pytest.raises(BadInput, match="UTF-8|cells"):
        import_log(source, mapping(tmp_path), tmp_path / "out.mcap")


def test_repairs_are_done_and_named(tmp_path: Path) -> None:
    log = "0,1,nan\n0,1,nan\n0.1,1,2\n0.1,1,9\n0.2,1,3\n0.3,1,4\n0.4,1,5\n2.0,1,6\n"
    options = {"clock": 'drop_first = 1\nduplicates = "drop"', "nan": 'nan = "head"'}
    repairs, out = bring_in(tmp_path, log, **options)
    assert any("first 1 row" in text for text in repairs)
    assert any("1 rows with a repeated stamp dropped" in text for text in repairs)
    assert any("/force begins after 1 leading rows of NaN" in text for text in repairs)
    assert any("1 gaps wider than 5 sampling intervals left, the widest 1.6 s" in text for text in repairs)
    with Recording(out) as recording:
        assert recording.signal("/force").value.tolist() == [2, 3, 4, 5, 6]
        listed = recording.metadata["import"]
        assert [listed[f"repair.{i + 1}"] for i in range(len(repairs))] == repairs


@pytest.mark.parametrize("stamp", ["0", "nan", "1e300"])
@pytest.mark.parametrize("clock", ["drop_first = 1", 'drop_first = 1\nperiod = "10 ms"\ndigits = 13'])
def test_a_dropped_row_is_asked_nothing(tmp_path: Path, stamp: str, clock: str) -> None:
    rows = [f"{1.7e9 + i / 100:.2f},1,{i}" for i in range(5)]
    _, out = bring_in(tmp_path, "\n".join([f"{stamp},9,9", *rows]), clock=clock)
    with Recording(out) as recording:
        assert recording.signal("/force").value.tolist() == [0, 1, 2, 3, 4]
        assert recording.signal("/force").time_s == pytest.approx(np.arange(5) / 100, abs=2e-7)  # digits of 1.7e9


def test_an_output_that_exists_is_not_touched(tmp_path: Path) -> None:
    (tmp_path / "out.mcap").write_text("mine")
    with pytest.raises(CannotWrite, match="not overwritten"):
        bring_in(tmp_path, "0,1,2\n1,2,3\n")
    assert (tmp_path / "out.mcap").read_text() == "mine"


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (("unit", "unt"), r"\[\[topic\]\] 1, unt: is no such key; did you mean 'unit'"),
        (('unit = "mm"', 'unit = "furlongs/parsec2"'), "unit"),
        (('unit = "N"', 'unit = "kPa"'), r"/force: unit 'kPa'; the topic is in N"),
        (('columns = ["f"]', 'columns = ["g"]'), "column 'g': is not in"),
        (("[clock]", "[klock]"), r"\[klock\]: is no such table; did you mean 'clock'"),
        (('column = "t"', "column = 3"), r"\[clock\], column: is 3; expected str"),
        (('licence = "Apache-2.0"', ""), "licence: is missing"),
    ],
)
def test_a_wrong_mapping_is_refused_naming_file_and_key(tmp_path: Path, change: tuple[str, str], found: str) -> None:
    text = HEAD.format(format="", clock="", nan="")
    assert change[0] in text
    (tmp_path / "map.toml").write_text(text.replace(change[0], change[1], 1))
    (tmp_path / "log.csv").write_text("0,1,2\n")
    with pytest.raises(BadInput, match=found):
        import_log(tmp_path / "log.csv", load(str(tmp_path / "map.toml")), tmp_path / "out.mcap")


@pytest.mark.parametrize("name", names())
def test_the_real_logs_come_in_with_their_traps_named(tmp_path: Path, real: Path, name: str) -> None:
    log, rows, trap = REAL[name]
    repairs = import_log(real / log, load(name), tmp_path / "out.mcap")
    assert any(trap in text for text in repairs)
    with Recording(tmp_path / "out.mcap") as recording:
        assert max(channel.messages for channel in recording.channels.values()) == rows
        separator = "\t" if name == "zillen" else ","
        raw = np.genfromtxt(real / log, delimiter=separator, skip_header=int(load(name).format.header))
        for topic in load(name).topics:
            read = recording.signal(topic.topic)
            columns = [load(name).format.columns.index(column) for column in topic.columns]
            expected = raw[-len(read) :, columns].reshape(read.value.shape)
            scale = {"mm": 1e-3, "bar": 1e5}.get(topic.unit, 1.0)
            assert read.value == pytest.approx(expected * scale, rel=1e-14)
