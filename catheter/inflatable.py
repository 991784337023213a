"""A printed tube as a scene describes it: shape, voxel map of two materials, loads."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput
from data.options import option
from data.signal import Array

if TYPE_CHECKING:
    from fem.tube import Inflation, Tube

MM, KPA = 1e-3, 1e3
MOST_ELEMENTS = 100_000  # beyond it, 24 GB of memory do not hold the tangent's factor


@dataclass(frozen=True, kw_only=True)
class Shape:
    """A tube from its fixed base to its cap [m], and how finely it is divided (around, along, through the wall).

    cap: thickness of an elastic disc of 2 GPa, 0 for a rigid cap. nodes: 8 or 20 of an element.
    """

    length: float = option(32 * MM, unit="m", least=1e-6)
    outer_radius: float = option(5 * MM, unit="m", least=1e-6)
    wall: float = option(1 * MM, unit="m", least=1e-7)
    cap: float = option(0.0, unit="m", least=0.0)
    divisions: tuple[int, ...] = option((32, 32, 2), least=1, most=512)
    voxels: tuple[int, ...] = option((32, 32), least=1, most=512)
    nodes: str = option("8", choices=("8", "20"))
    nu: float = option(0.499, least=0.0, most=0.499999)


@dataclass(frozen=True, kw_only=True)
class Pattern:
    """Where the stiff of two printable materials goes; i counts voxels around, j along.

    soft, stiff: names of thesis Table 5.1, or files of fits (.toml), which count from the working
    folder. helix: (i - j) mod period < width, a right-handed wrap, which twists clockwise as seen from
    +z; strip: i < width; rings: j mod period < width; bender: strip and rings together; uniform: nowhere.
    graded: the helix without an edge, the logarithm of c1 a cosine of i - j from the soft material's
    to the stiff one's: of no printable set. rows: as drawn, a text for each ring from the base, its letters
    anticlockwise from x, "a" soft and "b" stiff.
    """

    soft: str = "Agilus30"
    stiff: str = "FLX9785"
    pattern: str = option("uniform", choices=("uniform", "helix", "strip", "rings", "bender", "graded", "rows"))
    period: int = option(16, least=1)
    width: int = option(4, least=0)
    rows: tuple[str, ...] = ()

    def stiff_voxels(self, around: int, along: int) -> NDArray[np.bool_]:
        """Return which voxels are stiff (around, along). Raises BadInput for rows of other voxels."""
        if (self.pattern == "rows") != bool(self.rows):
            raise BadInput("map, rows", f"has {len(self.rows)}, pattern {self.pattern!r}", 'they are for "rows"')
        if self.rows:
            return _drawn(self.rows, around, along)
        i, j = np.indices((around, along))
        strip, rings = i < self.width, j % self.period < self.width
        found = {
            "uniform": np.zeros((around, along), dtype=bool),
            "graded": (i - j + self.period / 4) % self.period < self.period / 2,
            "helix": (i - j) % self.period < self.width,
            "strip": strip,
            "rings": rings,
            "bender": strip | rings,
        }
        return found[self.pattern]

    def moduli(self, around: int, along: int) -> Array:
        """Return c1 of each voxel (around, along) [Pa]. Raises BadInput for materials without c1."""
        from fem.material import printable

        soft, stiff = printable(self.soft).c1, printable(self.stiff).c1
        if self.pattern != "graded":
            return np.where(self.stiff_voxels(around, along), stiff, soft)
        i, j = np.indices((around, along))
        share = (1 + np.cos(2 * np.pi * (i - j) / self.period)) / 2
        return np.asarray(soft * (stiff / soft) ** share)


def _drawn(rows: tuple[str, ...], around: int, along: int) -> NDArray[np.bool_]:
    for number, row in enumerate(rows):
        if len(row) != around or set(row) - {"a", "b"}:
            raise BadInput(f"map, rows[{number}]", f"is {row!r:.80}", f"expected {around} letters a and b")
    if len(rows) != along:
        raise BadInput("map, rows", f"has {len(rows)} rings", f"expected {along}")
    return np.array([[letter == "b" for letter in row] for row in rows]).T


def drawn(pattern: Pattern, stiff: NDArray[np.bool_]) -> Pattern:
    """Return the map of a pattern's materials in which these voxels (around, along) are stiff."""
    rows = tuple("".join("ab"[int(one)] for one in ring) for ring in stiff.T)
    return Pattern(soft=pattern.soft, stiff=pattern.stiff, pattern="rows", rows=rows)


@dataclass(frozen=True, kw_only=True)
class Path:
    """The loads in turn: pressures [Pa], or cavity volumes over the volume at rest; exactly these are solved."""

    pressures: tuple[float, ...] = option((), unit="Pa")
    volume_ratios: tuple[float, ...] = option((), least=1e-3)
    tolerance: float = option(1e-8, least=1e-12, most=1e-3)


def build(shape: Shape, pattern: Pattern, path: Path) -> "Tube":
    """Return the tube of a scene. Raises BadInput for what makes no tube, and for materials without c1."""
    from catheter.material import material as named
    from fem.equilibrium import Newton
    from fem.material import NeoHooke
    from fem.tube import Tube

    if len(shape.divisions) != 3 or len(shape.voxels) != 2:
        raise BadInput("tube", f"divisions {shape.divisions}, voxels {shape.voxels}", "expected 3 and 2 numbers")
    if (count := int(np.prod(shape.divisions))) > MOST_ELEMENTS:
        raise BadInput(
            "tube, divisions", f"{shape.divisions}: {count:,} elements", f"at most {MOST_ELEMENTS:,} are solved"
        )
    around, along = shape.voxels
    material = np.full((around, along), named(pattern.soft, nu=shape.nu), dtype=object)
    stiff = pattern.stiff_voxels(around, along)
    if pattern.pattern == "graded":
        laws = [NeoHooke(c1=c1, nu=shape.nu) for c1 in pattern.moduli(around, along).ravel().tolist()]
        material.ravel()[:] = laws
    elif stiff.any():
        material[stiff] = named(pattern.stiff, nu=shape.nu)
    return Tube(
        length=shape.length,
        outer_radius=shape.outer_radius,
        wall=shape.wall,
        cap=shape.cap,
        divisions=(shape.divisions[0], shape.divisions[1], shape.divisions[2]),
        material=material,
        order=1 if shape.nodes == "8" else 2,
        newton=Newton(tolerance=path.tolerance),
    )


def otherwise(tube: "Tube", stiff: NDArray[np.bool_], soft_factor: float, stiff_factor: float) -> "Tube":
    """Return a tube whose two materials, told apart by `stiff` (around, along), are stiffer by these factors."""
    from fem.material import scaled

    material = np.empty_like(tube.material)
    for voxel, law in np.ndenumerate(tube.material):
        material[voxel] = scaled(law, stiff_factor if stiff[voxel] else soft_factor)
    return replace(tube, material=material)


def inflated(shape: Shape, pattern: Pattern, path: Path) -> "Inflation":
    """Return the equilibria of a scene's tube. Raises BadInput unless exactly one kind of load is given."""
    if bool(path.pressures) == bool(path.volume_ratios):
        raise BadInput("path", "has both, or neither, of pressures and volume_ratios", "give one of them")
    tube = build(shape, pattern, path)
    if path.pressures:
        return tube.inflate(path.pressures)
    return tube.inflate(np.array(path.volume_ratios) * tube.rest_volume, "volume")
