"""Regressors: each term turns an experiment into one column."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput
from sysid.derivative import noise_robust_derivative
from sysid.hysteresis import play, stop

Array = NDArray[np.float64]

SMOOTHING = 0.05  # velocity, as a share of its root mean square, below which its sign is blurred


@dataclass(frozen=True, eq=False)
class Experiment:
    """What a model is fitted to: n samples of an input, a response and further signals, one clock.

    Units are the signals' own; names are what reports print.
    """

    time_s: Array
    input: Array
    response: Array
    others: Mapping[str, Array] = field(default_factory=dict)
    input_name: str = "x"
    response_name: str = "y"

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def span(self) -> float:
        """Largest less smallest input."""
        return float(np.ptp(self.input))

    @property
    def velocity(self) -> Array:
        """Rate of the input, (n,), by the noise-robust differentiator."""
        return noise_robust_derivative(self.time_s, self.input)


@dataclass(frozen=True)
class Power:
    """x^n; n = 0 is the constant."""

    exponent: int

    @property
    def name(self) -> str:
        """How reports print the term."""
        return {0: "1", 1: "x"}.get(self.exponent, f"x^{self.exponent}")

    def column(self, experiment: Experiment) -> Array:
        """Return the regressor, (n,)."""
        return np.asarray(experiment.input**self.exponent)


@dataclass(frozen=True)
class Other:
    """A further signal as it is, for example the pressure."""

    topic: str

    @property
    def name(self) -> str:
        """How reports print the term."""
        return self.topic.lstrip("/")

    def column(self, experiment: Experiment) -> Array:
        """Return the regressor, (n,)."""
        if self.topic not in experiment.others:
            raise BadInput(
                self.topic, "is not in the experiment", f"there are {', '.join(experiment.others) or 'none'}"
            )
        return experiment.others[self.topic]


@dataclass(frozen=True)
class VelocitySign:
    """tanh(v / v0), v0 = 5 % of the rms velocity: Coulomb friction, blurred about standstill."""

    name: str = "sign(v)"

    def column(self, experiment: Experiment) -> Array:
        """Return the regressor, (n,)."""
        velocity = experiment.velocity
        blur = SMOOTHING * float(np.sqrt(np.mean(velocity**2)))
        return np.tanh(velocity / blur) if blur else np.zeros(len(experiment))


@dataclass(frozen=True)
class Branch:
    """x^n while x rises, else 0 (or while it falls): one branch of separate inflating and deflating models."""

    exponent: int
    rising: bool

    @property
    def name(self) -> str:
        """How reports print the term."""
        return f"{Power(self.exponent).name} {'rising' if self.rising else 'falling'}"

    def column(self, experiment: Experiment) -> Array:
        """Return the regressor, (n,)."""
        rises = experiment.velocity >= 0
        return np.where(rises == self.rising, experiment.input**self.exponent, 0.0)


@dataclass(frozen=True)
class Play:
    """The play operator whose radius is a share of the input's span."""

    share: float

    @property
    def name(self) -> str:
        """How reports print the term."""
        return f"play {100 * self.share:.2g}%"

    def column(self, experiment: Experiment) -> Array:
        """Return the regressor, (n,)."""
        return play(experiment.input, self.share * experiment.span)[:, 0]


@dataclass(frozen=True)
class Stop:
    """The stop operator (a spring that slips) whose limit is a share of the input's span."""

    share: float

    @property
    def name(self) -> str:
        """How reports print the term."""
        return f"stop {100 * self.share:.2g}%"

    def column(self, experiment: Experiment) -> Array:
        """Return the regressor, (n,)."""
        return stop(experiment.input, self.share * experiment.span)[:, 0]


Term = Power | Other | VelocitySign | Branch | Play | Stop
