"""How fast recordings are read and written, beside what a user would call instead."""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from catheter.lab.report import Progress, Report, Row, measure
from data.recorder import Recorder
from data.recording import Recording
from data.signal import Array, Signal
from data.topics import STANDARD, Topic

NAMES = tuple("abcdefgh")
FRAME_BYTES = 65_000


def recordings(*, quick: bool, progress: Progress) -> Report:
    """Reading and writing recordings: ours beside the plain mcap and protobuf decoder, on the same files."""
    rows, notes = recording_rows((2_000, 20_000) if quick else (10_000, 100_000, 400_000), progress)
    return Report(
        name="recordings",
        title="Recordings of 8 doubles a message, zstd, checksums on: error against run time",
        level="messages",
        error="differing bits",
        rows=rows,
        notes=notes,
    )


def recording_rows(sizes: Sequence[int], progress: Progress) -> tuple[list[Row], list[str]]:
    """Return rows for numbers and frames, and what they come to in messages a second."""
    rows: list[Row] = []
    notes: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        warm = Path(folder) / "warm.mcap"  # what is compiled or imported on first use is not timed
        _written(warm, np.ones((10, 8)))
        _read(warm), _read_plain(warm)
        for done, size in enumerate(sizes):
            values = np.cumsum(np.random.default_rng(0).normal(size=(size, 8)), axis=0)
            path = Path(folder) / f"{size}.mcap"
            rows.append(_written(path, values))
            error_of = partial(_differing_bits, values)
            ours = measure("read: this project", f"{size}", partial(_read, path), error_of)
            plain = measure("read: mcap and protobuf", f"{size}", partial(_read_plain, path), error_of)
            rows += [ours, plain]
            notes.append(
                f"{size} messages: written {size / rows[-3].seconds:,.0f}/s, read {size / ours.seconds:,.0f}/s, "
                f"by mcap and protobuf {size / plain.seconds:,.0f}/s ({plain.seconds / ours.seconds:.0f} times longer)"
            )
            progress((done + 1) / (len(sizes) + 3))
        rows += _foreign(Path(folder), sizes[-1] // 4, notes)
        progress((len(sizes) + 1) / (len(sizes) + 3))
        rows += _frames(Path(folder) / "frames.mcap", sizes[-1] // 130, notes)
        progress((len(sizes) + 2) / (len(sizes) + 3))
        rows += _large(Path(folder) / "large.mcap", 5 * sizes[-1] // 2, sizes[-1] // 28, notes)
        progress(1.0)
    return rows, notes


def _written(path: Path, values: Array) -> Row:
    signal = Signal(np.arange(len(values)) / 1000, values, "1")
    started = time.perf_counter()
    with Recorder(path, {"kind": "simulated"}, flush_s=None) as recorder:
        recorder.add(Topic(name="/numbers", components=NAMES, units=("1",) * 8))
        recorder.write_signals({"/numbers": signal})
    seconds = time.perf_counter() - started
    return Row(method="write: this project", level=f"{len(values)}", error=0.0, seconds=seconds)


def _read(path: Path) -> Array:
    with Recording(path) as recording:
        return recording.signal("/numbers").value


def _read_plain(path: Path) -> Array:
    """Read with the mcap package's own reader and protobuf's own classes, checksums on."""
    from google.protobuf import descriptor_pool, message_factory
    from google.protobuf.descriptor_pb2 import FileDescriptorSet
    from mcap.reader import make_reader

    kind: Any = None
    found = []
    with path.open("rb") as file:
        for schema, _, message in make_reader(file, validate_crcs=True).iter_messages(log_time_order=False):
            if kind is None and schema is not None:
                pool = descriptor_pool.DescriptorPool()
                pool.Add(FileDescriptorSet.FromString(schema.data).file[0])
                kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
            one = kind.FromString(message.data)
            found.append((one.a, one.b, one.c, one.d, one.e, one.f, one.g, one.h))
    return np.array(found)


def _differing_bits(values: Array, read: object) -> float:
    return float(np.sum(np.unpackbits(np.asarray(read).view(np.uint8) ^ values.view(np.uint8))))


def _foreign(folder: Path, size: int, notes: list[str]) -> list[Row]:
    """Read the same numbers as JSON and as ROS 2 CDR, beside the json package and numpy on each message."""
    from mcap.writer import Writer

    values = np.cumsum(np.random.default_rng(2).normal(size=(size, 8)), axis=0)
    definition = "\n".join(f"float64 {name}" for name in NAMES).encode()
    cases: dict[str, tuple[tuple[str, str, bytes], Callable[[Array], bytes], Callable[[bytes], Array]]] = {
        "json": (
            ("numbers", "jsonschema", b"{}"),
            lambda row: json.dumps(dict(zip(NAMES, row.tolist(), strict=True))).encode(),
            lambda content: np.array(list(json.loads(content).values())),
        ),
        "cdr": (
            ("lab/msg/Numbers", "ros2msg", definition),
            lambda row: b"\0\1\0\0" + row.tobytes(),
            lambda content: np.frombuffer(content, "<f8", offset=4),
        ),
    }
    rows = []
    for encoding, (schema, write, read) in cases.items():
        path = folder / f"{encoding}.mcap"
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start()
            channel = writer.register_channel("/numbers", encoding, writer.register_schema(*schema))
            for i, row in enumerate(values):
                writer.add_message(channel, i * 10**6, write(row), i * 10**6)
            writer.finish()
        _read(path)
        error_of = partial(_differing_bits, values)
        ours = measure(f"{encoding}: this project", f"{size}", partial(_read, path), error_of)
        plain = measure(f"{encoding}: mcap, one by one", f"{size}", partial(_read_each, path, read), error_of)
        rows += [ours, plain]
        notes.append(
            f"{encoding}: read {size / ours.seconds:,.0f}/s, one by one {size / plain.seconds:,.0f}/s "
            f"({plain.seconds / ours.seconds:.0f} times longer)"
        )
    return rows


def _read_each(path: Path, read: Callable[[bytes], Array]) -> Array:
    from mcap.reader import make_reader

    with path.open("rb") as file:
        messages = make_reader(file, validate_crcs=True).iter_messages(log_time_order=False)
        return np.array([read(message.data) for _, _, message in messages])


def _frames(path: Path, count: int, notes: list[str]) -> list[Row]:
    """Write and stream 640 x 480 pictures, as bytes: decoding JPEG is OpenCV's."""
    draw = np.random.default_rng(1)
    pictures = [draw.bytes(FRAME_BYTES) for _ in range(30)]
    started = time.perf_counter()
    with Recorder(path, {"kind": "simulated"}, flush_s=None) as recorder:
        recorder.add(STANDARD["/camera/top"])
        for i in range(count):
            recorder.write_picture("/camera/top", i / 30, pictures[i % 30])
    written = time.perf_counter() - started
    rows = [Row(method="write frames: this project", level=f"{count}", error=0.0, seconds=written)]
    for name, stream in (("this project", _pictures), ("mcap and protobuf", _pictures_plain)):
        wrong = sum(one != pictures[i % 30] for i, one in enumerate(stream(path)))
        rows.append(
            measure(f"frames: {name}", f"{count}", partial(_bytes, stream, path), partial(_lacks, count, wrong))
        )
    notes.append(
        f"frames of 65 kB: written {count / written:,.0f}/s, read {count / rows[1].seconds:,.0f}/s, by mcap and "
        f"protobuf {count / rows[2].seconds:,.0f}/s: both are bound by checksum and copy, "
        f"{1e-9 * count * FRAME_BYTES / rows[1].seconds:.1f} GB/s here"
    )
    return rows


def _bytes(stream: Callable[[Path], Iterator[bytes]], path: Path) -> int:
    return sum(len(picture) for picture in stream(path))


def _lacks(count: int, wrong: int, read: object) -> float:
    return float(wrong + (read != count * FRAME_BYTES))


def _pictures(path: Path) -> Iterator[bytes]:
    with Recording(path) as recording:
        for picture in recording.pictures("/camera/top"):
            yield picture.data


def _pictures_plain(path: Path) -> Iterator[bytes]:
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
    from mcap.reader import make_reader

    with path.open("rb") as file:
        for _, _, message in make_reader(file, validate_crcs=True).iter_messages(log_time_order=False):
            yield CompressedImage.FromString(message.data).data


_STREAM = """
import re, sys, time
from pathlib import Path
from data.inspection import inspect
from data.recording import Recording
started = time.perf_counter()
if sys.argv[2] == "check":
    assert inspect(Path(sys.argv[1])).sound
else:
    with Recording(sys.argv[1]) as recording:
        found = sum(len(block) for block in recording.blocks("/numbers"))
        found += sum(1 for _ in recording.pictures("/camera/top"))
    assert found == int(sys.argv[3])
peak = re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())  # Linux says; others do not
print(time.perf_counter() - started, 1024 * int(peak[1]) if peak else "nan")
"""


def _large(path: Path, messages: int, frames: int, notes: list[str]) -> list[Row]:
    """Stream a recording of numbers and frames, and check it, each in a process of its own, for its peak memory."""
    values = np.random.default_rng(4).normal(size=(messages, 8))
    draw = np.random.default_rng(5)
    with Recorder(path, {"kind": "simulated"}, flush_s=None) as recorder:
        recorder.add(Topic(name="/numbers", components=NAMES, units=("1",) * 8))
        recorder.add(STANDARD["/camera/top"])
        step = messages // frames
        for i in range(frames):
            first = i * step
            recorder.write_picture("/camera/top", first / 1000, draw.bytes(FRAME_BYTES))
            part = slice(first, messages if i == frames - 1 else first + step)
            recorder.write_signals({"/numbers": Signal(np.arange(messages)[part] / 1000, values[part], "1")})
    rows, size = [], path.stat().st_size
    for what in ("stream", "check"):
        command = [sys.executable, "-c", _STREAM, str(path), what, str(messages + frames)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        seconds, peak = map(float, done.stdout.split())
        rows.append(
            Row(method=f"{what}: {size / 1e6:,.0f} MB", level=f"{messages + frames}", error=0.0, seconds=seconds)
        )
        notes.append(f"{what} of {size / 1e6:,.0f} MB: {seconds:.1f} s, peak memory {peak / 1e6:.0f} MB")
    return rows
