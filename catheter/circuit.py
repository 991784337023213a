"""What the hydraulic circuit is made of: accumulators, valves, and a chain of them."""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from data.errors import BadInput
from data.options import check, load_toml, option, read
from data.signal import Array

DISCHARGE = 0.62
DENSITY_KG_M3 = 997.45
MOST_SEGMENTS = 100


@dataclass(frozen=True, kw_only=True)
class Accumulator:
    """An actuator as a nonlinear spring: P = c1 x + c2 x^2 + ..., x = V/V_rest - 1 (thesis eq. 3.3, 3.4).

    rest_volume: V_rest [m^3]. coefficients: c1, c2, ... [Pa]. Below `linear_below` and above
    `linear_above` (both in x) the law goes on as a straight line with the slope it has there.
    By default the line below begins at the least x >= 0 where P = 0 and P rises: the rest state,
    x = 0 for the thesis's actuators 1 and 2, 0.02725 for actuator 3, whose x = 0 is unstable.

    Raises BadInput unless P rises over all of x: a falling branch has no unique answer.
    """

    rest_volume: float = option(unit="m^3", least=1e-15, most=1e3)
    coefficients: tuple[float, ...] = option(unit="Pa")
    linear_below: float | None = option(None, least=-0.999, most=1e3)
    linear_above: float | None = option(None, least=-0.999, most=1e6)

    def __post_init__(self) -> None:
        """Check every promise above."""
        check(self, "accumulator")
        if not self.coefficients or not all(map(math.isfinite, self.coefficients)) or not any(self.coefficients):
            raise BadInput(
                "accumulator, coefficients", f"are {self.coefficients}", "expected finite numbers, not all 0"
            )
        low, high = self.linear_range
        slope = np.polynomial.Polynomial([0.0, *self.coefficients]).deriv()
        turns = [x for x in _real_roots(slope) if low <= x <= high]
        probes = [low, *([high] if math.isfinite(high) else [turns[-1] + 1.0 if turns else low + 1.0])]
        if turns or not all(slope(x) > 0 for x in probes):
            where = f"falls or is flat at x = {(turns or probes)[0]:.4g}, within {low:.4g} to {high:.4g}"
            raise BadInput("accumulator, pressure", where, "set linear_below and linear_above where it still rises")

    @property
    def linear_range(self) -> tuple[float, float]:
        """The x below which, and above which, the pressure is a straight line."""
        high = math.inf if self.linear_above is None else self.linear_above
        if self.linear_below is not None:
            return self.linear_below, high
        law = np.polynomial.Polynomial([0.0, *self.coefficients])
        rests = [x for x in _real_roots(law) if x >= 0 and law.deriv()(x) > 0]
        if not rests:
            raise BadInput("accumulator, pressure", "has no rest state x >= 0 where it rises", "set linear_below")
        return rests[0], high

    def pressure_pa(self, volume: Array | float) -> Array:
        """Return the pressure [Pa] at volume coefficients V/V_rest, of any shape."""
        law, (low, high) = np.polynomial.Polynomial([0.0, *self.coefficients]), self.linear_range
        x = np.asarray(volume, dtype=np.float64) - 1.0
        inside = np.clip(x, low, high)
        return np.asarray(law(inside) + law.deriv()(inside) * (x - inside))

    def volume(self, pressure_pa: float) -> float:
        """Return the volume coefficient V/V_rest at rest under a pressure [Pa]; BadInput where there is none."""
        from catheter.circuit_kernel import rest_at

        x = rest_at(
            Circuit(segments=(Segment(accumulator=self, valve=Orifice(coefficient=1.0)),)).table(), 0, pressure_pa
        )
        if not -1.0 < x < math.inf:
            raise BadInput("accumulator, pressure", f"no volume holds {pressure_pa:g} Pa", "choose one nearer to 0")
        return 1.0 + float(x)


def _real_roots(law: np.polynomial.Polynomial) -> list[float]:
    roots = np.atleast_1d(law.trim().roots())
    return sorted(float(r.real) for r in roots if abs(r.imag) < 1e-9 * max(1.0, abs(r)))


@dataclass(frozen=True, kw_only=True)
class Orifice:
    """A sharp orifice: Q = K dp / (dp^2 + d^2)^(1/4), that is K sign(dp) sqrt|dp| (thesis eq. 3.7) beyond d.

    coefficient: K [m^3 Pa^-1/2 s^-1]; 0 is closed. transition: d [Pa], the drop at which the flow
    turns from laminar to turbulent, (rho/2)(Re_cr nu/(Cd D))^2: 0.3 to 13 Pa for water in the
    thesis's valves at Re_cr = 150. Without it (d = 0) the law has no slope at dp = 0, and no
    solver an error it can vouch for.
    """

    coefficient: float = option(unit="m^3 Pa^-0.5 s^-1", least=0.0, most=1e3)
    transition: float = option(1.0, unit="Pa", least=1e-6, most=1e7)

    def __post_init__(self) -> None:
        """Check the ranges."""
        check(self, "orifice")

    @classmethod
    def of_area(cls, area_m2: float, *, transition_pa: float = 1.0, discharge: float = DISCHARGE) -> "Orifice":
        """Return the orifice of an open area: K = Cd A sqrt(2/rho), rho = 997.45 kg/m^3 (thesis eq. 3.8)."""
        return cls(coefficient=discharge * area_m2 * math.sqrt(2 / DENSITY_KG_M3), transition=transition_pa)

    @classmethod
    def of_diameter(cls, diameter_m: float, *, transition_pa: float = 1.0, discharge: float = DISCHARGE) -> "Orifice":
        """Return the orifice of a round hole."""
        return cls.of_area(math.pi / 4 * diameter_m**2, transition_pa=transition_pa, discharge=discharge)


@dataclass(frozen=True, kw_only=True)
class ConicalValve:
    """A soft conical valve: shut between its two cracking pressures (thesis Table 3.5), an orifice beyond.

    Q = K e|e| / (e^2 + d^2)^(3/4) of the drop's excess e over `forward` or `reverse` [Pa]: K sqrt(e)
    once the excess is well over `opening` [Pa], over which the cone lifts. The thesis prints the
    cracking pressures only: the flow beyond them is our assumption.
    """

    coefficient: float = option(unit="m^3 Pa^-0.5 s^-1", least=0.0, most=1e3)
    forward: float = option(unit="Pa", least=0.0, most=1e9)
    reverse: float = option(unit="Pa", least=0.0, most=1e9)
    opening: float = option(100.0, unit="Pa", least=1e-6, most=1e7)

    def __post_init__(self) -> None:
        """Check the ranges."""
        check(self, "conical valve")


@dataclass(frozen=True, kw_only=True)
class Segment:
    """One actuator and the valve that feeds it."""

    accumulator: Accumulator
    valve: Orifice | ConicalValve


@dataclass(frozen=True, kw_only=True)
class Circuit:
    """A chain: source, valve 1, accumulator 1, valve 2, accumulator 2, ... (thesis eq. 3.21)."""

    segments: tuple[Segment, ...] = field()

    def __post_init__(self) -> None:
        """Refuse an empty chain, and one longer than anybody builds."""
        if not 1 <= len(self.segments) <= MOST_SEGMENTS:
            raise BadInput("circuit, segments", f"are {len(self.segments)}", f"expected 1 to {MOST_SEGMENTS}")

    def table(self) -> Array:
        """Return the circuit as the compiled code reads it, (N, W); see `circuit_kernel`."""
        from catheter import circuit_kernel as kernel

        degree = max(len(s.accumulator.coefficients) for s in self.segments)
        table = np.zeros((len(self.segments), kernel.FIRST + degree + 1))
        for row, segment in zip(table, self.segments, strict=True):
            spring, valve = segment.accumulator, segment.valve
            row[kernel.PER_VOLUME], row[kernel.STIFFNESS] = 1.0 / spring.rest_volume, 1.0
            row[kernel.FLOW] = valve.coefficient
            row[kernel.LOW], row[kernel.HIGH] = spring.linear_range
            row[kernel.FIRST + 1 : kernel.FIRST + 1 + len(spring.coefficients)] = spring.coefficients
            if isinstance(valve, ConicalValve):
                row[kernel.TRANSITION], row[kernel.CRACKING] = valve.opening, 1.0
                row[kernel.FORWARD], row[kernel.REVERSE] = valve.forward, valve.reverse
            else:
                row[kernel.TRANSITION] = valve.transition
        return table

    def volume(self, pressure_pa: float = 0.0) -> Array:
        """Return the volume coefficients (N,) at rest under one pressure [Pa] everywhere."""
        return np.array([segment.accumulator.volume(pressure_pa) for segment in self.segments])

    def with_coefficients(self, *coefficients: float) -> "Circuit":
        """Return the same circuit with other flow coefficients K1, K2, ... [m^3 Pa^-1/2 s^-1]."""
        if len(coefficients) != len(self.segments):
            raise BadInput("circuit", f"{len(coefficients)} coefficients", f"expected {len(self.segments)}")
        return replace(
            self,
            segments=tuple(
                replace(segment, valve=replace(segment.valve, coefficient=float(k)))
                for segment, k in zip(self.segments, coefficients, strict=True)
            ),
        )


def with_fit(circuit: Circuit, segment: int, path: Path) -> Circuit:
    """Return the circuit with segment 0..N-1's accumulator or valve as `python -m catheter fit` found it.

    path: the TOML of an accumulator fit (pressure law, and rest volume where it says one; beyond the
    volumes that were measured a straight line) or of a valve fit (flow coefficient). Raises BadInput
    for another file or segment.
    """
    tables = load_toml(path)[0]
    told = tables.get("fit", {})
    told = told if isinstance(told, dict) else {}
    model = told.get("model")
    if model not in ("accumulator", "valve"):
        raise BadInput(f"{path}, [fit], model", f"is {model!r:.40}", "expected an accumulator or a valve fit")
    if not 0 <= segment < len(circuit.segments):
        raise BadInput("segment", f"{segment + 1} of {len(circuit.segments)}", "name one that is there")
    old = circuit.segments[segment]
    given = tables.get(model, {})
    if model == "valve":
        found = read(_FittedValve, given, f"{path}, [valve]")
        new = replace(old, valve=replace(old.valve, coefficient=found.coefficient))
    else:
        law = read(_FittedLaw, given, f"{path}, [accumulator]")
        most = read(_FittedRange, {"rising": told["rising"]} if "rising" in told else {}, f"{path}, [fit]").rising[1]
        spring = Accumulator(
            rest_volume=law.rest_volume or old.accumulator.rest_volume,
            coefficients=law.coefficients,
            linear_above=most - 1.0,
        )
        new = replace(old, accumulator=spring)
    return replace(circuit, segments=(*circuit.segments[:segment], new, *circuit.segments[segment + 1 :]))


@dataclass(frozen=True, kw_only=True)
class _FittedLaw:
    coefficients: tuple[float, ...] = option(unit="Pa")
    rest_volume: float | None = option(None, unit="m^3", least=1e-15, most=1e3)


@dataclass(frozen=True, kw_only=True)
class _FittedRange:
    rising: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class _FittedValve:
    coefficient: float = option(unit="m^3 Pa^-0.5 s^-1")


def thesis_circuit(transition_pa: float = 1.0) -> Circuit:
    """Return the thesis's robot: three tubes (Table 3.1), their springs (3.3), the optimal valves (3.4)."""
    from data.table import table

    shape, springs, valves = table("3.1"), table("3.3"), table("3.4")
    volume = math.pi * shape.value("Spiral", "r") ** 2 * shape.value("Spiral", "L")
    return Circuit(
        segments=tuple(
            Segment(
                accumulator=Accumulator(
                    rest_volume=volume,
                    coefficients=tuple(springs.value(f"Act {i}", f"c{j}") for j in range(1, 5)),
                ),
                valve=Orifice(coefficient=valves.value(f"Valve {i}", "optimal"), transition=transition_pa),
            )
            for i in (1, 2, 3)
        )
    )
