"""Files a printer takes, each read back after it is written: STL, 3MF, slices.

Lengths in the files are mm. STL holds no unit and no name: the file's name is the material's.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from data.errors import CatheterError
from data.files import fresh
from fem.readback import voxels_inside
from fem.solid import Solid, Surface, enclosed
from fem.voxel_map import MM, VoxelMap, palette

XML = '<?xml version="1.0" encoding="UTF-8"?>\n'
CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
MATERIAL = "http://schemas.microsoft.com/3dmanufacturing/material/2015/02"
PACKAGE = "http://schemas.openxmlformats.org/package/2006"
TYPES = (
    f'{XML}<Types xmlns="{PACKAGE}/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>'
)
RELATIONS = (
    f'{XML}<Relationships xmlns="{PACKAGE}/relationships"><Relationship Id="rel0" Target="/3D/3dmodel.model"'
    ' Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
)
FIRST = 3  # the number of the first object: 1 are the materials, 2 the colours


@dataclass(frozen=True, kw_only=True)
class Written:
    """One material in one file, as it was read back: volume [mm^3] and its voxels (those of the caps aside)."""

    path: Path
    material: str
    triangles: int
    volume: float
    design: float
    voxels: int

    @property
    def error(self) -> float:
        """Relative difference of the volume that was read from the design's."""
        return abs(self.volume / self.design - 1)


@dataclass(frozen=True, kw_only=True)
class Printed:
    """What was written. closure: the sum of the files' volumes over the solid's, less 1.

    rounded: the solid's volume over that of the unrounded tube, less 1: floats of four bytes. edges:
    how many edges between voxels of one material were opened, see fem.solid.
    """

    stl: tuple[Written, ...]
    mf: tuple[Written, ...]
    closure: float
    rounded: float
    edges: int


def names(made: VoxelMap, folder: Path, stem: str) -> dict[str, Path]:
    """Return the STL file of each material."""
    return {part: folder / f"{stem}_{part.replace(' ', '_')}.stl" for part in made.parts}


def write_prints(
    made: VoxelMap, folder: Path, stem: str, *, force: bool = False, progress: Callable[[float], None] = lambda _: None
) -> Printed:
    """Write an STL for each material and one 3MF of all, and read them back.

    Raises CannotWrite, and CatheterError when what is read is not what was designed.
    """
    solid = made.solid()
    surfaces = [solid.surface([k]) for k in range(len(made.parts))]
    progress(0.2)
    stl = []
    for (part, path), surface in zip(names(made, folder, stem).items(), surfaces, strict=True):
        write_stl(surface, path, force=force)
        stl.append(_checked(made, part, path, read_stl(path), surface))
        progress(0.2 + 0.4 * len(stl) / len(surfaces))
    whole = solid.surface(range(len(made.parts))).volume
    mf = _write_and_check_3mf(made, folder / f"{stem}.3mf", surfaces, force=force)
    progress(1.0)
    return Printed(
        stl=tuple(stl),
        mf=tuple(mf),
        closure=sum(w.volume for w in stl) / whole - 1,
        rounded=whole / unrounded(solid) - 1,
        edges=int((solid.opened > 0).sum()),
    )


def unrounded(solid: Solid) -> float:
    """Return the volume of a solid's cells before rounding, each cell from its own eight corners."""
    p = solid.positions
    q = np.roll(p, -1, axis=0)
    a, b, c, d = p[:, :-1], q[:, :-1], q[:, 1:], p[:, 1:]
    low, high = [x[:, :, :-1] for x in (a, b, c, d)], [x[:, :, 1:] for x in (a, b, c, d)]
    quads = [(low[3], low[2], low[1], low[0]), tuple(high)]
    quads += [(low[k], low[(k + 1) % 4], high[(k + 1) % 4], high[k]) for k in range(4)]
    middle = sum(low[1:], low[0]) / 8 + sum(high[1:], high[0]) / 8
    total = np.zeros(solid.cells.shape)
    for quad in quads:  # two triangles each, seen from the cell's middle
        w, x, y, z = (corner - middle for corner in quad)
        total += ((w * np.cross(x, y)).sum(axis=-1) + (w * np.cross(y, z)).sum(axis=-1)) / 6
    return float(total[solid.cells >= 0].sum())


def write_stl(surface: Surface, path: Path, *, force: bool = False) -> None:
    """Write a surface as binary STL. Raises CannotWrite."""
    import trimesh

    mesh = trimesh.Trimesh(surface.points, surface.triangles, process=False)
    with fresh(path, force) as temporary:
        mesh.export(temporary, file_type="stl")


def read_stl(path: Path) -> Any:
    """Return the mesh of a binary STL as trimesh reads it: equal corners joined."""
    import trimesh

    return trimesh.load_mesh(path, file_type="stl")


def _checked(made: VoxelMap, part: str, path: Path, mesh: Any, surface: Surface) -> Written:
    """Return what was read, once it is closed and its volume and voxels are the design's."""
    corners = np.asarray(mesh.triangles)
    found = voxels_inside(corners * MM, made)
    wanted = np.array([name == part for name in made.materials])[made.voxels]
    written = Written(
        path=path,
        material=part,
        triangles=len(corners),
        volume=enclosed(corners),
        design=surface.volume,
        voxels=int(found.sum()),
    )
    faces, count = np.sort(mesh.faces, axis=1).astype(np.int64), len(mesh.vertices)
    twice = len(faces) - len(np.unique((faces[:, 0] * count + faces[:, 1]) * count + faces[:, 2]))
    closed = mesh.is_watertight and mesh.is_volume
    if not closed or (found != wanted).any() or written.error > 1e-9 or twice:
        raise CatheterError(
            f"{path}: {part} reads back {'closed' if closed else 'open'}, with {int((found != wanted).sum())} voxels"
            f" that differ, {twice} faces twice and a volume {written.error:.1e} off; this is a fault of the writer"
        )
    return written


def _write_and_check_3mf(made: VoxelMap, path: Path, surfaces: list[Surface], *, force: bool = False) -> list[Written]:
    write_3mf(made, path, surfaces, force=force)
    found = read_3mf(path)
    if list(found) != list(made.parts):
        raise CatheterError(f"{path}: reads back with objects {', '.join(found)}; a fault of the writer, keep the map")
    return [_checked(made, part, path, found[part], s) for part, s in zip(found, surfaces, strict=True)]


def write_3mf(made: VoxelMap, path: Path, surfaces: list[Surface], *, force: bool = False) -> None:
    """Write one object for each material, named by it. Raises CannotWrite.

    The object's own property is its base material; its triangles carry the same colour from a colour
    group. So tools that look at either find it. Every digit is written: lib3mf's writer rounds in
    four bytes once more, and what it writes reads back up to 2 nm away.
    """
    import zipfile

    colours = ["#{:02X}{:02X}{:02X}".format(*colour) for colour in palette(made)]
    bases = "".join(f'<base name={quoteattr(p)} displaycolor="{c}"/>' for p, c in zip(made.parts, colours, strict=True))
    groups = "".join(f'<m:color color="{colour}"/>' for colour in colours)
    objects = "".join(_object(k, part, surfaces[k]) for k, part in enumerate(made.parts))
    items = "".join(f'<item objectid="{FIRST + k}"/>' for k in range(len(surfaces)))
    model = (
        f'{XML}<model unit="millimeter" xml:lang="en-US" xmlns="{CORE}" xmlns:m="{MATERIAL}"><resources>'
        f'<basematerials id="1">{bases}</basematerials><m:colorgroup id="2">{groups}</m:colorgroup>'
        f"{objects}</resources><build>{items}</build></model>"
    )
    with fresh(path, force) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("[Content_Types].xml", TYPES)
        archive.writestr("_rels/.rels", RELATIONS)
        archive.writestr("3D/3dmodel.model", model)


def _object(number: int, part: str, surface: Surface) -> str:
    used, inverse = np.unique(surface.triangles, return_inverse=True)
    vertices = "".join(f'<vertex x="{x!r}" y="{y!r}" z="{z!r}"/>' for x, y, z in surface.points[used].tolist())
    faces = "".join(
        f'<triangle v1="{a}" v2="{b}" v3="{c}" pid="2" p1="{number}"/>' for a, b, c in inverse.reshape(-1, 3).tolist()
    )
    return (
        f'<object id="{FIRST + number}" name={quoteattr(part)} type="model" pid="1" pindex="{number}"><mesh>'
        f"<vertices>{vertices}</vertices><triangles>{faces}</triangles></mesh></object>"
    )


def read_3mf(path: Path) -> dict[str, Any]:
    """Return the mesh [mm] of each object by its name, as trimesh reads it."""
    import trimesh

    scene = trimesh.load_scene(path, file_type="3mf")
    return dict(scene.geometry)
