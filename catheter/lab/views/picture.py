"""A picture of a dashboard, taken without a window."""

import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rerun.experimental import ViewerClient

from catheter.lab.views.clocks import TIMELINE
from catheter.lab.views.viewer import Viewer, viewer
from data.errors import BadInput, CatheterError
from data.files import cannot_write

Pixels = NDArray[np.uint8]

ATTEMPTS = 3
ATTEMPT_S = 40.0
PAST_MIDDLE = 0.58  # in the very middle, cycles and staircases tend to stand between two parts
MENU = 37  # rows of the viewer's menu, which are cut off
REST = 8  # pictures in a row that are alike: a viewer's greeting stays for the first 4 or 5
SAME = 1e-3  # share of pixels that two pictures of a dashboard at rest may differ in

NO_DRIVER = (
    "no picture without a Vulkan driver: install the Debian packages mesa-vulkan-drivers and libvulkan1"
    " (the dashboard itself needs neither)"
)


def save_picture(
    rrd: Path, png: Path, *, at_s: float | None = None, count: str = "", size: tuple[int, int] = (1400, 900)
) -> None:
    """Write a picture of a dashboard to `png`, which is replaced, with the cursor at `at_s`.

    at_s: seconds; by default a little past the middle. count: a timeline that counts instead, of which
    the end is shown. size: width and height in pixels.
    Raises BadInput when there is no dashboard, CatheterError when there is no Vulkan driver, no
    picture in about two minutes, or a view that fails, CannotWrite for the place.
    """
    if not rrd.is_file():
        raise BadInput(rrd, "is not there", "expected a dashboard (.rrd)")
    reasons: list[str] = []
    for _ in range(ATTEMPTS):
        with viewer((size[0], size[1] + MENU)) as running:
            try:
                pixels = take(running, rrd, at_s=at_s, count=count)[-size[1] :]
                break
            except NoPictureError as error:
                if "No graphics adapter" in running.printed():
                    raise CatheterError(NO_DRIVER) from error
                reasons.append(str(error))
    else:
        raise CatheterError(f"{rrd}: no picture after {ATTEMPTS} attempts: {'; '.join(reasons)}")
    import cv2

    try:
        png.write_bytes(cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 6])[1].tobytes())
    except OSError as error:
        raise cannot_write(png, error) from error


class NoPictureError(Exception):
    """One attempt failed; the message says at what."""


def take(running: Viewer, rrd: Path, *, at_s: float | None = None, count: str = "") -> Pixels:
    """Return the pixels of a dashboard that has come to rest, with the menu; what was open before is closed.

    at_s, count: as for `save_picture`. Raises NoPictureError for an attempt that failed, CatheterError
    for a view that fails.
    """
    deadline = time.monotonic() + ATTEMPT_S
    try:
        client = _connect(running, deadline)
        _close(client, deadline)
        client.open(str(rrd.resolve()))
        at_ns = _loaded(running, client, at_s, count or TIMELINE, deadline)
        if at_ns is not None and count:
            client.set_time(count, sequence=at_ns, play_state="paused")
        elif at_ns is not None:
            client.set_time(TIMELINE, duration=np.timedelta64(at_ns, "ns"), play_state="paused")
        before, rested = _pixels(client.take_screenshot()), 1
        while time.monotonic() < deadline:
            now = _pixels(client.take_screenshot())
            rested = rested + 1 if _alike(before, now) else 1
            if rested == REST:
                _check(client, rrd)
                return now
            before = now
    except (RuntimeError, OSError) as error:  # what the client raises when the viewer hangs or is gone
        raise NoPictureError(str(error)) from error
    raise NoPictureError(f"it was still changing after {ATTEMPT_S:g} s")


def views_of(running: Viewer) -> dict[str, Pixels]:
    """Return the pixels of every view of the page that is open, by its name."""
    client, found = _connect(running, time.monotonic() + ATTEMPT_S), {}
    for view in client.get_state().views:
        try:
            found[view.name] = _pixels(client.take_screenshot(view_id=view.view_id))
        except ConnectionError as error:
            if "NotFound" not in str(error):  # a view of another page, which is never painted
                raise
    return found


def _close(client: ViewerClient, deadline: float) -> None:
    """Close what is open, so that the next dashboard is the only one."""
    if not client.get_state().recordings:
        return
    client.close("all")
    while client.get_state().recordings and time.monotonic() < deadline:
        time.sleep(0.02)


def _connect(running: Viewer, deadline: float) -> ViewerClient:
    while time.monotonic() < deadline and not running.ended:
        try:
            return ViewerClient.connect(running.url)
        except OSError:  # it does not listen yet
            time.sleep(0.05)
    raise NoPictureError("the viewer ended" if running.ended else "the viewer did not answer")


def _loaded(running: Viewer, client: ViewerClient, at_s: float | None, timeline: str, deadline: float) -> int | None:
    """Wait until the dashboard is loaded; return where its cursor belongs, None if it has no time."""
    while time.monotonic() < deadline and not running.ended:
        state = client.get_state()
        if state.recordings and state.views and not state.loading:
            lines = [line for line in state.recordings[0].timelines if line.name == timeline]
            if not lines or lines[0].start is None or lines[0].end is None:
                return None
            if timeline != TIMELINE:
                return lines[0].end
            span = lines[0].end - lines[0].start
            return lines[0].start + round(PAST_MIDDLE * span) if at_s is None else round(at_s * 1e9)
        time.sleep(0.05)
    raise NoPictureError("the dashboard did not load")


def _check(client: ViewerClient, rrd: Path) -> None:
    """Refuse a dashboard with a view that cannot show what it should."""
    for view in client.get_state().views:
        for report in view.reports:
            raise CatheterError(f"{rrd}, view {view.name!r}: {report.summary}")


def _pixels(png: bytes) -> Pixels:
    import cv2

    pixels = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    if pixels is None:
        raise NoPictureError("the viewer's answer is no PNG picture")
    return np.asarray(pixels, np.uint8)


def _alike(one: Pixels, other: Pixels) -> bool:
    """Return whether two pictures are equal but for a few pixels."""
    return one.shape == other.shape and float(np.mean(np.any(one != other, axis=-1))) < SAME
