"""A tube's voxel map as pictures of its layers, for printers that are told every drop.

Each pixel is of the material at its middle, in the material's colour; black is empty. The wall is
round here, where the surfaces of fem.solid are polygons.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput, CatheterError
from data.files import cannot_write, fresh
from data.options import option
from fem.solid import EMPTY
from fem.voxel_map import VoxelMap, palette

Picture = NDArray[np.uint8]
MOST = 10_000  # pixels across


@dataclass(frozen=True, kw_only=True)
class Resolution:
    """Size of a pixel and height of a layer [m]; by default 600 dots an inch and 27 um, as PolyJet prints."""

    pixel: float = option(25.4e-3 / 600, unit="m", least=1e-6)
    layer: float = option(27e-6, unit="m", least=1e-6)


@dataclass(frozen=True, kw_only=True)
class Sliced:
    """The layers that were written, their size in pixels, and the voxels of each material found in them."""

    folder: Path
    layers: int
    pixels: int
    resolution: Resolution
    voxels: dict[str, int]


@dataclass(frozen=True, eq=False)
class Layers:
    """The layers of a map at a resolution."""

    made: VoxelMap
    resolution: Resolution

    @cached_property
    def heights(self) -> NDArray[np.float64]:
        """The middle of each layer over the base ring [m], from the lower cap up."""
        total = self.made.sizes.length + 2 * self.made.sizes.cap
        count = max(1, round(total / self.resolution.layer))
        return np.asarray((np.arange(count) + 0.5) * self.resolution.layer - self.made.sizes.cap, dtype=np.float64)

    @cached_property
    def rows(self) -> NDArray[np.int64]:
        """The ring of voxels each layer lies in: -1 the lower cap, the number of rings the upper one."""
        along = self.made.voxels.shape[1]
        row = np.floor(self.heights / self.made.sizes.length * along).astype(np.int64)
        return np.asarray(np.clip(row, *self._span))

    @property
    def _span(self) -> tuple[int, int]:
        along = self.made.voxels.shape[1]
        return (-1, along) if self.made.sizes.cap else (0, along - 1)

    @cached_property
    def _polar(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Distance from the axis of each pixel's middle, and the column of voxels it lies in; +y is up."""
        count = int(np.ceil(2 * self.made.sizes.outer_radius / self.resolution.pixel))
        if not 4 <= count <= MOST:
            found = f"is {self.resolution.pixel:g} m: {count} across"
            raise BadInput("resolution, pixel", found, f"expected 4 to {MOST} across")
        at = (np.arange(count) + 0.5 - count / 2) * self.resolution.pixel
        x, y, around = at[None, :], -at[:, None], len(self.made.voxels)
        turn = np.arctan2(y, x) % (2 * np.pi)
        return np.hypot(x, y), np.minimum((turn / (2 * np.pi) * around).astype(np.int64), around - 1)

    @cached_property
    def wall(self) -> NDArray[np.bool_]:
        """Which pixels lie in the wall."""
        s, r = self.made.sizes, self._polar[0]
        return np.asarray((r >= s.outer_radius - s.wall) & (r <= s.outer_radius))

    @cached_property
    def columns(self) -> NDArray[np.int64]:
        """The voxel around of each pixel in the wall (n,)."""
        return self._polar[1][self.wall]

    def numbers(self, row: int) -> NDArray[np.int64]:
        """Return the number in `parts` of each pixel in a ring of voxels or a cap, EMPTY outside."""
        made, s = self.made, self.made.sizes
        out = np.full(self.wall.shape, EMPTY)
        if 0 <= row < made.voxels.shape[1]:
            number = np.array([made.parts.index(m) if m in made.parts else EMPTY for m in made.materials])
            out[self.wall] = number[made.voxels[self.columns, row]]
        else:
            r = self._polar[0]
            out[(r >= s.hole / 2) & (r <= s.outer_radius)] = made.parts.index(s.cap_material)
        return out


def write_slices(
    made: VoxelMap,
    folder: Path,
    resolution: Resolution,
    *,
    force: bool = False,
    progress: Callable[[float], None] = lambda _: None,
) -> Sliced:
    """Write layer_00000.png ... from the lower cap up, and read each back. Raises CannotWrite.

    Raises CatheterError when a voxel is found to be of another material, or too small for a pixel.
    """
    import cv2

    layers = Layers(made, resolution)
    colours = np.array([(0, 0, 0), *palette(made)], dtype=np.uint8)[:, ::-1]  # cv2 has blue first
    pictures = {
        row: cv2.imencode(".png", colours[layers.numbers(row) + 1])[1].tobytes() for row in np.unique(layers.rows)
    }
    counted: dict[bytes, NDArray[np.int64]] = {}  # layers of one ring are the same file many times
    count = np.zeros((made.voxels.shape[1], len(made.parts), len(made.voxels)), dtype=np.int64)
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error) from error
    for number, row in enumerate(layers.rows.tolist()):
        path = folder / f"layer_{number:05d}.png"
        with fresh(path, force) as temporary:
            temporary.write_bytes(pictures[row])
        if 0 <= row < len(count):
            content = path.read_bytes()
            if content not in counted:
                picture = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_COLOR)
                counted[content] = _counted(picture, layers, colours)
            count[row] += counted[content]
        progress((number + 1) / len(layers.rows))
    return Sliced(
        folder=folder,
        layers=len(layers.rows),
        pixels=len(layers.wall),
        resolution=resolution,
        voxels=_compared(made, folder, count),
    )


def _counted(picture: Any, layers: Layers, colours: Picture) -> NDArray[np.int64]:
    """Return the pixels of each material in each voxel of a ring (parts, around)."""
    code = picture[layers.wall].astype(np.int64) @ [1, 256, 65536]
    known = colours[1:].astype(np.int64) @ [1, 256, 65536]
    around = len(layers.made.voxels)
    return np.stack([np.bincount(layers.columns[code == colour], minlength=around) for colour in known])


def _compared(made: VoxelMap, folder: Path, count: NDArray[np.int64]) -> dict[str, int]:
    """Return the voxels of each material that the layers show, once they are the map's."""
    wanted = np.array([made.parts.index(name) if name in made.parts else -1 for name in made.materials])[made.voxels]
    if (count.sum(axis=1) == 0).any():
        raise CatheterError(f"{folder}: some voxel has no pixel of its own; ask for smaller pixels or layers")
    if (np.count_nonzero(count, axis=1) != 1).any() or (wanted != count.argmax(axis=1).T).any():
        raise CatheterError(f"{folder}: the layers read back as another map; this is a fault of the writer")
    return {part: int((count.argmax(axis=1) == k).sum()) for k, part in enumerate(made.parts)}
