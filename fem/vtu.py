"""Deformed meshes for ParaView: VTK's XML format for unstructured grids, written without VTK."""

import base64
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from data.files import check_free, fresh
from fem.continuation import PRESSURE
from fem.tube import Inflation

HEXAHEDRON, QUADRATIC_HEXAHEDRON = 12, 25  # vtkCellType.h
_NAMES = {"f8": "Float64", "i4": "Int32", "i8": "Int64", "u1": "UInt8"}


def write_vtu(run: Inflation, path: Path, index: int = -1, *, force: bool = False) -> None:
    """Write one load's mesh at rest with its displacement [m], and numbers by cell.

    They are voxel, shear modulus [Pa], stretch, and whether that is past the material's elongation.
    ParaView shows it deformed by "Warp by Vector". Raises CannotWrite.
    """
    body, x = run.system.body, run.points[index].x
    mesh = body.mesh
    stretch = np.linalg.norm(body.deformation(x), ord=2, axis=(-2, -1)).max(axis=1)
    laws = [*run.tube.material.ravel(), run.tube.cap_material]
    shear = np.array([law.shear for law in laws])[mesh.part]
    limit = np.array([law.elongation for law in laws])[mesh.part]
    kind = HEXAHEDRON if mesh.order == 1 else QUADRATIC_HEXAHEDRON
    count, width = mesh.hexes.shape
    over = (stretch - 1 > limit).astype(np.uint8)
    cells = {
        "connectivity": mesh.hexes.ravel(),
        "offsets": np.arange(1, count + 1, dtype=np.int64) * width,
        "types": np.full(count, kind, dtype=np.uint8),
    }
    parts = [
        ("PointData", {"displacement": x - mesh.nodes}),
        ("CellData", {"voxel": mesh.part, "shear_modulus": shear, "stretch": stretch, "overstretched": over}),
        ("Points", {"position": mesh.nodes}),
        ("Cells", cells),
    ]
    inside = "".join(
        f"<{tag}>" + "".join(_array(name, values) for name, values in arrays.items()) + f"</{tag}>\n"
        for tag, arrays in parts
    )
    text = (
        '<?xml version="1.0"?>\n'
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
        f'<UnstructuredGrid><Piece NumberOfPoints="{len(mesh.nodes)}" NumberOfCells="{count}">\n'
        f"{inside}</Piece></UnstructuredGrid></VTKFile>\n"
    )
    with fresh(path, force) as temporary:
        temporary.write_text(text, encoding="ascii")


def _array(name: str, values: NDArray[np.generic]) -> str:
    little = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
    size = np.array([little.nbytes], dtype="<u8").tobytes()
    width = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    text = base64.b64encode(size + little.tobytes()).decode("ascii")
    kind = _NAMES[values.dtype.str[1:]]
    return f'<DataArray type="{kind}" Name="{name}"{width} format="binary">{text}</DataArray>'


def write_pvd(run: Inflation, path: Path, *, force: bool = False) -> list[Path]:
    """Write every load as NAME.0.vtu, NAME.1.vtu ... and a collection NAME.pvd whose time is the pressure [Pa].

    Under volume control, where the pressure may fall, the time is the cavity volume [m^3]. Returns
    the files. Raises CannotWrite.
    """
    parts = [path.with_name(f"{path.stem}.{k}.vtu") for k in range(len(run.points))]
    check_free(path, force)
    for part in parts:
        check_free(part, force)
    for k, part in enumerate(parts):
        write_vtu(run, part, k, force=force)
    times = run.pressure if run.control == PRESSURE else run.volume
    sets = "".join(
        f'<DataSet timestep="{float(time)!r}" part="0" file={quoteattr(part.name)}/>\n'
        for time, part in zip(times, parts, strict=True)
    )
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">'
    text = f"{head}<Collection>\n{sets}</Collection></VTKFile>\n"
    with fresh(path, force) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return [path, *parts]
