"""Frames one by one, grey, with their times: from a video, a folder of pictures, or a recording.

A frame that cannot be had is a frame with its fault in words, never a missing number. Nothing is
decoded before it is asked for, and one frame is held at a time.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.errors import BadInput
from data.recording import UNSTATED, Recording
from vision.fit import Picture

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm")
MOST_PIXELS = 1 << 27


@dataclass(frozen=True)
class Frame:
    """One frame: its number, its time [s], its grey picture or why there is none, and its file's name if it has one."""

    number: int
    time_s: float
    picture: Picture | None
    fault: str = ""
    name: str = ""


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where frames come from: path, kind ("video", "folder", "recording"), camera topic, frames in a second.

    count: how many frames it announces, 0 when it does not. origin: "simulated", "measured" or
    "unstated". one_size: whether a frame of another size than the first is a fault.
    """

    path: Path
    kind: str
    count: int
    rate_hz: float
    topic: str = ""
    origin: str = UNSTATED
    one_size: bool = True

    def frames(self, first: int = 0) -> Iterator[Frame]:
        """Yield the frames from number `first` on. Raises BadInput when there is not one."""
        reader = {"video": _video, "folder": _folder, "recording": _recorded}[self.kind]
        size: tuple[int, ...] = ()
        for frame in reader(self, first):
            found = frame
            if frame.picture is not None and self.one_size:
                size = size or frame.picture.shape
                if frame.picture.shape != size:
                    now, before = (f"{shape[1]} x {shape[0]}" for shape in (frame.picture.shape, size))
                    found = Frame(frame.number, frame.time_s, None, f"is {now} pixels, frames before {before}")
            yield found


def open_source(path: Path | str, *, topic: str | None = None, rate_hz: float | None = None) -> Source:
    """Return what is at a path: a folder of pictures, a recording (.mcap), or else a video file.

    topic: a recording's camera, its only one by default. rate_hz: frames in a second of a folder
    (default 1) or of a video whose own rate is wrong. Raises BadInput naming what is not there.
    """
    path = Path(path)
    if rate_hz is not None and not 0 < rate_hz < 1e6:
        raise BadInput("rate", f"is {rate_hz} frames a second", "expected a positive number")
    if path.is_dir():
        count = len(_files(path))
        if not count:
            raise BadInput(path, "holds no pictures", f"expected files ending in {', '.join(PICTURES)}")
        return Source(path=path, kind="folder", count=count, rate_hz=rate_hz or 1.0, one_size=False)
    if not path.is_file():
        raise BadInput(path, "is not there", "name a video, a folder of pictures or a recording")
    if path.stat().st_size == 0:
        raise BadInput(path, "is empty", "expected a video or a recording")
    if path.suffix == ".mcap":
        return _open_recording(path, topic)
    if topic:
        raise BadInput(path, f"is no recording, yet the topic {topic} was asked for")
    return _open_video(path, rate_hz)


def grey(image: NDArray[Any]) -> Picture:
    """Return an image as grey uint8 or uint16, (height, width): colours (BGR, BGRA) weighed as the eye does."""
    import cv2

    if image.dtype not in (np.uint8, np.uint16) or image.ndim not in (2, 3) or image.size == 0:
        raise BadInput("picture", f"is {image.dtype} of shape {image.shape}", "expected 8 or 16 bits, grey or colour")
    if image.ndim == 3 and image.shape[2] in (3, 4):
        code = cv2.COLOR_BGR2GRAY if image.shape[2] == 3 else cv2.COLOR_BGRA2GRAY
        return np.asarray(cv2.cvtColor(image, code), image.dtype)
    if image.ndim == 3:
        if image.shape[2] != 1:
            raise BadInput("picture", f"has {image.shape[2]} channels", "expected 1, 3 or 4")
        image = image[:, :, 0]
    return np.ascontiguousarray(image)


def decode(data: bytes) -> Picture:
    """Return an encoded picture as grey. Raises BadInput for one that is cut off, empty or none at all.

    A JPEG without its end marker is refused: a decoder would fill what is lost with grey.
    """
    import cv2

    if not data:
        raise BadInput("picture", "is empty")
    if data[:2] == b"\xff\xd8" and b"\xff\xd9" not in data[-64:]:
        raise BadInput("picture", "is a JPEG that was cut off")
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise BadInput("picture", f"cannot be decoded: {' '.join(str(error).split())[:80]}") from error
    if image is None or image.size > 4 * MOST_PIXELS:
        raise BadInput("picture", "cannot be decoded")
    return grey(image)


def _try(number: int, time_s: float, data: bytes, name: str = "") -> Frame:
    try:
        return Frame(number, time_s, decode(data), "", name)
    except BadInput as error:
        return Frame(number, time_s, None, error.found, name)


def _files(folder: Path) -> list[Path]:
    """Return a folder's pictures, numbers in their names in the order of counting."""

    def key(path: Path) -> list[tuple[int, str]]:
        return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name)]

    return sorted((p for p in folder.iterdir() if p.suffix.lower() in PICTURES and p.is_file()), key=key)


def _folder(source: Source, first: int) -> Iterator[Frame]:
    for number, path in enumerate(_files(source.path)):
        if number >= first:
            try:
                data = path.read_bytes()
            except OSError as error:
                yield Frame(number, number / source.rate_hz, None, f"cannot be read: {error.strerror}", path.name)
                continue
            yield _try(number, number / source.rate_hz, data, path.name)


def _open_recording(path: Path, topic: str | None) -> Source:
    with Recording(path) as recording:
        cameras = [name for name, channel in recording.channels.items() if channel.topic.is_camera]
        if topic is None and len(cameras) != 1:
            raise BadInput(
                path, f"has {len(cameras)} cameras", f"name one with --topic: {', '.join(cameras) or 'none'}"
            )
        chosen = topic or cameras[0]
        if chosen not in cameras:
            raise BadInput(path, f"has no camera {chosen}", f"cameras are: {', '.join(cameras) or 'none'}")
        channel = recording.channels[chosen]
        if channel.unreadable:
            raise BadInput(f"{path}, {chosen}", f"cannot be read: {channel.unreadable}")
        rate = channel.topic.rate_hz or 0.0
        return Source(
            path=path, kind="recording", count=channel.messages, rate_hz=rate, topic=chosen, origin=recording.kind
        )


def _recorded(source: Source, first: int) -> Iterator[Frame]:
    with Recording(source.path) as recording:
        for number, picture in enumerate(recording.pictures(source.topic)):
            if number >= first:
                yield _try(number, picture.time_s, picture.data)


def _open_video(path: Path, rate_hz: float | None) -> Source:
    import cv2

    video = cv2.VideoCapture(str(path))
    try:
        if not video.isOpened():
            raise BadInput(path, "is no video that can be opened", "expected mp4, avi, mkv or webm")
        count, rate = int(video.get(cv2.CAP_PROP_FRAME_COUNT)), float(video.get(cv2.CAP_PROP_FPS))
    finally:
        video.release()
    rate = rate_hz or rate
    if not 0 < rate < 1e6:
        raise BadInput(path, f"says it has {rate} frames a second", "state it with --rate")
    return Source(path=path, kind="video", count=max(0, count), rate_hz=rate)


def _video(source: Source, first: int) -> Iterator[Frame]:
    """Yield a video's frames at number / rate; skipped frames are passed one by one, seeking is not exact."""
    import cv2

    video = cv2.VideoCapture(str(source.path))
    try:
        number = 0
        while number < first and video.grab():
            number += 1
        while True:
            sound, image = video.read()
            if not sound:
                break
            yield Frame(number, number / source.rate_hz, grey(np.asarray(image)))
            number += 1
    finally:
        video.release()
    if number == 0:
        raise BadInput(source.path, "holds no frame", "expected a video with at least one")
    if number < source.count:
        fault = f"the video ends here, though it announces {source.count} frames"
        yield Frame(number, number / source.rate_hz, None, fault)
