"""A vessel from points and radii along it: units, order, arc length, and a smooth curve through them."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from catheter.curve import Curve, Piecewise, line
from catheter.polyline import crossing, repaired
from catheter.vessel_files import Points, read_points
from data.errors import BadInput, nearest
from data.options import option
from data.signal import Array

FOLDER = Path(__file__).parents[1] / "data" / "vessels"
ORDER = 5  # of the polynomial (thesis eq. 4.1)
WORST = 0.05  # of the local radius: a polynomial that is farther off gives way to the spline
FARTHEST = 10.0  # m: no patient is larger
LEAST, MOST = 0.8e-3, 10e-3  # m, radii of vessels that a catheter enters, by which units are told apart
SCALES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where a vessel comes from: a shipped one by name, a .csv, .vtp or .vtk file, or "straight".

    unit: "mm", "cm" or "m"; left out, it is taken from the file or told from the radii. branch:
    which line of a VTK file. start, length [m]: the part that is used, all of it by default. radius
    [m]: of a straight one.
    """

    file: str = "renal"
    unit: str = option("", choices=("", *SCALES))
    branch: int | None = None
    fit: str = option("auto", choices=("auto", "polynomial", "spline"))
    start: float = option(0.0, unit="m", least=0.0, most=10.0)
    length: float = option(0.0, unit="m", least=0.0, most=10.0)  # of no body is a vessel longer
    radius: float = option(0.0, unit="m", least=0.0, most=10.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Vessel:
    """A centreline and radius over w in 0 .. length [m], what was said of the data, and how well curves fit.

    residual: of each kind of curve, the farthest a point is from it, over the local radius. The
    spline passes through every point: its number is that of points it was not given (every other one).
    """

    centre: Curve
    radius: Curve
    length: float
    kind: str
    residual: dict[str, float]
    notes: tuple[str, ...]
    simulated: bool


def load(source: Source) -> Vessel:
    """Return the vessel of a source. Raises BadInput for what makes no vessel, naming file and line."""
    if source.file == "straight":
        return straight(source.length, source.radius)
    if source.radius:
        raise BadInput("vessel, radius", f"is {1e3 * source.radius:g} mm", "only a straight vessel takes one")
    path = _path(source.file)
    points = read_points(path, source.branch)
    simulated = path.suffix.lower() == ".csv" and b"simulated" in path.read_bytes()[:500]
    scale, said = _scale(path, points, source.unit)
    vessel = fitted(points.xyz * scale, points.radius * scale, fit=source.fit, place=str(path))
    vessel = _part(vessel, source, str(path))
    return replace(vessel, notes=(said, *vessel.notes), simulated=simulated)


def _path(name: str) -> Path:
    path = Path(name)
    if path.suffix.lower() in (".csv", ".vtp", ".vtk"):
        return path
    shipped = sorted(p.stem for p in FOLDER.glob("*.csv"))
    if name not in shipped:
        raise BadInput(f"vessel {name!r}", "is not known", nearest(name, shipped) + "; or name a .csv, .vtp, .vtk file")
    return FOLDER / f"{name}.csv"


def _scale(path: Path, points: Points, asked: str) -> tuple[float, str]:
    """Return metres per unit of a file, and how it is known."""
    if asked and points.unit and asked != points.unit:
        raise BadInput(f"{path}, unit", f"is {points.unit} in the file and {asked} here", "leave one of them out")
    if asked or points.unit:
        unit = asked or points.unit
        if unit not in SCALES:
            raise BadInput(f"{path}, unit", f"is {unit!r}", f"expected one of {', '.join(SCALES)}")
        return SCALES[unit], f"Lengths are in {unit}, as stated."
    if len(points.radius) == 0:
        raise BadInput(path, "has no points", "expected a centreline")
    middle = float(np.median(points.radius))
    fitting = [unit for unit, scale in SCALES.items() if LEAST <= middle * scale <= MOST]
    if len(fitting) != 1:
        found = f"has no unit, and a median radius of {middle:g} is a vessel's in {' and in '.join(fitting) or 'none'}"
        raise BadInput(path, found, "say it: unit = 'mm', 'cm' or 'm'")
    unit = fitting[0]
    said = f"Lengths are taken as {unit}: no unit is stated, and a median radius of {middle:.3g} is a vessel's in"
    return SCALES[unit], f"{said} {unit} only."


def fitted(xyz: Array, radius: Array, *, fit: str = "auto", place: str = "centreline") -> Vessel:
    """Return a vessel through points (n, 3) with radii (n,) [m].

    fit: "polynomial" (of order 5 by arc length, thesis eq. 4.1 and 4.2), "spline" (cubic), or
    "auto": the polynomial unless it is more than 5 % of the local radius away from a point.
    Repeated points are dropped and points out of order sorted, and both are said. Raises BadInput.
    """
    _check_numbers(xyz, radius, place)
    points, radii, notes = repaired(xyz, radius, place)
    w = _arc_length(points)
    spline, spline_radius = _spline(w, points), _spline(w, radii)
    polynomial, polynomial_radius = _polynomial(w, points), _polynomial(w, radii)
    off = np.hypot(np.linalg.norm(polynomial(w) - points, axis=1), polynomial_radius(w) - radii)
    residual = {"polynomial": float((off / radii).max()), "spline": _held_out(w, points, radii)}
    if fit == "polynomial" and len(w) <= ORDER:
        raise BadInput(place, f"has {len(w)} points", f"a polynomial of order {ORDER} needs {ORDER + 1}")
    smooth = fit == "polynomial" or (fit == "auto" and residual["polynomial"] <= WORST and len(w) > ORDER)
    centre, profile = (polynomial, polynomial_radius) if smooth else (spline, spline_radius)
    length = float(w[-1])
    _check_curve(centre, profile, length, place)
    return Vessel(
        centre=Piecewise(centre),
        radius=Piecewise(profile),
        length=length,
        kind="polynomial" if smooth else "spline",
        residual=residual,
        notes=tuple(notes),
        simulated=False,
    )


def _check_numbers(xyz: Array, radius: Array, place: str) -> None:
    bad = ~((np.abs(xyz) < FARTHEST).all(axis=1) & (radius > 0) & (radius < FARTHEST))
    if bad.any():
        k = int(np.argmax(bad))
        found = f"is {np.array2string(xyz[k])}, radius {radius[k]:g}"
        raise BadInput(
            f"{place}, point {k}", found, f"expected finite numbers below {FARTHEST:g} m and a radius over 0"
        )


def _arc_length(xyz: Array) -> Array:
    """Return the arc length at each point, along the cubic spline through them."""
    from scipy.interpolate import CubicSpline

    chords = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(xyz, axis=0), axis=1)))
    slope = CubicSpline(chords, xyz).derivative()
    nodes, weights = np.polynomial.legendre.leggauss(8)
    half = np.diff(chords)[:, None] / 2
    at = chords[:-1, None] + half * (1 + nodes)
    return np.append(0.0, np.cumsum((np.linalg.norm(slope(at), axis=-1) * weights * half).sum(axis=1)))


def _spline(w: Array, values: Array) -> Any:
    from scipy.interpolate import CubicSpline

    return CubicSpline(w, values)


def _polynomial(w: Array, values: Array) -> Any:
    """Return the least-squares polynomial as one piece over the whole length."""
    from scipy.interpolate import PPoly

    order = min(ORDER, len(w) - 1)
    fit = np.polynomial.polynomial.polyfit(w / w[-1], values, order)
    powers = float(w[-1]) ** np.arange(order + 1)
    scaled = (fit.T / powers).T[::-1]
    return PPoly(scaled[:, None], np.array([0.0, w[-1]]))


def _held_out(w: Array, points: Array, radii: Array) -> float:
    """Return how far the spline through every other point is from the rest, over the local radius."""
    given = np.unique(np.append(np.arange(0, len(w), 2), len(w) - 1))
    rest = np.setdiff1d(np.arange(len(w)), given)
    if len(given) < 4:
        return float("nan")
    off = np.linalg.norm(_spline(w[given], points[given])(w[rest]) - points[rest], axis=1)
    return float((np.hypot(off, _spline(w[given], radii[given])(w[rest]) - radii[rest]) / radii[rest]).max())


def _check_curve(centre: Any, profile: Any, length: float, place: str) -> None:
    """Refuse a centreline that crosses itself, and a fit whose radius vanishes."""
    w = np.linspace(0, length, 600)
    xyz, radius = centre(w), profile(w)
    if not (radius > 0).all():
        raise BadInput(place, f"has radius {radius.min():.3g} m after fitting", "use fit = 'spline'")
    near = crossing(xyz, w, radius)
    if near is not None:
        a, b = near
        found = f"crosses itself: w = {1e3 * w[a]:.4g} and {1e3 * w[b]:.4g} mm are"
        apart = float(np.linalg.norm(xyz[a] - xyz[b]))
        raise BadInput(place, f"{found} {1e3 * apart:.3g} mm apart, the radii {1e3 * radius[[a, b]].sum():.3g} mm")


def _part(vessel: Vessel, source: Source, place: str) -> Vessel:
    length = source.length or vessel.length - source.start
    if not 0 < length <= (vessel.length - source.start) * (1 + 1e-9):
        found = f"is {1e3 * vessel.length:.4g} mm long"
        raise BadInput(place, found, f"start {1e3 * source.start:g} mm and length {1e3 * length:g} mm do not fit in it")
    parts: list[Curve] = []
    for curve in (vessel.centre, vessel.radius):
        assert isinstance(curve, Piecewise)
        parts.append(Piecewise(curve.pieces, curve.start + source.start))
    return replace(vessel, centre=parts[0], radius=parts[1], length=length)


def straight(length: float, radius: float) -> Vessel:
    """Return a straight vessel along z [m]. Raises BadInput unless it has a length and a radius."""
    from scipy.interpolate import PPoly

    if not (length > 0 and radius > 0):
        found = f"has length {1e3 * length:g} mm and radius {1e3 * radius:g} mm"
        raise BadInput("straight vessel", found, "give both, over 0")
    return Vessel(
        centre=line(np.zeros(3), np.array([0.0, 0.0, 1.0])),
        radius=Piecewise(PPoly(np.array([[radius]]), np.array([0.0, 1.0]))),
        length=length,
        kind="straight",
        residual={},
        notes=(),
        simulated=True,
    )
