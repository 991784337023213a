"""The loop of thesis 6.5: a design is printed, filmed under pressure, its materials calibrated, then designed anew.

Each stage is computed when it is asked for, and once.
"""

from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from catheter.error_map import ErrorMap, error_map
from catheter.filmed import Filmed
from catheter.inflatable import Path as Loads
from catheter.inflatable import Pattern, Shape, build, drawn, otherwise
from catheter.response import respond
from catheter.twin import Twin, beside, twin
from data.errors import BadInput
from data.options import check, option
from data.recording import SIMULATED
from data.signal import Array

if TYPE_CHECKING:
    from catheter.calibrate import Calibration
    from catheter.redesign import Redesign
    from fem.tube import Tube

NEAR = 3e3  # Pa
SURE = 1.96  # standard deviations, for 95 %


@dataclass(frozen=True, kw_only=True)
class Closing:
    """How a loop is closed: the pressure at which the actuator should move as designed, the noise of the gauge.

    noise: as a share of the reading. scatter: standard deviation of c1 from specimen to specimen as shares, soft
    and stiff; assumed, for the thesis says only that its prints vary (Fig. 5.4).
    """

    pressure: float = option(60e3, unit="Pa", least=1.0, most=1e7)
    noise: float = option(0.0025, least=0.0, most=1.0)
    scatter: tuple[float, ...] = option((0.05, 0.10), least=0.0, most=1.0)

    def __post_init__(self) -> None:
        """Refuse what closes no loop."""
        check(self, "closing")
        if len(self.scatter) != 2:
            raise BadInput("closing, scatter", f"has {len(self.scatter)} shares", "expected soft and stiff")


@dataclass(frozen=True, eq=False)
class Specimen:
    """A printed actuator and its film: the shape, and the map that it was printed from."""

    film: Filmed
    shape: Shape
    pattern: Pattern

    def ahead(self, executor: Executor) -> "Specimen":
        """Return it while its film begins to be read in an executor's process."""
        return replace(self, film=self.film.ahead(executor))

    @property
    def stiff(self) -> NDArray[np.bool_]:
        """Which voxels (around, along) are of the stiff material."""
        return self.pattern.stiff_voxels(self.shape.voxels[0], self.shape.voxels[1])

    @property
    def levels(self) -> Array:
        """Moduli c1 of the soft and the stiff material as the table has them (2,) [Pa]. Raises BadInput for others."""
        found = np.unique(self.pattern.moduli(self.shape.voxels[0], self.shape.voxels[1]))
        if len(found) != 2:
            raise BadInput(self.film.path, f"its map has {len(found)} moduli", "a calibration needs two materials")
        return found

    @property
    def truth(self) -> Array | None:
        """Moduli that were simulated (2,) [Pa]; None for a measurement."""
        told = self.film.truth
        if not {"print.soft", "print.stiff"} <= told.keys():
            return None
        factors = np.array([float(told["print.soft"]), float(told["print.stiff"])])
        return np.asarray(self.levels * factors)

    def tube(self, moduli: Array) -> "Tube":
        """Return the tube whose two materials have moduli (2,) [Pa]."""
        soft, stiff = (moduli / self.levels).tolist()
        return otherwise(build(self.shape, self.pattern, Loads()), self.stiff, soft, stiff)


@dataclass(frozen=True, eq=False)
class TwistCurve:
    """Twist (n,) [rad] over pressure (n,) [Pa] of a map, by film or by the model; its name has the data's kind."""

    name: str
    map: str
    film: bool
    pressure: Array
    twist: Array


class DesignLoop:
    """What an actuator, filmed under pressure, says of its materials, and the design that follows.

    first: printed from the design. again: printed from what came of it, if that was done. executor: its processes
    begin to read the films at once, to be waited for where they are needed. Raises BadInput where the second is
    another tube; its stages do for a map that is not of two materials.
    """

    def __init__(
        self,
        first: Specimen,
        again: Specimen | None = None,
        closing: Closing | None = None,
        executor: Executor | None = None,
    ) -> None:
        self.closing = closing or Closing()
        if again and again.shape != first.shape:
            raise BadInput(again.film.path, f"is of another tube: {again.shape}", f"expected {first.shape}")
        self.first = first.ahead(executor) if executor else first
        self.again = again.ahead(executor) if again and executor else again

    @cached_property
    def twin(self) -> Twin:
        """The design in the table's materials under the recorded pressure, beside the film."""
        return self._twin(self.first, self.first.levels)

    @cached_property
    def calibration(self) -> "Calibration":
        """Both materials, from the film."""
        from catheter.redesign import calibrated

        first, seen = self.first, self.first.film.seen
        return calibrated(
            first.shape, first.pattern, *seen.pairs(), angle_sd=seen.sigma, pressure_share=self.closing.noise
        )

    @cached_property
    def calibrated(self) -> Twin:
        """The design in the calibrated materials under the recorded pressure, beside the film."""
        return self._twin(self.first, self.calibration.moduli)

    @cached_property
    def redesign(self) -> "Redesign":
        """Pressure and map that move most nearly as the design, in the calibrated materials."""
        from catheter.redesign import redesign

        return redesign(self.first.shape, self.first.pattern, self.calibration.moduli, self.closing.pressure)

    @cached_property
    def anew(self) -> Twin:
        """The map that was printed second, in the first's calibrated materials, beside its own film.

        Without a second film: the redesign's map under the first's pressure, beside nothing.
        """
        if self.again:
            return self._twin(self.again, self.calibration.moduli)
        stiff = self.redesign.after.chosen.reshape(self.first.shape.voxels) > 0
        anew = replace(self.first, pattern=drawn(self.first.pattern, stiff))
        return twin(anew.tube(self.calibration.moduli), self.first.film.pressure)

    @cached_property
    def errors(self) -> tuple[ErrorMap, ...]:
        """Where each of the redesign's three differs from the design (thesis Fig. 6.18), voxel by voxel."""
        return tuple(error_map(self.redesign.case, one.standings[0]) for _, _, one in self.redesign.rows)

    @cached_property
    def curves(self) -> tuple[TwistCurve, ...]:
        """The curves of thesis Fig. 6.22: both maps as the model has them and as filmed, and the design as drawn."""
        models = (
            ("design, by the table", "drawn", self.twin),
            ("design, calibrated", "design", self.calibrated),
            ("redesign, calibrated", "redesign", self.anew),
        )
        found = [
            TwistCurve(f"{name} ({SIMULATED})", which, False, one.response.pressure, one.response.values["twist"])
            for name, which, one in models
        ]
        films = (("design", self.first), ("redesign", self.again))
        found += [
            TwistCurve(f"{which}, film ({one.film.kind})", which, True, *one.film.seen.pairs())
            for which, one in films
            if one
        ]
        return tuple(found)

    @property
    def reached(self) -> float:
        """The second film's twist at the redesign's pressure [rad], by a line through frames within NEAR; NaN: none."""
        if not self.again:
            return float("nan")
        pressure, angle = self.again.film.seen.pairs()
        near = np.abs(pressure - self.redesign.pressure_pa) < NEAR
        if near.sum() < 2:
            return float("nan")
        return float(np.polynomial.Polynomial.fit(pressure[near], angle[near], 1)(self.redesign.pressure_pa))

    def scatter(self, pressure: Array) -> Array:
        """Return by how much 95 % of specimens differ in twist (n,) [rad] at pressures (n,) [Pa], to first order."""
        by_log = self.calibration.curve.at(pressure)[2]
        return np.asarray(SURE * np.sqrt(((by_log * np.array(self.closing.scatter)) ** 2).sum(axis=1)))

    def noise(self, pressure: Array) -> Array:
        """Return how far twists that were filmed lie from a true model in 95 % of frames (n,) [rad]."""
        slope = self.calibration.curve.at(pressure)[1]
        return np.asarray(SURE * np.hypot(self.first.film.seen.sigma, slope * self.closing.noise * pressure))

    @staticmethod
    def _twin(one: Specimen, moduli: Array) -> Twin:
        pressure = one.film.pressure
        ends = float(np.nanmin(pressure.value)), float(np.nanmax(pressure.value))
        found = respond(one.tube(moduli), *ends)  # before the film is waited for, which another process may read
        return beside(found, pressure, one.film.twist)
