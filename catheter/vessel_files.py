"""Centrelines as other tools write them: CSV, VTK's XML (.vtp) and legacy (.vtk) polygon data.

Read without VTK: points, one array for each, and the lines that join them. Units come later.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from catheter.vtk_lines import MOST_BYTES, read_vtk, read_vtp
from data.errors import BadInput
from data.files import open_regular
from data.signal import Array

RADII = ("maximuminscribedsphereradius", "radius", "r")  # the first is what VMTK writes


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
        xyz, arrays, lines = read_vtp(path, content) if path.suffix.lower() == ".vtp" else read_vtk(path, content)
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
