"""Chapter 4: actuators shaped to a vessel, Figs. 4.4 to 4.7, and what the thesis says of their volume."""

from functools import partial
from typing import Any

import numpy as np

from catheter.lab.shape_pictures import SCENES, draw_frames, draw_shape, draw_voxel
from catheter.lab.shape_view import Shaped, shaped, volume_error
from catheter.lab.thesis.entries import AGREES, Figure, Section, told

PRINTED = 1e-6  # |det F - 1|, at 2,000 places (section 4.3)


def shapes(*, quick: bool) -> Section:
    """Return Figs. 4.4 to 4.7 from the shipped scenes, and the worst |det F - 1| of the spiral's wall."""
    found = {name: shaped(name) for name in SCENES}
    places = (20, 20, 5) if quick else (100, 100, 10)
    worst = float(np.abs(volume_error(found["renal_spiral"].shape, 1.0, places)).max())
    return Section(
        entries=[
            told("section 4.3", "largest |det F - 1| of the spiral's wall", f"< {PRINTED:g} at 2,000 places",
                 f"{worst:.1e} at {np.prod(places):,}", verdict=AGREES if worst < PRINTED else "differs",
                 reason="" if worst < PRINTED else "the wall folds nearly: see report shape"),
        ],
        figures=[
            Figure(number="4.4", title="balloon and spiral in a renal-like branch", kind="simulated",
                   draw=partial(_two, found), size=(10.0, 5.0)),
            Figure(number="4.5", title="straight to inflection, and its frames", kind="simulated",
                   draw=partial(_inflection, found["inflection"]), size=(10.0, 5.5)),
            Figure(number="4.6", title="twisting: R(v, w), gamma(v)", kind="simulated",
                   draw=lambda figure: draw_shape(_axes(figure), found["twisting"], 1.0, SCENES["twisting"])),
            Figure(number="4.7", title="an element asked for its strain", kind="simulated",
                   draw=lambda figure: draw_voxel(_axes(figure), found["twisting"])),
        ],
    )  # fmt: skip


def _axes(figure: Any, place: tuple[int, int, int] = (1, 1, 1)) -> Any:
    return figure.add_subplot(*place, projection="3d")


def _two(found: dict[str, Shaped], figure: Any) -> None:
    for at, name in enumerate(("renal_balloon", "renal_spiral"), start=1):
        draw_shape(_axes(figure, (1, 2, at)), found[name], 1.0, SCENES[name])


def _inflection(case: Shaped, figure: Any) -> None:
    draw_shape(_axes(figure, (1, 2, 1)), case, 1.0, SCENES["inflection"])
    draw_frames(_axes(figure, (1, 2, 2)), case)
