"""A printable tube as a file: its sizes, its materials, and which voxel is which.

title = "a wrap"
length = "32 mm"            # of the tube, without its caps
outer_radius = "5 mm"
wall = "1 mm"
cap = "2 mm"                # a disc beyond each end, 0 for none
hole = "4.04 mm"            # through each cap
cap_material = "Vero"
rows = ["aab...", ...]      # one text for each ring of voxels from the base; letters anticlockwise from x

[materials]
a = "Agilus30"              # thesis Table 5.1, or a rigid Vero
b = "FLX9785"
"""

import string
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput, nearest
from data.files import fresh
from data.options import find_toml, load_toml, option, read
from data.signal import Array
from data.table import table
from fem.solid import EMPTY, Solid

FOLDER = Path(__file__).parents[1] / "data" / "maps"
MM = 1e-3
TAP_DRILL = 4.04 * MM  # number 21, for a 10-32 thread
UNCERTAIN = ("FLX9785", "FLX9795")  # no fit is named for their c1, and four specimens of the first scatter (Fig. 5.4)
RIGID = ("Vero", "VeroWhite", "VeroBlack", "VeroClear")
LETTERS = string.ascii_letters + string.digits
MOST = 512  # voxels around or along


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """A tube and its caps [m]. hole: diameter of the drill that fits through a cap (10-32 tap: 4.04 mm)."""

    length: float = option(32 * MM, unit="m", least=1e-4)
    outer_radius: float = option(5 * MM, unit="m", least=1e-4)
    wall: float = option(1 * MM, unit="m", least=1e-5)
    cap: float = option(2 * MM, unit="m", least=0.0)
    hole: float = option(TAP_DRILL, unit="m", least=1e-5)
    cap_material: str = "Vero"


@dataclass(frozen=True, kw_only=True)
class _File:
    title: str
    rows: tuple[str, ...]
    length: float = option(32 * MM, unit="m", least=1e-4)
    outer_radius: float = option(5 * MM, unit="m", least=1e-4)
    wall: float = option(1 * MM, unit="m", least=1e-5)
    cap: float = option(2 * MM, unit="m", least=0.0)
    hole: float = option(TAP_DRILL, unit="m", least=1e-5)
    cap_material: str = "Vero"


@dataclass(frozen=True, kw_only=True, eq=False)
class VoxelMap:
    """Voxels (around, along) of a tube: numbers of `materials`; the caps are of `sizes.cap_material`."""

    title: str
    sizes: Sizes
    materials: tuple[str, ...]
    voxels: NDArray[np.int64]

    def __post_init__(self) -> None:
        """Refuse what makes no printable tube."""
        s, counts = self.sizes, self.voxels.shape
        if self.voxels.ndim != 2 or not 3 <= counts[0] <= MOST or not 1 <= counts[1] <= MOST:
            raise BadInput(f"map {self.title!r}", f"has {counts} voxels", f"expected 3 to {MOST} around, 1 along")
        if self.voxels.min() < 0 or self.voxels.max() >= len(self.materials):
            raise BadInput(f"map {self.title!r}", "has a voxel without a material", "every voxel needs one")
        if not s.wall < s.outer_radius:
            raise BadInput(f"map {self.title!r}, wall", f"is {s.wall:g} m", f"expected less than {s.outer_radius:g} m")
        room = s.outer_radius - s.wall
        reach = s.hole / 2 / np.cos(np.pi / counts[0])
        if s.cap and not reach < room:
            found = f"is {s.hole:g} m: its polygon of {counts[0]} sides reaches {reach:g} m from the axis"
            raise BadInput(f"map {self.title!r}, hole", found, f"expected less than the bore's {room:g} m")
        known = [*table("5.1").rows, *RIGID]
        for name in self.parts:
            if name not in known:
                raise BadInput(f"map {self.title!r}, material {name!r}", "is not known", nearest(name, known))
            if name not in RIGID:
                table("5.1").value(name, "c1")  # which says why there is none, for a material nobody has fitted

    @property
    def parts(self) -> tuple[str, ...]:
        """The materials that are there, caps included: what a printer is given one file each for."""
        used = [self.materials[k] for k in np.unique(self.voxels)]
        return tuple(dict.fromkeys([*used, *([self.sizes.cap_material] if self.sizes.cap else [])]))

    def cells(self) -> NDArray[np.int64]:
        """Return the numbers in `parts` of all cells (around, along + caps, 2): disc and wall."""
        number = np.array([self.parts.index(m) if m in self.parts else EMPTY for m in self.materials])
        wall = number[self.voxels]
        if not self.sizes.cap:
            return wall[..., None]
        lid = np.full((len(wall), 1), self.parts.index(self.sizes.cap_material))
        disc = np.hstack([lid, np.full_like(wall, EMPTY), lid])
        return np.stack([disc, np.hstack([lid, wall, lid])], axis=2)

    def solid(self) -> Solid:
        """Return the tube with its caps beyond its ends, in mm; base ring at z = 0, voxel 0 from x on.

        A ring is a polygon with a corner between any two voxels, on the outer and inner radius. The
        hole's polygon is drawn around the drill's circle.
        """
        s, (around, along) = self.sizes, self.voxels.shape
        angle = 2 * np.pi * np.arange(around) / around
        z = s.length * np.arange(along + 1) / along
        radii = [s.outer_radius - s.wall, s.outer_radius]
        if s.cap:
            z = np.concatenate([[-s.cap], z, [s.length + s.cap]])
            radii = [s.hole / 2 / np.cos(np.pi / around), *radii]
        return Solid(tube_positions(angle, z, np.array(radii)) / MM, self.cells())


def tube_positions(angle: Array, z: Array, radii: Array) -> Array:
    """Return positions (around, along, through, 3) [m] of a straight tube."""
    out = np.empty((len(angle), len(z), len(radii), 3))
    out[..., 0] = np.cos(angle)[:, None, None] * radii
    out[..., 1] = np.sin(angle)[:, None, None] * radii
    out[..., 2] = z[:, None]
    return out


def palette(made: VoxelMap) -> list[tuple[int, int, int]]:
    """Return a colour for each part, pale for soft to dark for stiff; rigid ones blue. All differ, none is black."""
    shore = {name: row["shore_a"].si for name, row in table("5.1").rows.items()}
    order = sorted((part for part in made.parts if part in shore), key=lambda part: shore[part])
    soft, stiff = np.array([245.0, 222.0, 179.0]), np.array([90.0, 20.0, 30.0])
    shades = [soft + (stiff - soft) * k / max(len(order) - 1, 1) for k in range(len(order))]
    colours = {part: (int(r), int(g), int(b)) for part, (r, g, b) in zip(order, shades, strict=True)}
    rigid = [part for part in made.parts if part not in shore]
    colours |= {part: (60, 110 + 25 * k, 190) for k, part in enumerate(rigid)}
    return [colours[part] for part in made.parts]


def load_map(name: str | Path) -> VoxelMap:
    """Return a shipped map by name, or one from a .toml file. Raises BadInput naming file, key, row and letter."""
    path = find_toml(name, FOLDER, "map")
    tables, _ = load_toml(path)
    letters: Any = tables.pop("materials", {})
    if not isinstance(letters, dict) or not letters or not all(isinstance(x, str) for x in letters.values()):
        raise BadInput(f"{path}, [materials]", "is no table of names", 'expected letters, as a = "Agilus30"')
    for letter in letters:
        if len(letter) != 1:
            raise BadInput(f"{path}, [materials], {letter!r:.40}", "is no single letter")
    found = read(_File, tables, str(path))
    known = "".join(letters)
    for number, row in enumerate(found.rows):
        if len(row) != len(found.rows[0]):
            raise BadInput(f"{path}, rows[{number}]", f"has {len(row)} voxels", f"the first has {len(found.rows[0])}")
        wrong = next((letter for letter in row if letter not in known), None)
        if wrong is not None:
            raise BadInput(f"{path}, rows[{number}]", f"has {wrong!r}", f"[materials] has {', '.join(known)}")
    voxels = np.array([[known.index(letter) for letter in row] for row in found.rows], dtype=np.int64)
    sizes = Sizes(**{name: value for name, value in vars(found).items() if name not in ("title", "rows")})
    if not voxels.size:
        raise BadInput(f"{path}, rows", "are empty", "expected a text of letters for each ring")
    return VoxelMap(title=found.title, sizes=sizes, materials=tuple(letters.values()), voxels=voxels.T.copy())


def write_map(made: VoxelMap, path: Path, *, force: bool = False) -> None:
    """Write a map as a file that `load_map` reads back equal. Raises CannotWrite, BadInput past 62 materials."""
    import json

    if len(made.materials) > len(LETTERS):
        raise BadInput("map", f"has {len(made.materials)} materials", f"a file has letters for {len(LETTERS)}")
    s = made.sizes
    lines = [f"title = {json.dumps(made.title)}"]
    lines += [f'{name} = "{getattr(s, name) / MM!r} mm"' for name in ("length", "outer_radius", "wall", "cap", "hole")]
    lines += [f"cap_material = {json.dumps(s.cap_material)}", "rows = ["]
    lines += [f'    "{"".join(LETTERS[k] for k in ring)}",' for ring in made.voxels.T]
    lines += ["]", "", "[materials]"]
    lines += [f"{letter} = {json.dumps(name)}" for letter, name in zip(LETTERS, made.materials, strict=False)]
    with fresh(path, force) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
