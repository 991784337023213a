"""What a spiral is to do: the options of a search, and what a design costs."""

from dataclasses import dataclass

import numpy as np

from catheter.free import Array, Stretches
from catheter.helix import Design, Helix, bend, design
from data.errors import BadInput
from data.options import option

MM = 1e-3
DEGREE = np.pi / 180


@dataclass(frozen=True, kw_only=True)
class Task:
    """What a spiral is to do (thesis 3.1.1, Table 3.1), and how finely to search for it.

    diameter of the cannula; radius, wall and length of the tube at rest; volume_ratio V at which the
    targets hold. target_radius None is half the diameter. The cost is a weighted sum of squares:
    weight_radius (R - target)^2 + weight_length (lambda_x - target)^2 + weight_twist (delta - target)^2;
    the thesis's unit matrix is R in mm and delta in rad. occlusion_limit: the share of the cannula's
    cross-section that the tube may fill. torsion: "thesis" or "exact" (see `catheter.helix.bend`).
    """

    diameter: float = option(19 * MM, unit="m", least=1e-6)
    radius: float = option(5 * MM, unit="m", least=1e-9)
    wall: float = option(0.8 * MM, unit="m", least=0.0)
    length: float = option(300 * MM, unit="m", least=1e-6)
    volume_ratio: float = option(1.30, least=1e-3, most=1e3)
    occlusion_limit: float = option(0.5, least=0.0, most=1.0)
    target_radius: float | None = option(None, unit="m", least=0.0)
    target_length_ratio: float = option(1.0, least=0.0)
    target_twist: float = option(0.0, unit="rad")
    weight_radius: float = option(1e6, unit="m^-2", least=0.0)
    weight_length: float = option(1.0, least=0.0)
    weight_twist: float = option(1.0, unit="rad^-2", least=0.0)
    torsion: str = option("thesis", choices=("thesis", "exact"))
    step: float = option(DEGREE, unit="rad", least=0.1 * DEGREE, most=45 * DEGREE)

    @property
    def wanted_radius(self) -> float:
        """The target of the helix radius in m: half the cannula's diameter unless it was given."""
        return self.diameter / 2 if self.target_radius is None else self.target_radius

    @property
    def occlusion(self) -> float:
        """Share of the cannula's cross-section that the tube at rest fills: ((r + wall) / (D/2))^2."""
        return ((self.radius + self.wall) / (self.diameter / 2)) ** 2

    @property
    def weights(self) -> Array:
        """Weights of (radius, length ratio, twist), in m^-2, 1 and rad^-2."""
        return np.array([self.weight_radius, self.weight_length, self.weight_twist])

    def helix(self, pair: Stretches, gamma: Array) -> Helix:
        """Return the helices of pairs of fibres with a third at `gamma`, in this task's tube."""
        return bend(pair, gamma, radius=self.radius, length=self.length, torsion=self.torsion)

    def cost(self, radius_m: Array, length_ratio: Array, twist_rad: Array) -> Array:
        """Return the cost of thesis eq. 3.18; arguments broadcast."""
        radius, length, twist = self.weights
        cost = radius * (radius_m - self.wanted_radius) ** 2 + length * (length_ratio - self.target_length_ratio) ** 2
        return np.asarray(cost + twist * (twist_rad - self.target_twist) ** 2)

    def design(self, alpha: float, beta: float, gamma: float) -> Design:
        """Return one design's state at this task's volume ratio. Raises Infeasible."""
        return design(
            alpha,
            beta,
            gamma,
            volume_ratio=self.volume_ratio,
            radius=self.radius,
            length=self.length,
            torsion=self.torsion,
        )

    def cost_of(self, found: Design) -> float:
        """Return the cost of one design."""
        return float(self.cost(*map(np.asarray, (found.radius_m, found.length_ratio, found.twist_rad))))


def check(task: Task) -> None:
    """Raise BadInput for a task whose parts do not go together."""
    if task.occlusion > task.occlusion_limit:
        fits = task.diameter / 2 * np.sqrt(task.occlusion_limit) - task.wall
        raise BadInput(
            "radius",
            f"{1e3 * task.radius:g} mm with a wall of {1e3 * task.wall:g} mm fills {task.occlusion:.1%} of the cannula",
            f"at most {task.occlusion_limit:.1%} may be filled: a radius of {1e3 * fits:.4g} mm or less",
        )
    if not task.weights.any():
        raise BadInput("weight_radius, weight_length, weight_twist", "are all 0", "one at least must be positive")
