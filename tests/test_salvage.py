"""Whatever happens to a file: what was lost is named, and everything else comes back."""

from pathlib import Path

import numpy as np
import pytest
from helpers import SIMULATED

from catheter.lab import cli
from catheter.lab.replay import Replay
from data.errors import BadInput, CannotWrite
from data.inspection import inspect
from data.recorder import Recorder
from data.recording import Recording
from data.salvage import salvage
from data.topics import standard


def record(path: Path, chunks: int, samples: int, flush: bool = True) -> list[float]:
    """Record random forces in chunks of `samples` messages; return them."""
    values = np.random.default_rng(4).normal(size=chunks * samples).tolist()
    with Recorder(path, SIMULATED, flush_s=None) as recorder:
        recorder.add(standard("/force"))
        for i, value in enumerate(values):
            if flush and i and i % samples == 0:
                recorder._writer.flush()
            recorder.write("/force", i / 83, value)
    return values


def saved(path: Path, out: Path) -> list[float]:
    salvage(path, out, replace=True)
    assert inspect(out).sound
    with Recording(out) as recording:
        return recording.signal("/force").value.tolist()


def test_a_sound_file_is_sound_and_comes_back_whole(tmp_path: Path) -> None:
    values = record(tmp_path / "a.mcap", 4, 10)
    found = inspect(tmp_path / "a.mcap")
    assert (found.sound, found.chunks, found.messages, found.unverifiable) == (True, 4, 40, "")
    assert saved(tmp_path / "a.mcap", tmp_path / "b.mcap") == values


def test_cut_anywhere_every_message_of_every_complete_chunk_comes_back(tmp_path: Path) -> None:
    path, cut, out = tmp_path / "a.mcap", tmp_path / "cut.mcap", tmp_path / "out.mcap"
    values = record(path, 4, 10)
    content = path.read_bytes()
    with Recording(path) as recording:
        ends = [chunk.place.offset + chunk.place.length for chunk in recording._contents.chunks]
    for size in range(8, len(content)):
        cut.write_bytes(content[:size])
        whole = 10 * sum(end <= size for end in ends)
        found = inspect(cut)
        assert not found.sound
        assert found.messages == whole
        if whole and size % 7 == 0:
            back = saved(cut, out)
            assert back == values[: len(back)]
            assert len(back) >= whole


@pytest.mark.parametrize("exactly", [True, False])
def test_complete_blocks_of_the_open_chunk_come_back_marked_unverified(tmp_path: Path, exactly: bool) -> None:
    path, cut, out = tmp_path / "a.mcap", tmp_path / "cut.mcap", tmp_path / "out.mcap"
    values = record(path, 1, 100_000, flush=False)
    content = path.read_bytes()
    with Recording(path) as recording:
        chunks = recording._contents.chunks
        place = next(chunk.place for chunk in chunks if chunk.place.offset + chunk.place.length > 0.6 * len(content))
        complete = sum(chunk.place.offset < place.offset for chunk in chunks)
        whole = sum(len(recording._chunk(chunk)) for chunk in chunks[:complete])
    cut.write_bytes(content[: 6 * len(content) // 10 if exactly else place.offset + 3 * place.length // 4])
    found = inspect(cut)
    assert (found.chunks, found.messages) == (complete, whole)
    # three quarters of the bytes, in blocks of 128 kB of a megabyte: at least half of the chunk's messages
    assert found.unverified_messages > (0 if exactly else 0.5 * (1 << 20) / 40)
    back = saved(cut, out)
    assert back == values[: len(back)]
    assert len(back) == found.messages + found.unverified_messages
    with Recording(out) as recording:
        assert "unverified.1" in recording.metadata["salvage"]
        assert recording.kind == "simulated"
        assert any("unverified" in text for text in Replay(recording).left_out)


def test_a_damaged_chunk_is_skipped_and_named(tmp_path: Path) -> None:
    path, out = tmp_path / "a.mcap", tmp_path / "out.mcap"
    values = record(path, 4, 10)
    with Recording(path) as recording:
        place = recording._contents.chunks[1].place
    content = bytearray(path.read_bytes())
    content[place.offset + place.length - 5] ^= 1
    path.write_bytes(content)
    found = inspect(path)
    assert any(finding.offset == place.offset - 9 and "is lost" in finding.what for finding in found.findings)
    assert saved(path, out) == values[:10] + values[20:]
    assert path.read_bytes() == content


@pytest.mark.parametrize("rubbish", [b"\xff" * 300, b"\0" * 1000, bytes(range(256)) * 10])
def test_after_rubbish_the_next_chunk_is_found(tmp_path: Path, rubbish: bytes) -> None:
    path, out = tmp_path / "a.mcap", tmp_path / "out.mcap"
    values = record(path, 4, 10)
    with Recording(path) as recording:
        at = recording._contents.chunks[2].place.offset - 9
    content = path.read_bytes()
    path.write_bytes(content[:at] + rubbish + content[at + 20 :])  # and the chunk's own head is gone
    found = inspect(path)
    assert any(finding.offset == at for finding in found.findings)
    assert saved(path, out) == values[:20] + values[30:]


def test_every_flipped_bit_is_reported(tmp_path: Path) -> None:
    path, damaged = tmp_path / "a.mcap", tmp_path / "damaged.mcap"
    record(path, 4, 10)
    content = path.read_bytes()
    for bit in np.random.default_rng(8).choice(8 * len(content), 500, replace=False).tolist():
        flipped = bytearray(content)
        flipped[bit // 8] ^= 1 << bit % 8
        damaged.write_bytes(flipped)
        try:
            sound = inspect(damaged).sound
        except BadInput:
            sound = False
        assert not sound, f"bit {bit % 8} of byte {bit // 8}"


def test_what_cannot_be_saved_is_refused_and_nothing_written(tmp_path: Path) -> None:
    path, out = tmp_path / "a.mcap", tmp_path / "out.mcap"
    record(path, 1, 5)
    content = path.read_bytes()
    path.write_bytes(content[:200])
    with pytest.raises(BadInput, match="no message that can be saved"):
        salvage(path, out)
    assert not out.exists()
    with pytest.raises(CannotWrite, match="input"):
        salvage(path, path, replace=True)
    path.write_text("time,force")
    with pytest.raises(BadInput, match="does not begin as an MCAP"):
        inspect(path)


def test_the_command_says_what_it_found(tmp_path: Path, capsys) -> None:
    path = tmp_path / "a.mcap"
    record(path, 4, 10)
    assert cli.run(["check", str(path)]) == 0
    assert "4 sound chunks, 40 messages" in capsys.readouterr().out
    path.write_bytes(path.read_bytes()[:-200])
    assert cli.run(["check", str(path), "--salvage", str(tmp_path / "b.mcap")]) == 2
    assert "damaged" in capsys.readouterr().out
    assert cli.run(["check", str(tmp_path / "b.mcap")]) == 0


def test_the_real_bags_are_read_through(real: Path) -> None:
    for path in sorted((real / "mcap").glob("*.mcap")):
        found = inspect(path)
        assert found.sound, found.findings
        assert found.messages > 0
