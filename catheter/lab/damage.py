"""How recordings stand damage: thousands of damaged copies, each read, none silently different."""

import subprocess
import sys
import tempfile
import time
import tracemalloc
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from catheter.lab.report import Progress, Report, Row
from data.errors import BadInput, DamagedRecording, RecordingCut
from data.inspection import inspect
from data.recorder import Recorder
from data.recording import Recording
from data.topics import STANDARD, standard

MOST_BYTES = 100e6  # beyond twice the file's size: what a length that lies may not make a reader allocate
FLUSH_S = 0.1  # of a killed writer
_WRITER = """
import sys, time
from data.recorder import Recorder
from data.topics import standard
with Recorder(sys.argv[1], {"kind": "simulated"}, flush_s=float(sys.argv[2])) as recorder:
    recorder.add(standard("/force"))
    for i in range(10**9):
        recorder.write("/force", i / 1000, i)
        print(time.monotonic(), flush=True)
"""

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


def damage(*, quick: bool, progress: Progress) -> Report:
    """Damaged copies of a recording: how many are read as something else without a word."""
    rows, notes = damage_rows(100 if quick else 2_500, progress)
    return Report(
        name="damage",
        title="Damaged copies of a recording: read wrongly in silence, or not reported by `check`",
        level="copies",
        error="silent",
        rows=rows,
        notes=notes,
    )


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
            slowest_s = most_bytes = 0.0
            started = time.perf_counter()
            tracemalloc.start()  # counts what Python and numpy allocate, decompressed chunks included
            for index in range(count):
                damaged.write_bytes(damage(draw, content))
                tracemalloc.reset_peak()
                before, begun = tracemalloc.get_traced_memory()[0], time.perf_counter()
                tally[_outcome(damaged, content, expected)] += 1
                slowest_s = max(slowest_s, time.perf_counter() - begun)
                most_bytes = max(most_bytes, tracemalloc.get_traced_memory()[1] - before - 2 * damaged.stat().st_size)
                progress((done + index / count) / (len(KINDS) + 1))
            tracemalloc.stop()
            wrong = float(tally["different"] + tally["not reported"] + (most_bytes > MOST_BYTES))
            rows.append(Row(method=kind, level=f"{count}", error=wrong, seconds=time.perf_counter() - started))
            found = ", ".join(f"{number} {what}" for what, number in tally.items() if number)
            memory = f"at most {most_bytes / 1e6:.1f} MB beyond twice the file"
            notes.append(f"{kind}: {found}; slowest {1e3 * slowest_s:.0f} ms, {memory}")
        killed, note = _killed_row(Path(folder), max(2, count // 50))
        progress(1.0)
    return [*rows, killed], [*notes, note]


def _killed_row(folder: Path, count: int) -> tuple[Row, str]:
    """Kill `count` writers at random; a row's error is how many lost more than the flush interval."""
    started = time.perf_counter()
    lost = [killed_writer(folder / f"killed{seed}.mcap", seed) for seed in range(count)]
    wrong = sum(one.lost_s > FLUSH_S for one in lost)
    seconds = time.perf_counter() - started
    note = (
        f"writer killed: {count} times, {sum(one.kept for one in lost)} of {sum(one.written for one in lost)} samples "
        f"kept; at most {max(one.lost_s for one in lost):.3f} s lost, flushed every {FLUSH_S:g} s"
    )
    return Row(method="writer killed (SIGKILL)", level=f"{count}", error=float(wrong), seconds=seconds), note


@dataclass(frozen=True, kw_only=True)
class Killed:
    """What a killed writer left: samples it had written and that were read back, and seconds of them lost."""

    written: int
    kept: int
    lost_s: float


def killed_writer(path: Path, seed: int) -> Killed:
    """Start a process that writes a recording, kill it at a random moment, and read what is left."""
    wait_s = float(np.random.default_rng(seed).uniform(0.02, 3 * FLUSH_S))
    command = [sys.executable, "-c", _WRITER, str(path), str(FLUSH_S)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        said = [writer.stdout.readline()]
        end = time.monotonic() + wait_s
        while time.monotonic() < end:
            said.append(writer.stdout.readline())
        writer.kill()
        said += [line for line in writer.stdout if line.endswith("\n")]
    written_s = [float(line) for line in said]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RecordingCut)
        with Recording(path.with_suffix(".partial.mcap")) as recording:
            values = recording.signal("/force").value if "/force" in recording.channels else np.empty(0)
    if not np.array_equal(values, np.arange(len(values))):
        raise DamagedRecording(path, "a killed writer's samples are not what it wrote")
    kept = min(len(values), len(written_s))  # a sample may be safe before its writer says so
    lost_s = written_s[-1] - written_s[kept] if kept < len(written_s) else 0.0
    return Killed(written=len(written_s), kept=kept, lost_s=lost_s)


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
