"""Centrelines from files: units said, faults repaired and said, or refused naming the line."""

import base64
import zlib
from pathlib import Path

import numpy as np
import pytest

from catheter.centreline import Source, fitted, load, straight
from catheter.lab import cli
from catheter.lab.scene import FOLDER
from catheter.vessel_files import read_points
from data.errors import BadInput

T = np.linspace(0, 1, 30)
XYZ = np.stack([20 * T, 3 * np.sin(3 * T), 2 * T**2], axis=1)  # mm
RADIUS = 2.4 - 0.5 * T


def csv(path: Path, xyz=XYZ, radius=RADIUS, head="x,y,z,radius") -> Source:
    rows = "\n".join(",".join(f"{x:.17g}" for x in (*p, r)) for p, r in zip(xyz, radius, strict=True))
    path.write_text(f"{head}\n{rows}\n")
    return Source(file=str(path))


def test_units_are_told_from_radii_stated_or_refused(tmp_path: Path) -> None:
    in_mm = load(csv(tmp_path / "a.csv"))
    assert "taken as mm: no unit is stated" in in_mm.notes[0]
    in_cm = load(csv(tmp_path / "b.csv", XYZ / 10, RADIUS / 10))
    assert "taken as cm" in in_cm.notes[0]
    stated = load(csv(tmp_path / "c.csv", head="x [mm],y [mm],z [mm],radius [mm]"))
    assert stated.notes[0] == "Lengths are in mm, as stated."
    assert in_cm.length == pytest.approx(in_mm.length, rel=1e-12)
    assert stated.length == in_mm.length
    chords = np.linalg.norm(np.diff(XYZ, axis=0), axis=1).sum() * 1e-3
    assert chords < in_mm.length < chords * 1.001
    with pytest.raises(BadInput, match="in cm and in mm; say it"):
        load(csv(tmp_path / "d.csv", XYZ, 0.9 + 0 * RADIUS))
    with pytest.raises(BadInput, match="is mm in the file and cm here"):
        load(Source(file=str(tmp_path / "c.csv"), unit="cm"))


def test_the_spline_takes_over_where_the_polynomial_is_off_and_both_residuals_are_said() -> None:
    smooth = fitted(XYZ * 1e-3, RADIUS * 1e-3)
    assert smooth.kind == "polynomial"
    wavy = XYZ + np.stack([0 * T, np.sin(25 * T), 0 * T], axis=1)
    found = fitted(wavy * 1e-3, RADIUS * 1e-3)
    assert found.kind == "spline"
    assert found.residual["polynomial"] > 0.05 > smooth.residual["polynomial"]
    assert fitted(wavy * 1e-3, RADIUS * 1e-3, fit="polynomial").kind == "polynomial"
    quintic = np.stack([T, T**5 - T, T**3], axis=1)
    near = fitted(quintic * 0.02, np.full(30, 2e-3), fit="polynomial")  # of order 5 in x, nearly so by arc length
    assert near.residual["polynomial"] < 0.2


def test_repeated_and_shuffled_points_are_repaired_and_said() -> None:
    exact = fitted(XYZ * 1e-3, RADIUS * 1e-3, fit="spline")
    twice = fitted(np.repeat(XYZ, 2, axis=0) * 1e-3, np.repeat(RADIUS, 2) * 1e-3, fit="spline")
    assert "30 repeated point(s) dropped." in twice.notes
    order = np.append(0, 1 + np.random.default_rng(0).permutation(29))
    mixed = fitted(XYZ[order] * 1e-3, RADIUS[order] * 1e-3, fit="spline")
    assert any("out of order" in note for note in mixed.notes)
    w = np.linspace(0, exact.length, 7)
    for other in (twice, mixed):
        assert np.abs(other.centre(w, 0) - exact.centre(w, 0)).max() < 1e-12
    star = np.concatenate([XYZ, XYZ[10] + np.outer(np.arange(1, 9), [0, 0, 0.7])])
    with pytest.raises(BadInput, match="follow no single line"):
        fitted(star * 1e-3, np.full(len(star), 1e-3))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda t: t.replace(t.splitlines()[5].split(",")[1], "nan"), r"line 6: .* expected finite numbers"),
        (lambda t: "\n".join(t.splitlines()[:3]), "has 2 different points; a smooth centreline needs 4"),
        (lambda t: t.replace(t.splitlines()[4].split(",")[3], "0"), "line 5: .*a radius over 0"),
        (lambda t: t.replace("radius", "colour"), "line 1: .*expected x, y, z, radius"),
        (lambda t: t.replace(t.splitlines()[7], "1,2"), "line 8: is '1,2'; expected numbers"),
        (lambda t: "", "has no lines"),
    ],
)
def test_what_is_wrong_in_a_csv_is_named(tmp_path: Path, change, said) -> None:
    csv(tmp_path / "a.csv")
    (tmp_path / "a.csv").write_text(change((tmp_path / "a.csv").read_text()))
    with pytest.raises(BadInput, match=said):
        load(Source(file=str(tmp_path / "a.csv"), unit="mm"))


def test_a_centreline_that_crosses_itself_is_refused_with_both_places() -> None:
    a = 2 * np.pi * T * 0.98
    eight = 0.02 * np.stack([np.sin(a), np.sin(2 * a) / 2, 0.01 * T], axis=1)
    with pytest.raises(BadInput, match=r"crosses itself: w = [\d.]+ and [\d.]+ mm are .* apart"):
        fitted(eight, np.full(30, 1.5e-3), fit="spline")
    helix = 0.01 * np.stack([np.cos(a), np.sin(a), 3 * T], axis=1)
    assert fitted(helix, np.full(30, 1.5e-3)).length > 0.05
    with pytest.raises(BadInput, match="give both, over 0"):
        straight(0.01, 0.0)


def vtp(form: str, squeeze: bool = False) -> bytes:
    """A file as VTK writes it: two lines, the second of which is XYZ."""
    points = np.vstack([[[0, 0, 9.0], [0, 0, 8.0]], XYZ])
    arrays = [
        ("Points", "points", points, "Float64", 3),
        ("PointData", "MaximumInscribedSphereRadius", np.append([1.0, 1.0], RADIUS), "Float64", 1),
        ("Lines", "connectivity", np.arange(32), "Int64", 1),
        ("Lines", "offsets", np.array([2, 32]), "Int64", 1),
    ]
    appended, parts = b"", {"Points": "", "PointData": "", "Lines": ""}
    for place, name, values, kind, width in arrays:
        data = values.astype({"Float64": "<f8", "Int64": "<i8"}[kind]).tobytes()
        if squeeze:
            packed = [zlib.compress(data[k : k + 100]) for k in range(0, len(data), 100)]
            head = np.array([len(packed), 100, len(data) % 100, *map(len, packed)], dtype="<u4").tobytes()
            pieces = [head, b"".join(packed)]
        else:
            pieces = [np.array([len(data)], dtype="<u4").tobytes() + data]
        coded = b"".join(pieces if form == "raw" else map(base64.b64encode, pieces))
        text, where = ("", f' offset="{len(appended)}"') if form in ("raw", "appended") else (coded.decode(), "")
        appended += coded if where else b""
        if form == "ascii":
            text = " ".join(f"{x:.17g}" for x in values.ravel())
        word = "appended" if where else {"ascii": "ascii", "binary": "binary"}[form]
        parts[place] += (
            f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{width}" format="{word}"{where}>'
            f"{text}</DataArray>"
        )
    zipped = ' compressor="vtkZLibDataCompressor"' if squeeze else ""
    body = "".join(f"<{place}>{text}</{place}>" for place, text in parts.items())
    tail = b""
    if appended:
        tail = f'<AppendedData encoding="{"raw" if form == "raw" else "base64"}">\n_'.encode() + appended
        tail += b"</AppendedData>"
    head = f'<VTKFile type="PolyData" byte_order="LittleEndian" header_type="UInt32"{zipped}><PolyData><Piece>'
    return head.encode() + body.encode() + b"</Piece></PolyData>" + tail + b"</VTKFile>"


@pytest.mark.parametrize("squeeze", [False, True])
@pytest.mark.parametrize("form", ["ascii", "binary", "appended", "raw"])
def test_vtp_in_every_coding_and_the_branch_is_asked_for(tmp_path: Path, form, squeeze) -> None:
    path = tmp_path / "a.vtp"
    path.write_bytes(vtp(form, squeeze))
    found = read_points(path, 1)
    assert np.array_equal(found.xyz, XYZ)
    assert np.array_equal(found.radius, RADIUS)
    with pytest.raises(BadInput, match="has 2 lines, of 2, 30 points; say which: branch"):
        read_points(path)
    path.write_bytes(vtp(form, squeeze)[:-400])
    with pytest.raises(BadInput, match=r"a\.vtp"):
        read_points(path, 1)


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("offsets", [False, True])
def test_legacy_vtk(tmp_path: Path, binary, offsets) -> None:
    def numbers(values, kind: str) -> bytes:
        flat = np.asarray(values).ravel()
        return flat.astype(kind).tobytes() + b"\n" if binary else " ".join(f"{x:.17g}" for x in flat).encode() + b"\n"

    lines = b"LINES 1 31\n" + numbers([30, *range(30)], ">i4")
    if offsets:
        lines = b"LINES 2 30\nOFFSETS vtktypeint64\n" + numbers([0, 30], ">i8")
        lines += b"CONNECTIVITY vtktypeint64\n" + numbers(np.arange(30), ">i8")
    content = b"# vtk DataFile Version 5.1\nt\n" + (b"BINARY\n" if binary else b"ASCII\n")
    content += b"DATASET POLYDATA\nPOINTS 30 double\n" + numbers(XYZ, ">f8") + lines
    metadata = b"METADATA\nINFORMATION 1\nNAME L2_NORM_RANGE LOCATION vtkDataArray\nDATA 2 0 20.1\n\n"
    content += b"POINT_DATA 30\nFIELD FieldData 2\nTangent 3 30 double\n" + numbers(XYZ, ">f8") + metadata
    content += b"Radius 1 30 double\n" + numbers(RADIUS, ">f8") + metadata
    path = tmp_path / "a.vtk"
    path.write_bytes(content)
    found = read_points(path)
    assert np.array_equal(found.xyz, XYZ)
    assert np.array_equal(found.radius, RADIUS)


@pytest.mark.parametrize("count", ["-1", "-1e308", "nan", "1e308", "41"])
def test_a_line_of_legacy_vtk_that_cannot_be_is_refused(tmp_path: Path, count: str) -> None:
    points, order = " ".join(f"{k} 0 0" for k in range(40)), " ".join(map(str, range(40)))
    text = f"# vtk DataFile Version 3.0\nt\nASCII\nDATASET POLYDATA\nPOINTS 40 float\n{points}\nLINES 1 41\n"
    path = tmp_path / "a.vtk"
    path.write_text(f"{text}{count} {order}\n")
    with pytest.raises(BadInput, match="points in LINES; 40 follow"):  # -1 once made it read for ever
        read_points(path)
    path.write_text(f"{text}40 {order.replace(' 7 ', ' 1e300 ')}\n")
    with pytest.raises(BadInput, match="expected their numbers"):
        read_points(path)


def test_a_vessel_longer_than_any_body_is_refused(tmp_path: Path, capsys) -> None:
    text = (FOLDER / "inflection.toml").read_text().replace('"40 mm"', '"1e308 mm"')
    (tmp_path / "s.toml").write_text(text)
    assert cli.run(["shape", str(tmp_path / "s.toml")]) == 2
    assert "length" in capsys.readouterr().err
