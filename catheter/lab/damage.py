"""How recordings stand damage: thousands of damaged copies, each read, none silently different."""

import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from catheter.lab.report import Progress, Row
from data.errors import BadInput, RecordingCut
from data.inspection import inspect
from data.recorder import Recorder
from data.recording import Recording
from data.topics import STANDARD, standard

Content = tuple[str, dict[str, dict[str, str]], list[float], list[bytes]]
Damage = Callable[[np.random.Generator, bytes], bytes]


def _flip(draw: np.random.Generator, content: bytes) -> bytes:
    damaged = bytearray(content)
    damaged[draw.integers(len(content))] ^= 1 << int(draw.integers(8))
    return bytes(damaged)


def _cut(draw: np.random.Generator, content: bytes) -> bytes:
    return content[: draw.integers(1, len(content))]


def _zero(draw: np.random.Generator, content: bytes) -> bytes:
    at, size = int(draw.integers(len(content))), int(draw.integers(1, 600))
    return content[:at] + b"\0" * len(content[at : at + size]) + content[at + size :]


def _splice(draw: np.random.Generator, content: bytes) -> bytes:
    a, b, size = (int(draw.integers(n)) for n in (len(content), len(content), 600))
    return content[:a] + content[b : b + size] + content[a + int(draw.integers(600)) :]


def _lie(draw: np.random.Generator, content: bytes) -> bytes:
    """Overwrite 8 bytes with a number that a length field might not expect."""
    at = int(draw.integers(len(content) - 8))
    number = int(draw.choice([0, 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1], 1)[0])
    return content[:at] + (number % 2**64).to_bytes(8, "little") + content[at + 8 :]


KINDS: dict[str, Damage] = {
    "one bit flipped": _flip,
    "cut off": _cut,
    "a stretch of zeros": _zero,
    "a piece copied elsewhere": _splice,
    "a length that lies": _lie,
}


def damage_rows(count: int, progress: Progress) -> tuple[list[Row], list[str]]:
    """Read `count` damaged copies of each kind; return silent differences, and what became of them."""
    rows, notes = [], []
    with tempfile.TemporaryDirectory() as folder:
        sound, damaged = Path(folder) / "sound.mcap", Path(folder) / "damaged.mcap"
        _record(sound)
        content, expected = sound.read_bytes(), _read(sound)
        for done, (kind, damage) in enumerate(KINDS.items()):
            draw = np.random.default_rng(done)
            tally = {"the same": 0, "cut, and a beginning of it": 0, "refused": 0, "different": 0, "not reported": 0}
            started = time.perf_counter()
            for index in range(count):
                damaged.write_bytes(damage(draw, content))
                tally[_outcome(damaged, content, expected)] += 1
                progress((done + index / count) / len(KINDS))
            seconds = time.perf_counter() - started
            wrong = float(tally["different"] + tally["not reported"])
            rows.append(Row(method=kind, level=f"{count}", error=wrong, seconds=seconds))
            notes.append(f"{kind}: " + ", ".join(f"{number} {what}" for what, number in tally.items() if number))
    return rows, notes


def _record(path: Path) -> None:
    draw = np.random.default_rng(3)
    with Recorder(path, {"kind": "simulated", "title": "damage"}, truth={"seed": "3"}, flush_s=None) as recorder:
        recorder.add(standard("/force"))
        recorder.add(STANDARD["/camera/top"])
        for i in range(60):
            recorder.write("/force", i / 83, draw.normal())
            if i % 20 == 0:
                recorder.write_picture("/camera/top", i / 83, draw.bytes(300))


def _read(path: Path) -> Content:
    with Recording(path) as recording:
        pictures = [picture.data for picture in recording.pictures("/camera/top")]
        return recording.kind, recording.metadata, recording.signal("/force").value.tolist(), pictures


def _outcome(path: Path, content: bytes, expected: Content) -> str:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            read = _read(path)
        except BadInput:
            return "refused"
        try:
            sound = inspect(path).sound
        except BadInput:
            sound = False
    if sound and path.read_bytes() != content:
        return "not reported"
    if read == expected:
        return "the same"
    cut = any(issubclass(warning.category, RecordingCut) for warning in caught)
    begins = read[2] == expected[2][: len(read[2])] and read[3] == expected[3][: len(read[3])]
    kept = read[0] in (expected[0], "unstated") and all(expected[1].get(key) == value for key, value in read[1].items())
    return "cut, and a beginning of it" if cut and begins and kept else "different"
