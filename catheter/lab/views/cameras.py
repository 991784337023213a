"""Camera topics: pictures as they were recorded, at their times."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from catheter.lab.views.clocks import stamps
from catheter.lab.views.labels import plain, view_name
from catheter.lab.views.output import Output

if TYPE_CHECKING:
    from data.recording import Recording

MEDIA = {"jpeg": "image/jpeg", "png": "image/png"}


def log_camera(
    output: Output,
    recording: "Recording",
    topic: str,
    left_out: list[str],
    step: Callable[[], None],
    *,
    shift_s: float = 0.0,
) -> rrb.Spatial2DView | None:
    """Write a topic's pictures one by one, calling `step` after each, and return their view.

    What the viewer cannot decode is counted in `left_out`; None when nothing is left to show. shift_s is added
    to the camera's stamps.
    """
    path = f"/pictures{topic}"
    shown, refused = 0, 0
    for picture in recording.pictures(topic):
        media = MEDIA.get(picture.format.lower())
        if media is None:
            refused += 1
        else:
            columns = rr.EncodedImage.columns(blob=[picture.data], media_type=[media])
            output.stream.send_columns(path, indexes=[stamps(np.array([picture.time_s + shift_s]))], columns=columns)
            output.settle(len(picture.data))
            shown += 1
        step()
    if refused:
        left_out.append(f"{refused} pictures of {topic}: the viewer shows {' and '.join(MEDIA)} alone")
    name = view_name(plain(topic), "", recording.kind)
    return rrb.Spatial2DView(name=name, origin=path) if shown else None
