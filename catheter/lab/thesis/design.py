"""Section 3.1.1, the fibres: task, search, the published design and what is misprinted about it."""

from dataclasses import replace

import numpy as np

from catheter.free import stretch
from catheter.lab.thesis.entries import DIFFERS, Entry, Section, claim, compare, told, unknown
from catheter.robot import MAGIC, contact, published
from catheter.search import search
from catheter.task import Task

TEXT = "3.text"
EMPIRICAL = "from an empirical study that is not shown; `free` sweeps angle against extension and estimated buckling"


def design(*, quick: bool) -> Section:
    """Search the thesis's grid of fibre angles and hold Tables 3.1 and 3.2 and their text against it."""
    task = Task()
    found = search(task)
    angles = dict(zip(("alpha", "beta", "gamma"), found.ties[0], strict=True))
    printed = task.design(*published())
    physical = replace(task, torsion="exact").design(*published())
    entries = [compare("3.2", "Spiral", angle, name) for name, angle in angles.items()]
    entries += [unknown("3.2", "Extender", name, EMPIRICAL) for name in ("alpha", "beta")]
    entries += [
        compare(TEXT, "magic angle", float(MAGIC)),
        compare(TEXT, "occlusion of the cannula", task.occlusion),
        compare(TEXT, "largest occlusion allowed", task.occlusion),
        compare(TEXT, "helix radius at the published angles", printed.radius_m),
        compare(TEXT, "length ratio at the published angles", printed.length_ratio),
        compare(TEXT, "axial twist at the published angles", printed.twist_rad),
        compare(TEXT, "physical helix radius at these angles", physical.radius_m),
    ]
    touches = contact(task, printed).centre_line
    entries += [compare(TEXT, f"contact volume, {where}", touches) for where in ("methods", "Fig 3.13")]
    entries += [_step(task), _squared(), _signs()]
    return Section(entries=entries)


def _step(task: Task) -> Entry:
    found = search(replace(task, step=task.step / 2))
    half = ", ".join(f"{x:g}" for x in np.degrees(found.ties[0]).round(6))
    return told(
        "Table 3.2", "angles on a 0.5 deg grid", "72, -72, -14", half, verdict=DIFFERS,
        reason="the published optimum is an artefact of the 1 degree step; the continuous one is infeasible",
    )  # fmt: skip


def _squared() -> Entry:
    """Hold a fibre's length, 1 at rest, against (3.9) as printed, in a pair that twists."""
    alpha, beta, axial = np.radians(72.0), np.radians(-50.0), 1.1
    radial, twist = stretch(alpha, beta, axial)
    bracket = 1 + twist / np.tan(alpha)  # (theta + delta) / theta
    along, around = (axial * np.cos(alpha)) ** 2, (radial * np.sin(alpha)) ** 2
    found = f"{float(along + around * bracket):.4f} as printed, {float(along + around * bracket**2):.4f} squared"
    return claim(TEXT, "(3.9)-(3.11)", f"{found} (72/-50 deg, l1 = 1.1)", holds=False)


def _signs() -> Entry:
    alpha, beta, _ = published()
    radial = float(stretch(alpha, beta, Task().design(*published()).axial)[0])
    return claim(TEXT, "(3.12), (3.13)", f"l2 {radial:.4f}; as printed times {alpha * abs(alpha):.3f}", holds=False)
