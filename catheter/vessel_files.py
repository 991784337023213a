"""Centrelines as other tools write them: CSV, VTK's XML (.vtp) and legacy (.vtk) polygon data.

Read without VTK: points, one array for each, and the lines that join them. Units come later.
"""

import base64
import re
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput
from data.files import open_regular
from data.signal import Array

MOST_BYTES = 1 << 28
RADII = ("maximuminscribedsphereradius", "radius", "r")  # the first is what VMTK writes
_TYPES = {"Float32": "f4", "Float64": "f8", "Int32": "i4", "Int64": "i8", "UInt8": "u1", "UInt32": "u4", "UInt64": "u8"}
_LEGACY = {"float": "f4", "double": "f8", "int": "i4", "vtktypeint64": "i8", "long": "i8", "unsigned_char": "u1"}


@dataclass(frozen=True, eq=False)
class Points:
    """Points (n, 3) and radii (n,) of one branch as a file has them; unit: as stated in it, or ""."""

    xyz: Array
    radius: Array
    unit: str


def read_points(path: Path, branch: int | None = None) -> Points:
    """Return a branch of a centreline file. Raises BadInput naming file and line of what is wrong.

    branch: which line of a VTK file, counted from 0; may be None where there is one.
    """
    with open_regular(path) as file:
        content = file.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise BadInput(path, f"is longer than {MOST_BYTES} bytes", "name a centreline")
    if path.suffix.lower() in (".vtp", ".vtk"):
        xyz, arrays, lines = _vtp(path, content) if path.suffix.lower() == ".vtp" else _vtk(path, content)
        return _branch(path, xyz, arrays, lines, branch)
    if branch is not None:
        raise BadInput(f"{path}, branch {branch}", "is asked of a CSV file", "it holds one centreline")
    return _csv(path, content)


def _csv(path: Path, content: bytes) -> Points:
    """Return columns x, y, z, radius; a unit may stand behind a name: x_mm, x [mm]. Lines with # are skipped."""
    text = content.decode("utf-8-sig", errors="replace")
    lines = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip() and line.lstrip()[0] != "#"]
    if not lines:
        raise BadInput(path, "has no lines", "expected columns x, y, z, radius")
    separator = next((mark for mark in (";", ",", "\t") if mark in lines[0][1]), None)
    names = [name.strip().strip('"').lower() for name in lines[0][1].split(separator)]
    matches = [re.fullmatch(r"(.*?)(?:[_ ]?[\[(]([a-z]+)[\])]|_(m|mm|cm))?", name) for name in names]
    bare = [match.group(1).strip() if match else "" for match in matches]
    units = {match.group(2) or match.group(3) for match in matches if match} - {None}
    try:
        columns = [bare.index(axis) for axis in "xyz"] + [next(bare.index(name) for name in RADII if name in bare)]
    except (ValueError, StopIteration):
        raise BadInput(f"{path}, line {lines[0][0]}", f"is {lines[0][1]!r:.60}", "expected x, y, z, radius") from None
    if len(units) > 1:
        raise BadInput(f"{path}, line {lines[0][0]}", f"has units {', '.join(sorted(map(str, units)))}", "expected one")
    rows = []
    for number, line in lines[1:]:
        cells = line.split(separator)
        try:
            rows.append([float(cells[k]) for k in columns])
        except (ValueError, IndexError):
            raise BadInput(f"{path}, line {number}", f"is {line!r:.60}", "expected numbers x, y, z, radius") from None
        if not np.isfinite(rows[-1]).all() or not rows[-1][3] > 0:
            raise BadInput(f"{path}, line {number}", f"is {line!r:.60}", "expected finite numbers and a radius over 0")
    values = np.array(rows).reshape(-1, 4)
    return Points(values[:, :3], values[:, 3], str(units.pop()) if units else "")


Parsed = tuple[Array, dict[str, Array], list[NDArray[np.int64]]]


def _branch(
    path: Path, xyz: Array, arrays: dict[str, Array], lines: list[NDArray[np.int64]], branch: int | None
) -> Points:
    if branch is None and len(lines) != 1:
        sizes = ", ".join(str(len(line)) for line in lines[:20])
        raise BadInput(path, f"has {len(lines)} lines, of {sizes} points", "say which: branch = 0, 1 ...")
    if branch is not None and not 0 <= branch < len(lines):
        raise BadInput(f"{path}, branch {branch}", f"is none of its {len(lines)} lines")
    folded = {name.lower(): values for name, values in arrays.items()}
    radius = next((folded[name] for name in RADII if name in folded), None)
    if radius is None:
        known = ", ".join(arrays) or "none"
        raise BadInput(path, f"has no radius; its point data are: {known}", "expected MaximumInscribedSphereRadius")
    line = lines[branch or 0]
    if line.size and (line.min() < 0 or line.max() >= min(len(xyz), len(radius))):
        raise BadInput(path, f"has a line through point {line.max()} of {len(xyz)}", "it is damaged")
    points, radii = xyz[line], radius[line]
    sound = np.isfinite(points).all(axis=1) & np.isfinite(radii) & (radii > 0)
    if not sound.all():
        bad = int(line[np.argmin(sound)])
        raise BadInput(f"{path}, point {bad}", f"is {xyz[bad]}, radius {radius[bad]}", "expected finite, radius over 0")
    return Points(points, radii, "")


def _split(connectivity: Array, ends: Array) -> list[NDArray[np.int64]]:
    parts = np.split(connectivity.astype(np.int64), ends.astype(np.int64))
    return [part for part in parts if part.size > 1]


def _vtp(path: Path, content: bytes) -> Parsed:
    raw = re.search(rb"<AppendedData[^>]*>\s*_", content)  # may hold any byte: no XML
    appended = b""
    if raw:
        end = content.rindex(b"</AppendedData>") if b"</AppendedData>" in content else len(content)
        appended = content[raw.end() : end]
        content = content[: raw.end()] + b"</AppendedData></VTKFile>"
    try:
        root = ElementTree.fromstring(content)
        piece = root.find("PolyData/Piece")
        if piece is None:
            raise BadInput(path, "has no polygon data", "expected a VTK file of type PolyData")
        coded = appended if raw and b'encoding="raw"' in raw.group() else None
        decode = _Decoder(root.attrib, coded, appended)
        xyz = decode(_found(path, piece.find("Points/DataArray"), "points")).reshape(-1, 3)
        arrays = {
            str(array.get("Name")): decode(array)
            for array in piece.findall("PointData/DataArray")
            if array.get("NumberOfComponents", "1") == "1"
        }
        lines = {str(array.get("Name")): array for array in piece.findall("Lines/DataArray")}
        ends = decode(_found(path, lines.get("offsets"), "lines"))
        connectivity = decode(_found(path, lines.get("connectivity"), "lines"))
    except (ElementTree.ParseError, ValueError, KeyError, zlib.error, IndexError) as error:
        raise BadInput(path, f"is no VTK XML that can be read: {error}"[:200]) from error
    return xyz, arrays, _split(connectivity, ends[:-1])


def _found(path: Path, array: Any, what: str) -> Any:
    if array is None:
        raise BadInput(path, f"has no {what}", "expected a centreline")
    return array


@dataclass(frozen=True)
class _Decoder:
    """Turns DataArrays into numbers: ascii, base64 or appended bytes, with or without zlib."""

    about: dict[str, str]
    raw: bytes | None
    appended: bytes

    def __call__(self, array: Any) -> Array:
        kind = _TYPES[array.attrib["type"]]
        form = array.attrib["format"]
        if form == "ascii":
            return np.array((array.text or "").split(), dtype=np.float64)
        order = "<" if self.about.get("byte_order", "LittleEndian") == "LittleEndian" else ">"
        header = np.dtype(order + _TYPES[self.about.get("header_type", "UInt32")])
        start = int(array.attrib["offset"]) if form == "appended" else 0
        text = (array.text or "").strip().encode() if form == "binary" else self.appended[start:]
        coded = form == "binary" or self.raw is None
        compressor = self.about.get("compressor", "")
        if compressor not in ("", "vtkZLibDataCompressor"):
            raise ValueError(f"{compressor} is not known here; write it with zlib or uncompressed")
        data = self._unzip(text, coded, header) if compressor else self._plain(text, coded, header)
        return np.frombuffer(data, dtype=order + kind).astype(np.float64)

    @staticmethod
    def _take(text: bytes, coded: bool, size: int) -> bytes:
        if not coded:
            return text[:size]
        return base64.b64decode(text[: -(-size // 3) * 4])[:size]

    def _plain(self, text: bytes, coded: bool, header: "np.dtype[Any]") -> bytes:
        size = int(np.frombuffer(self._take(text, coded, header.itemsize), header)[0])
        return self._take(text, coded, header.itemsize + size)[header.itemsize :]

    def _unzip(self, text: bytes, coded: bool, header: "np.dtype[Any]") -> bytes:
        blocks = int(np.frombuffer(self._take(text, coded, header.itemsize), header)[0])
        first = (3 + blocks) * header.itemsize
        sizes = np.frombuffer(self._take(text, coded, first), header)[3:].astype(int)
        rest = text[-(-first // 3) * 4 :] if coded else text[first:]
        data, out = self._take(rest, coded, int(sizes.sum())), b""
        for start, size in zip(np.cumsum(sizes) - sizes, sizes, strict=True):
            out += zlib.decompressobj().decompress(data[start : start + size], MOST_BYTES)
        return out


def _vtk(path: Path, content: bytes) -> Parsed:
    """Return what a legacy file holds, ASCII or BINARY: POINTS, LINES, and SCALARS or FIELD of its point data."""
    head = content[:400].split(b"\n")
    if len(head) < 3 or not head[0].startswith(b"# vtk") or head[2].strip() not in (b"ASCII", b"BINARY"):
        raise BadInput(path, "is no legacy VTK file", "its third line says ASCII or BINARY")
    reader = _Legacy(content, sum(len(line) + 1 for line in head[:3]), head[2].strip() == b"BINARY")
    try:
        found = reader.sections()
    except (ValueError, KeyError, IndexError) as error:
        raise BadInput(path, f"is no VTK file that can be read: {error}"[:200]) from error
    for name in ("POINTS", "LINES"):
        if name not in found:
            raise BadInput(path, f"has no {name}", "expected a centreline")
    flat, cells = found.pop("LINES").astype(np.int64), []
    start = 0
    while start < len(flat):
        cells.append(flat[start + 1 : start + 1 + flat[start]])
        start += 1 + int(flat[start])
    return found.pop("POINTS").reshape(-1, 3), found, [cell for cell in cells if cell.size > 1]


@dataclass
class _Legacy:
    content: bytes
    at: int
    binary: bool

    def line(self) -> list[str]:
        end = self.content.find(b"\n", self.at)
        end = len(self.content) if end < 0 else end
        words = self.content[self.at : end].decode("ascii", errors="replace").split()
        self.at = end + 1
        return words

    def numbers(self, kind: str, count: int) -> Array:
        kind = _LEGACY[kind.lower()]
        if self.binary:
            size = np.dtype(kind).itemsize * count
            if self.at + size > len(self.content):
                raise ValueError(f"{count} numbers are missing at byte {self.at}")
            out = np.frombuffer(self.content, ">" + kind, count, self.at).astype(np.float64)
            self.at += size
            return out
        words: list[str] = []
        while len(words) < count and self.at < len(self.content):
            words += self.line()
        if len(words) != count:
            raise ValueError(f"{len(words)} numbers where {count} are announced")
        return np.array(words, dtype=np.float64)

    def cells(self, count: int, size: int) -> Array:
        """Return lines as a count and its points in turn; version 5 of the format has offsets first."""
        before, words = self.at, self.line()
        if words[:1] != ["OFFSETS"]:
            self.at = before
            return self.numbers("int", size)
        ends = self.numbers(words[1], count).astype(int)
        words = self.line() or self.line()
        parts = np.split(self.numbers(words[1], size), ends[1:-1])
        return np.concatenate([np.append(len(part), part) for part in parts])

    def sections(self) -> dict[str, Array]:
        found: dict[str, Array] = {}
        points, in_points = 0, False
        while self.at < len(self.content):
            match self.line():
                case ["POINTS", count, kind]:
                    points = int(count)
                    found["POINTS"] = self.numbers(kind, 3 * points)
                case ["LINES", cells, size]:
                    found["LINES"] = self.cells(int(cells), int(size))
                case ["POINT_DATA", _]:
                    in_points = True
                case ["CELL_DATA", _]:
                    in_points = False
                case ["SCALARS", name, kind, *_] if in_points:
                    self.line()  # LOOKUP_TABLE
                    found[name] = self.numbers(kind, points)
                case ["FIELD", _, arrays] if in_points:
                    for _ in range(int(arrays)):
                        name, width, count, kind = self.line()
                        values = self.numbers(kind, int(width) * int(count))
                        if int(width) == 1:
                            found[name] = values
                case ["VERTICES" | "POLYGONS" | "TRIANGLE_STRIPS", _, size]:
                    self.numbers("int", int(size))
        return found
