"""Frames from videos, folders and recordings: in order, on demand, and every fault in words."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers import SIMULATED

from data.errors import BadInput
from data.recorder import Recorder
from data.topics import standard
from vision.frames import decode, grey, open_source
from vision.render import Shot, render

SHOT = Shot(width_px=64, height_px=48, middle_px=(30, 22), pitch_px=20.0)


def jpeg(level: int, size: tuple[int, int] = (48, 64)) -> bytes:
    return cv2.imencode(".jpg", np.full(size, level, np.uint8))[1].tobytes()


def recording(path: Path, pictures: list[bytes], topics: tuple[str, ...] = ("/camera/top",)) -> Path:
    with Recorder(path, SIMULATED, flush_s=None) as recorder:
        for name in topics:
            recorder.add(standard(name))
            for k, data in enumerate(pictures):
                recorder.write_picture(name, k / 30, data)
    return path


def video(path: Path, code: str, count: int) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*code), 25, (64, 48))
    for k in range(count):
        writer.write(np.full((48, 64, 3), 10 * k, np.uint8))
    writer.release()
    return path


@pytest.mark.parametrize(("code", "suffix"), [("mp4v", ".mp4"), ("MJPG", ".avi")])
def test_a_video_gives_its_frames_in_order_from_any_first(tmp_path: Path, code: str, suffix: str) -> None:
    source = open_source(video(tmp_path / f"v{suffix}", code, 12))
    assert (source.count, source.rate_hz) == (12, 25.0)
    for first in (0, 7):
        frames = list(source.frames(first))
        assert [frame.number for frame in frames] == list(range(first, 12))
        assert [round(frame.picture.mean() / 10) for frame in frames] == list(range(first, 12))
        assert [frame.time_s for frame in frames] == pytest.approx(np.arange(first, 12) / 25)


def test_a_folder_is_read_in_the_order_of_counting(tmp_path: Path) -> None:
    for k in (10, 9, 1):
        (tmp_path / f"p{k}.jpg").write_bytes(jpeg(k * 10, (48, 64 + k)))
    (tmp_path / "cut.png").write_bytes(cv2.imencode(".png", render(SHOT))[1].tobytes()[:99])
    (tmp_path / "notes.txt").write_text("none")
    frames = list(open_source(tmp_path, rate_hz=10).frames())
    assert [frame.name for frame in frames] == ["cut.png", "p1.jpg", "p9.jpg", "p10.jpg"]
    assert frames[0].picture is None
    assert "decoded" in frames[0].fault
    assert [frame.picture.shape[1] for frame in frames[1:]] == [65, 73, 74]  # each stands for itself
    assert frames[3].time_s == pytest.approx(0.3)


def test_a_recordings_faults_are_frames_with_a_reason(tmp_path: Path) -> None:
    whole = jpeg(100)
    pictures = [whole, whole[: len(whole) // 2], b"junk", jpeg(100, (24, 32)), whole]
    source = open_source(recording(tmp_path / "r.mcap", pictures))
    frames = list(source.frames())
    assert source.origin == "simulated"
    assert [frame.picture is None for frame in frames] == [False, True, True, True, False]
    assert "cut off" in frames[1].fault
    assert "cannot be decoded" in frames[2].fault
    assert frames[3].fault == "is 32 x 24 pixels, frames before 64 x 48"
    assert [frame.time_s for frame in frames] == pytest.approx(np.arange(5) / 30)


def test_colours_and_sixteen_bits_become_grey() -> None:
    picture = render(SHOT)
    assert (grey(np.dstack([picture] * 3)) == picture).all()
    assert (grey(np.dstack([picture] * 4)) == picture).all()
    assert (grey(picture[:, :, None]) == picture).all()
    deep = cv2.imencode(".png", picture.astype(np.uint16) * 257)[1].tobytes()
    assert decode(deep).dtype == np.uint16
    for bad in (np.zeros((4, 4)), np.zeros((4, 4, 2), np.uint8), np.zeros((0, 4), np.uint8)):
        with pytest.raises(BadInput):
            grey(bad)
    with pytest.raises(BadInput, match="empty"):
        decode(b"")


def test_what_is_no_source_is_named(tmp_path: Path) -> None:
    (tmp_path / "empty.mp4").touch()
    (tmp_path / "text.mp4").write_text("no video at all")
    (tmp_path / "folder").mkdir()
    expected = {"empty.mp4": "is empty", "text.mp4": "no video", "folder": "no pictures", "x": "not there"}
    for name, found in expected.items():
        with pytest.raises(BadInput, match=f"{name}.*{found}"):
            open_source(tmp_path / name)
    two = recording(tmp_path / "two.mcap", [jpeg(9)], ("/camera/top", "/camera/side"))
    with pytest.raises(BadInput, match="2 cameras"):
        open_source(two)
    assert open_source(two, topic="/camera/side").count == 1
    with pytest.raises(BadInput, match="no camera /x"):
        open_source(two, topic="/x")
    with pytest.raises(BadInput, match="rate"):
        open_source(two, rate_hz=0.0)
