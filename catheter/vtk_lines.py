"""Points, their arrays and the lines through them in VTK's polygon data, XML or legacy, read without VTK."""

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
from data.signal import Array

MOST_BYTES = 1 << 28
_TYPES = {"Float32": "f4", "Float64": "f8", "Int32": "i4", "Int64": "i8", "UInt8": "u1", "UInt32": "u4", "UInt64": "u8"}
_LEGACY = {"float": "f4", "double": "f8", "int": "i4", "vtktypeint64": "i8", "long": "i8", "unsigned_char": "u1"}

Parsed = tuple[Array, dict[str, Array], list[NDArray[np.int64]]]  # points, arrays by name, lines


def read_vtp(path: Path, content: bytes) -> Parsed:
    """Return what an XML file holds: ascii, base64 or appended, with or without zlib. Raises BadInput."""
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
    parts = np.split(_whole(path, connectivity), _whole(path, ends[:-1]))
    return xyz, arrays, [part for part in parts if part.size > 1]


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


def read_vtk(path: Path, content: bytes) -> Parsed:
    """Return what a legacy file holds, ASCII or BINARY: POINTS, LINES, SCALARS and FIELD. Raises BadInput."""
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
    cells, start, numbers = [], 0, found.pop("LINES")
    while start < len(numbers):
        count = numbers[start]
        if not 0 <= count < len(numbers) - start:  # nor for NaN
            raise BadInput(path, f"has a line of {count:g} points in LINES", f"{len(numbers) - start - 1} follow")
        cells.append(_whole(path, numbers[start + 1 : start + 1 + int(count)]))
        start += 1 + int(count)
    return found.pop("POINTS").reshape(-1, 3), found, [cell for cell in cells if cell.size > 1]


def _whole(path: Path, numbers: Array) -> NDArray[np.int64]:
    """Return numbers of points. Raises BadInput for what is none."""
    if not (np.abs(numbers) < MOST_BYTES).all():  # nor for NaN
        raise BadInput(path, f"has a line of points {numbers}"[:120], "expected their numbers, from 0")
    return numbers.astype(np.int64)


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

    def heading(self) -> list[str]:
        """Return the next line with words, past the METADATA that VTK writes behind an array, up to an empty line."""
        words = self.line()
        while self.at < len(self.content) and (not words or words == ["METADATA"]):
            while words:
                words = self.line()
            words = self.line()
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
        words = self.heading()
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
                        name, width, count, kind = self.heading()
                        values = self.numbers(kind, int(width) * int(count))
                        if int(width) == 1:
                            found[name] = values
                case ["VERTICES" | "POLYGONS" | "TRIANGLE_STRIPS", _, size]:
                    self.numbers("int", int(size))
        return found
