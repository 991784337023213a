"""How one method did on many pictures whose truth is known."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from catheter.lab.report import Row
from vision.fit import NoMarker
from vision.marker import find
from vision.pattern import SQUARES

Pixels = NDArray[np.uint8]
Answer = tuple[float, float]  # angle and its standard deviation (NaN where a method gives none) [rad]


@dataclass
class Tally:
    """What one method did at one level: errors [deg], reported deviations [deg], reasons for none, seconds."""

    errors: list[float] = field(default_factory=list)
    sigmas: list[float] = field(default_factory=list)
    missed: list[str] = field(default_factory=list)
    seconds: float = 0.0

    def take(self, method: Callable[[Pixels], Answer], picture: Pixels, truth_rad: float) -> None:
        """Run a method on one picture."""
        started = time.perf_counter()
        try:
            angle, sigma = method(picture)
        except NoMarker as error:
            self.missed.append(str(error))
        else:
            self.errors.append(math.degrees((angle - truth_rad + math.pi) % (2 * math.pi) - math.pi))
            self.sigmas.append(math.degrees(sigma))
        self.seconds += time.perf_counter() - started

    @property
    def count(self) -> int:
        """Pictures taken."""
        return len(self.errors) + len(self.missed)

    @property
    def wrong(self) -> int:
        """Answers off by more than 0.1 degrees and five of their own standard deviations."""
        return int(np.sum((np.abs(self.errors) > 0.1) & (np.abs(self.errors) > 5 * np.array(self.sigmas))))

    @property
    def rms(self) -> float:
        """Root mean square error in degrees."""
        return math.sqrt(float(np.mean(np.square(self.errors)))) if self.errors else math.nan

    def row(self, method: str, level: str) -> Row:
        """Return the tally as a report's row."""
        failed = f"missed {len(self.missed)} of {self.count}" if not self.errors else ""
        return Row(method=method, level=level, error=self.rms, seconds=self.seconds / self.count, failed=failed)


def ours(picture: Pixels) -> Answer:
    """Measure with this project, searching the whole picture."""
    found = find(picture, SQUARES)
    return found.angle_rad, found.sigma_rad
