"""What a simulated actuator does at any pressure: a quasi-static curve, solved as finely as is asked, and its spring.

A rubber without memory has one answer to each pressure of the stable path from rest, so a
recording of many thousand pressures needs a few dozen equilibria and a spline between them.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from catheter.circuit import Accumulator
from data.errors import BadInput, DidNotConverge
from data.options import option
from data.signal import Array

if TYPE_CHECKING:
    from fem.continuation import Point
    from fem.equilibrium import System
    from fem.grid import Mesh
    from fem.tube import Inflation, Tube
    from sysid.accumulator import AccumulatorFit

QUANTITIES = ("twist", "extension", "bending", "volume")
SAMPLES = 200  # of P(V) for the spring's polynomial
ENOUGH = 1e-3  # of the greatest pressure: the RMSE at which the polynomial's order is enough


@dataclass(frozen=True, kw_only=True)
class Fineness:
    """How finely a curve is solved: twist between equilibria to `tolerance` [rad], `first` intervals, `most` solves."""

    tolerance: float = option(5e-4, unit="rad", least=1e-8)
    first: int = option(4, least=3)
    most: int = option(200, least=8)


@dataclass(frozen=True, eq=False)
class Response:
    """Equilibria in order of pressure, and splines between them.

    pressure (n,) [Pa]; twist, bending [rad], extension [m], volume [m^3] by name (n,). error: the
    largest twist by which a spline missed an equilibrium that was then added [rad]. shapes: the positions
    (n, nodes, 3) [m] of the nodes of `mesh`.
    """

    pressure: Array
    values: dict[str, Array]
    rest_volume: float
    error: float
    solver: str
    iterations: int
    shapes: tuple[Array, ...]
    mesh: "Mesh"

    @cached_property
    def _splines(self) -> dict[str, Any]:
        from scipy.interpolate import CubicSpline

        return {name: CubicSpline(self.pressure, values) for name, values in self.values.items()}

    def at(self, pressure: Array, name: str = "twist") -> Array:
        """Return a quantity at pressures (m,) [Pa], NaN where they are. Raises BadInput outside the curve."""
        sound = pressure[np.isfinite(pressure)]
        if sound.size and not (self.pressure[0] <= sound.min() and sound.max() <= self.pressure[-1]):
            found = f"{sound.min() / 1e3:g} to {sound.max() / 1e3:g} kPa"
            raise BadInput("pressure", found, f"solved {self.pressure[0] / 1e3:g} to {self.pressure[-1] / 1e3:g} kPa")
        return np.asarray(self._splines[name](pressure))

    @cached_property
    def _positions(self) -> Any:
        from scipy.interpolate import CubicSpline

        return CubicSpline(self.pressure, np.stack(self.shapes))

    def shape(self, pressure: Array) -> Array:
        """Return the nodes' positions (m, nodes, 3) [m] at pressures (m,) [Pa], those of the nearest end beyond it."""
        return np.asarray(self._positions(np.clip(pressure, self.pressure[0], self.pressure[-1])))


@dataclass
class _Curve:
    """The equilibria found so far, by pressure."""

    tube: "Tube"
    system: "System"
    points: "dict[float, Point]" = field(default_factory=dict)

    def solve(self, pressures: list[float]) -> None:
        """Add equilibria, each from its neighbour towards rest."""
        from fem.continuation import follow

        for load in pressures:
            near = max((p for p in self.points if abs(p) <= abs(load) and p * load >= 0), key=abs, default=None)
            start = None if near is None else self.points[near]
            self.points[load] = follow(self.system, [load], start=start)[0]

    def run(self) -> "Inflation":
        """Return the equilibria in order of pressure."""
        from fem.continuation import PRESSURE
        from fem.tube import Inflation

        return Inflation(self.tube, self.system, tuple(self.points[p] for p in sorted(self.points)), PRESSURE)


def respond(
    tube: "Tube",
    least: float,
    most: float,
    fineness: Fineness | None = None,
    progress: Callable[[float], None] | None = None,
) -> Response:
    """Return a tube's response from `least` to `most` pressure [Pa], halving intervals until splines foretell twists.

    Raises BadInput for an empty range, DidNotConverge where the stable path ends within it, or
    where `most` solves are not enough.
    """
    from fem.equilibrium import System

    chosen = fineness or Fineness()
    ends = min(least, 0.0), max(most, 0.0)
    if not (np.isfinite(ends).all() and ends[0] < ends[1]):
        raise BadInput("pressure", f"{least:g} to {most:g} Pa", "expected a range")
    curve = _Curve(tube, System(tube.body(), tube.newton))
    knots = np.unique([0.0, *np.linspace(ends[0], ends[1], chosen.first + 1)])
    curve.solve(sorted(knots.tolist(), key=abs))
    open_intervals = list(zip(knots[:-1].tolist(), knots[1:].tolist(), strict=True))
    error = 0.0
    while open_intervals:
        before = _response(curve, 0.0)
        middles = [(a + b) / 2 for a, b in open_intervals]
        if len(curve.points) + len(middles) > chosen.most:
            raise DidNotConverge(
                f"twist over {least / 1e3:g} to {most / 1e3:g} kPa: {len(curve.points)} equilibria leave "
                f"{error:.1e} rad > {chosen.tolerance:.1e}; allow more, or stay farther from the limit point"
            )
        curve.solve(middles)
        after = _response(curve, 0.0)
        misses = np.abs(before.at(np.array(middles)) - after.at(np.array(middles)))
        error = float(misses.max())
        pairs = zip(open_intervals, middles, misses, strict=True)
        wrong = [(a, m, b) for (a, b), m, miss in pairs if miss > chosen.tolerance]
        open_intervals = [half for a, m, b in wrong for half in ((a, m), (m, b))]
        if progress:
            progress(min(1.0, chosen.tolerance / max(error, chosen.tolerance)))
    return _response(curve, error)


def _response(curve: _Curve, error: float) -> Response:
    run = curve.run()
    values = {name: getattr(run, name) for name in QUANTITIES}
    # twist counts turns from one equilibrium to the next, in order from rest on either side
    turns = np.unwrap(values["twist"])
    values["twist"] = turns - turns[np.argmin(np.abs(run.pressure))]
    rest = float(run.volume[np.argmin(np.abs(run.pressure))])
    shapes = tuple(point.x for point in run.points)
    iterations = int(run.iterations.sum())
    return Response(run.pressure, values, rest, error, run.solver, iterations, shapes, run.system.body.mesh)


@dataclass(frozen=True, eq=False)
class Spring:
    """The spring that a simulated actuator is to the hydraulic circuit, and the fit that it comes from."""

    fit: "AccumulatorFit"
    accumulator: Accumulator


def spring(run: "Inflation") -> Spring:
    """Return the accumulator of an inflated tube: P over V/V_rest - 1, from rest as far as the pressure rises.

    Between equilibria P(V) is the cubic with their dP/dV, which the tangents know. Raises BadInput
    where no equilibrium on the stable path was solved, or no polynomial follows the curve.
    """
    from scipy.interpolate import CubicHermiteSpline

    from fem.continuation import follow
    from sysid.accumulator import fit_accumulator

    rest = follow(run.system, [0.0])[0]
    ends = [rest]
    for point in run.points:
        if point.volume <= ends[-1].volume or point.compliance <= 0 or point.load <= ends[-1].load:
            break
        ends.append(point)
    if len(ends) == 1:
        raise BadInput("inflation", "has no stable equilibrium above rest", "give rising pressures or volumes")
    ratio = np.array([point.volume for point in ends]) / rest.volume
    slopes = [rest.volume / point.compliance for point in ends]
    curve = CubicHermiteSpline(ratio, [point.load for point in ends], slopes)
    samples = np.linspace(1.0, ratio[-1], SAMPLES)
    found = fit_accumulator(samples, curve(samples), enough_pa=ENOUGH * ends[-1].load)
    low, high = found.rising
    made = Accumulator(
        rest_volume=rest.volume,
        coefficients=tuple(found.coefficients.tolist()),
        linear_below=max(0.0, low - 1),
        linear_above=high - 1,
    )
    return Spring(found, made)
