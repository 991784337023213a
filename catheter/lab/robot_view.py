"""How the whole robot reads: what it fills of the cannula, when it touches, how its extender strides."""

from typing import Any

import numpy as np

from catheter.helix import Design
from catheter.robot import Extender, Stride, contact, extender_sweep, layout
from catheter.task import DEGREE, Task
from data.errors import CatheterError

ANGLES = np.arange(56, 90, 3) * DEGREE
ESTIMATE = (
    "Pressure and buckling are estimates: a neo-Hookean wall of an ASSUMED shear modulus (0.4 MPa), an"
    " Euler column hinged at its ends, of the wall alone, without the cannula's support."
)


def _strides(task: Task, extender: Extender) -> list[Stride]:
    angles = np.unique(np.append(ANGLES, extender.angle).round(12))
    return extender_sweep(task, angles[angles > 54.74 * DEGREE], length=extender.length)


def robot_values(task: Task, spiral: Design, extender: Extender) -> dict[str, Any]:
    """Return occlusion, contact, layout and extender sweep for --json."""
    touches = contact(task, spiral)
    return {
        "occlusion": task.occlusion,
        "occlusion_limit": task.occlusion_limit,
        "contact_volume_ratio": {"outer_wall": touches.wall, "centre_line": touches.centre_line},
        "robot": [
            {"name": s.name, "fibres_deg": [_deg(s.alpha), _deg(s.beta), _deg(s.gamma)], "length_mm": 1e3 * s.length}
            | ({"note": s.note} if s.note else {})
            for s in layout(task, spiral, extender)
        ],
        "extender_sweep": [
            {
                "angle_deg": _deg(s.angle_rad),
                "axial_stretch": s.axial,
                "extension_mm": 1e3 * s.extension_m,
                "lock_volume_ratio": s.lock_volume_ratio,
                "pressure_kpa": s.pressure_pa / 1e3,
                "buckling_force_n": s.buckling_force_n,
                "buckling_pressure_kpa": s.buckling_pressure_pa / 1e3,
            }
            for s in _strides(task, extender)
        ],
        "estimates": ESTIMATE,
    }


def _deg(angle: float | None) -> float | None:
    return None if angle is None else round(float(np.degrees(angle)), 9)


def robot_parts(task: Task, spiral: Design, extender: Extender) -> list[Any]:
    """Return the same for people."""
    from catheter.lab.outcome import table

    parts: list[Any] = [
        f"Occlusion: the tube fills {task.occlusion:.1%} of the cannula ({task.occlusion_limit:.0%} allowed)."
    ]
    try:
        touches = contact(task, spiral)
        parts[0] += f" Its wall touches at V = {touches.wall:.4f}, its centre line would at {touches.centre_line:.4f}."
    except CatheterError as error:
        parts.append(str(error))
    rows = [
        [
            f"{_deg(s.angle_rad):g}",
            f"{s.axial:.4f}",
            f"{1e3 * s.extension_m:.1f}",
            f"{s.lock_volume_ratio:.3f}",
            f"{s.pressure_pa / 1e3:.0f}",
            f"{s.buckling_force_n:.3f}",
            f"{s.buckling_pressure_pa / 1e3:.2f}",
        ]
        for s in _strides(task, extender)
    ]
    header = ["angle deg", "l1", "extension mm", "lock V", "fill kPa", "buckles at N", "blocked, at kPa"]
    note = f" ({extender.inferred})" if extender.inferred else ""
    title = f"Extender of {1e3 * extender.length:g} mm{note} at V = {task.volume_ratio:g}, by fibre angle"
    return [*parts, table(header, rows, title, words=0), ESTIMATE]
