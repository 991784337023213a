"""Hostile and damaged inputs: refused in one sentence, in bounded time and memory, nothing lost."""

import os
import resource
import struct
import subprocess
import sys
import zlib
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import zstandard
from helpers import SIMULATED, catheter
from mcap.writer import IndexType, Writer

from catheter.bench import ML, Bench, Noise, Plant, Schedule, simulate
from catheter.lab import cli
from catheter.lab.recording_commands import SHIPPED
from data import message
from data.container import MAGIC
from data.errors import BadInput, CannotWrite, DamagedRecording
from data.files import check_free, check_inputs
from data.recorder import Recorder
from data.recording import Recording
from data.signal import Signal
from data.topics import Topic, standard


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    code = cli.run([str(argument) for argument in arguments])
    printed = capsys.readouterr()
    return code, printed.out, printed.err


@pytest.fixture
def small(tmp_path: Path) -> Path:
    path = tmp_path / "small.mcap"
    with Recorder(path, SIMULATED, scene='[scene]\nkind = "recording"\ntitle = "t"\n', truth={"k": "1"}) as recorder:
        recorder.add(standard("/force"))
        for i in range(30):
            recorder.write("/force", i / 83, i)
    return path


def test_no_bit_of_a_file_can_change_what_is_read_in_silence(small: Path, tmp_path: Path) -> None:
    content, damaged = small.read_bytes(), tmp_path / "damaged.mcap"
    with Recording(small) as recording:
        expected = (recording.kind, recording.metadata, recording.signal("/force").value.tolist(), recording.channels)
    draw = np.random.default_rng(11)
    for bit in draw.choice(8 * len(content), 1500, replace=False):
        flipped = bytearray(content)
        flipped[bit // 8] ^= 1 << bit % 8
        damaged.write_bytes(flipped)
        try:
            with Recording(damaged) as recording:
                read = recording.kind, recording.metadata, recording.signal("/force").value.tolist(), recording.channels
        except (BadInput, UserWarning):  # the suite makes a warning of a cut an error
            continue
        assert read == expected, f"bit {bit % 8} of byte {bit // 8}"


@pytest.mark.parametrize("tail", [b"x", MAGIC, b"\0" * 500])
def test_what_follows_the_end_of_a_recording_is_refused(small: Path, tail: bytes) -> None:
    small.write_bytes(small.read_bytes() + tail)
    with pytest.raises(DamagedRecording, match="not the end of the file"):
        Recording(small)


def chunk_file(path: Path, packed: bytes, size: int, compression: bytes, checksum: int = 0) -> Path:
    head = struct.pack("<QQQII", 0, 1, size, checksum, len(compression)) + compression
    chunk = head + struct.pack("<Q", len(packed)) + packed
    library = b"other"
    header = struct.pack("<I", 0) + struct.pack("<I", len(library)) + library
    records = b"".join(struct.pack("<BQ", code, len(body)) + body for code, body in ((1, header), (6, chunk)))
    path.write_bytes(MAGIC + records)
    return path


def frame(size: int) -> bytes:
    """A zstd frame of `size` zeros whose head does not say so, or says it falsely, is still small."""
    return zstandard.ZstdCompressor(write_content_size=False).compress(b"\0" * size)


@pytest.mark.parametrize("claimed", [100, 10_000_000, 2**40])
@pytest.mark.parametrize("known", [True, False])
def test_a_bomb_is_refused_without_unpacking_it(tmp_path: Path, claimed: int, known: bool) -> None:
    packed = zstandard.compress(b"\0" * 300_000_000) if known else frame(300_000_000)
    path = chunk_file(tmp_path / "bomb.mcap", packed, claimed, b"zstd")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(DamagedRecording, match="chunk at byte"):
        Recording(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB


def test_many_tiny_messages_and_records_stay_small(tmp_path: Path) -> None:
    import tracemalloc

    for record in (struct.pack("<BQ", 5, 22) + b"\0" * 22, struct.pack("<BQ", 0x90, 0)):
        unpacked = record * (30_000_000 // len(record))
        path = chunk_file(tmp_path / "tiny.mcap", zstandard.compress(unpacked), len(unpacked), b"zstd")
        tracemalloc.start()
        with suppress(DamagedRecording, UserWarning):
            Recording(path)
        used = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert used < 100e6 + 2 * path.stat().st_size


@pytest.mark.parametrize("compression", [b"", b"lz4", b"brotli", b"\xff\xfe", b"zstd"])
def test_rubbish_in_a_chunk_is_refused(tmp_path: Path, compression: bytes) -> None:
    path = chunk_file(tmp_path / "rubbish.mcap", os.urandom(500), 500, compression, zlib.crc32(b"x"))
    with pytest.raises(DamagedRecording, match="chunk at byte"):
        Recording(path)


def foreign(path: Path, stamps: list[int], unit: str = "N", topic: str = "/force", **options: object) -> Path:
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start()
        schema = writer.register_schema("catheter.Force", "protobuf", message.schema("catheter.Force", ("force",)))
        channel = writer.register_channel(topic, "protobuf", schema, {"unit": unit})
        for stamp in stamps:
            writer.add_message(channel, stamp, message.encode(np.array([[1.5]])).tobytes(), stamp)
        writer.finish()
    return path


def test_a_stamp_beyond_all_clocks_is_refused(tmp_path: Path) -> None:
    path = foreign(tmp_path / "late.mcap", [0, 2**63 + 5])
    with pytest.raises(DamagedRecording, match="year 2262"), Recording(path) as recording:
        recording.signal("/force")


@pytest.mark.parametrize("options", [{"use_chunking": False}, {"repeat_channels": False, "repeat_schemas": False}])
def test_files_of_other_writers_are_read(tmp_path: Path, options: dict) -> None:
    with Recording(foreign(tmp_path / "a.mcap", [5, 10, 20], **options)) as recording:
        assert recording.signal("/force").value.tolist() == [1.5, 1.5, 1.5]
        assert recording.channels["/force"].messages == 3


def test_a_unit_with_brackets_and_escapes_is_shown_as_it_is(tmp_path: Path, capsys) -> None:
    path = foreign(tmp_path / "a.mcap", list(range(0, 10**9, 10**7)), unit="[/red]\x1b[31m")
    code, out, err = run(capsys, "replay", path, "--no-view")
    assert (code, err) == (0, "")
    assert "\x1b" not in out


def test_a_chunk_head_that_lies_about_time_is_refused(tmp_path: Path) -> None:
    path = foreign(tmp_path / "a.mcap", [10**18, 10**18 + 5], index_types=IndexType.NONE)
    content = bytearray(path.read_bytes())
    at = content.index(struct.pack("<QQ", 10**18, 10**18 + 5))
    content[at + 8 : at + 16] = bytes(8)
    path.write_bytes(content)
    with Recording(path) as recording, pytest.raises(DamagedRecording, match="its head says otherwise"):
        recording.signal("/force")


def test_a_summary_without_schemas_is_no_damage(tmp_path: Path) -> None:
    with Recording(foreign(tmp_path / "a.mcap", [1, 2], repeat_schemas=False)) as recording:
        assert len(recording.signal("/force")) == 2


def test_every_border_of_a_window_falls_on_the_right_side(tmp_path: Path) -> None:
    time_s = np.arange(300) / 83
    with Recorder(tmp_path / "a.mcap", SIMULATED, start_ns=1_763_000_000_000_000_001) as recorder:
        recorder.add(standard("/force"))
        recorder.write_signals({"/force": Signal(time_s, time_s, "N")})
    with Recording(tmp_path / "a.mcap") as recording:
        whole = recording.signal("/force")
        for first in range(0, 295):
            borders = whole.time_s[first], whole.time_s[first + 5]
            assert len(recording.signal("/force", start_s=borders[0], end_s=borders[1])) == 5
        assert len(recording.signal("/force", start_s=-np.inf, end_s=np.inf)) == 300
        for start_s in (1e10, np.inf):
            assert len(recording.signal("/force", start_s=start_s)) == 0
        with pytest.raises(BadInput, match="NaN"):
            recording.signal("/force", start_s=np.nan)


def test_a_pipe_is_no_file(tmp_path: Path, capsys) -> None:
    os.mkfifo(tmp_path / "pipe.mcap")
    os.mkfifo(tmp_path / "pipe.toml")
    pipe, toml = tmp_path / "pipe.mcap", tmp_path / "pipe.toml"
    for arguments in (
        ("replay", pipe),
        ("import", pipe, "--mapping", "zillen", "--out", tmp_path / "o.mcap"),
        ("import", SHIPPED, "--mapping", toml, "--out", tmp_path / "o.mcap"),
        ("record", toml, "--out", tmp_path / "o.mcap"),
        ("replay", "/dev/zero"),
    ):
        code, _, err = run(capsys, *arguments)
        assert code == 2
        assert "is no regular file" in err


def test_an_input_is_never_overwritten_not_even_by_force(tmp_path: Path, capsys) -> None:
    log, mapping, copy = tmp_path / "log.csv", tmp_path / "map.toml", tmp_path / "copy.mcap"
    log.write_text("0,1,2\n")
    mapping.write_text("x = 1")
    copy.write_bytes(SHIPPED.read_bytes())
    for arguments in (
        ("import", log, "--mapping", mapping, "--out", mapping, "--force"),
        ("replay", copy, "--out", copy, "--force"),
        ("record", mapping, "--out", mapping, "--force"),
    ):
        code, _, err = run(capsys, *arguments)
        assert code == 2
        assert "is an input of the same command" in err
    with pytest.raises(CannotWrite, match="an input"):
        check_inputs(log, log)
    (tmp_path / "dangling").symlink_to(tmp_path / "nowhere")
    with pytest.raises(CannotWrite, match="link to nothing"):
        check_free(tmp_path / "dangling")


def test_a_failed_recording_without_data_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), Recorder(tmp_path / "a.mcap", SIMULATED) as recorder:
        recorder.add(standard("/force"))
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("call", "found"),
    [
        (lambda r: r.note("x", {"a": 1}), "expected text"),
        (lambda r: r.note("origin", {"kind": "measured"}), "written by the recorder itself"),
        (lambda r: r.write("/force", 0.0, "much"), "expected numbers"),
        (lambda r: r.write("/force", "soon", 1.0), "expected numbers"),
    ],
)
def test_a_wrong_call_harms_no_recording(tmp_path: Path, call, found: str) -> None:
    with Recorder(tmp_path / "a.mcap", SIMULATED) as recorder:
        recorder.add(standard("/force"))
        recorder.write("/force", 0.0, 1.0)
        with pytest.raises(BadInput, match=found):
            call(recorder)
    with Recording(tmp_path / "a.mcap") as recording:
        assert (recording.kind, len(recording.signal("/force"))) == ("simulated", 1)


@pytest.mark.parametrize("start_ns", [-1, 2**63, 1.5])
def test_a_start_no_clock_shows_is_refused(tmp_path: Path, start_ns) -> None:
    with pytest.raises(BadInput, match="start_ns"):
        Recorder(tmp_path / "a.mcap", SIMULATED, start_ns=start_ns)
    with pytest.raises(BadInput, match="expected text"):
        Recorder(tmp_path / "a.mcap", {"kind": "measured", "who": 3})


@pytest.mark.parametrize("options", [{"rate": 2.0}, {"rate": 40.0, "lag": 1e-3}, {"rate": 1.0}, {"bandwidth": 500.0}])
def test_the_bench_stays_stable_when_it_is_stiff(options: dict) -> None:
    schedule = Schedule(levels=1, chirp=20.0, chirp_from=0.05, chirp_to=0.4)
    run = simulate(schedule, Bench(**options), Plant(), Noise())
    assert run.volume_m3.max() < 30 * ML
    assert np.abs(run.force_n).max() < 100


@pytest.mark.parametrize(
    ("bench", "plant", "found"),
    [
        (Bench(speed=1e200, stroke_volume=1e200), Plant(), "not finite"),
        (Bench(), Plant(cubic=1e308), "not finite"),
        (Bench(rate=1e5), Plant(), "steps"),
        (Bench(lag=1e-3, bandwidth=1e9), Plant(), "steps"),
    ],
)
def test_a_bench_that_cannot_be_simulated_is_refused(bench: Bench, plant: Plant, found: str) -> None:
    with pytest.raises(BadInput, match=found):
        simulate(Schedule(), bench, plant, Noise())


@pytest.mark.parametrize("value", ["1" + "0" * 400, "1" + "0" * 5000, "0x" + "f" * 5000])
def test_numbers_too_large_for_any_machine_are_refused(tmp_path: Path, capsys, value: str) -> None:
    scene = tmp_path / "s.toml"
    scene.write_text(f'[scene]\nkind = "bender"\ntitle = "t"\n[drive]\nlevels = {value}\n')
    code, _, err = run(capsys, "record", scene, "--out", tmp_path / "o.mcap")
    assert code == 2
    assert len(err.splitlines()) == 1


def test_a_recording_whose_scene_is_broken_is_still_replayed(tmp_path: Path, capsys) -> None:
    time_s = np.linspace(0, 20, 500)
    with Recorder(tmp_path / "a.mcap", SIMULATED, scene="[scene\n") as recorder:
        recorder.add(Topic(name="/force", components=("force",), units=("N",)))
        recorder.write_signals({"/force": Signal(time_s, np.sin(time_s), "N")})
    code, out, _ = run(capsys, "replay", tmp_path / "a.mcap", "--no-view")
    assert code == 0
    assert "Left out: the questions of its scene" in out


@pytest.mark.parametrize(
    ("arguments", "code"),
    [(("table", "3.3"), 0), (("replay", "--no-view"), 0), (("table", "3.33"), 2)],
)
def test_without_standard_output_nothing_breaks(tmp_path: Path, arguments: tuple[str, ...], code: int) -> None:
    command = f"{sys.executable} -m catheter {' '.join(arguments)} >&-"
    done = subprocess.run(command, shell=True, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60)
    assert "Traceback" not in done.stderr
    assert done.returncode == code
    done = subprocess.run(
        command.replace(">&-", "--json > /dev/full"),
        shell=True,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert "Traceback" not in done.stderr
    assert done.returncode == 2


def test_wrong_arguments_are_one_sentence_too(tmp_path: Path) -> None:
    done = catheter("replay", "--split", "thirds", "--json", cwd=tmp_path)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert done.stdout.startswith('{"error"')


@pytest.mark.parametrize("seconds", [1e308, 1e9, 1e-3])
def test_a_ramp_too_long_or_too_short_to_sample_is_refused(seconds: float) -> None:
    from catheter.bench_runs import ConeValve, PressureRamp, Sensors, cracking

    with pytest.raises(BadInput, match=r"\[drive\] seconds: .* samples a ramp"):
        cracking(PressureRamp(seconds=seconds), ConeValve(), Sensors(rate=500.0))


def test_no_error_prints_a_control_character(capsys) -> None:
    code, _, err = run(capsys, "replay", "\x1b[31m\x00.mcap")
    assert code == 2
    assert err.endswith(".mcap: cannot be read: embedded null byte; name a file\n")
    assert err.removesuffix("\n").isprintable()


def test_noise_that_overflows_is_refused() -> None:
    with pytest.raises(BadInput, match="not finite"):
        simulate(Schedule(levels=1, chirp=0.0), Bench(), Plant(), Noise(force=1e300, force_step=1e-9))


def test_a_report_never_overwrites_its_own_recording(tmp_path: Path, capsys) -> None:
    inside = tmp_path / "hysteresis.csv"
    inside.write_bytes(SHIPPED.read_bytes())
    arguments = ("report", "hysteresis", "--quick", "--recording", inside, "--out", tmp_path, "--force")
    code, _, err = run(capsys, *arguments)
    assert code == 2
    assert "is an input" in err
    assert inside.read_bytes() == SHIPPED.read_bytes()


def test_a_report_overwrites_nothing_unasked(tmp_path: Path, capsys) -> None:
    (tmp_path / "hysteresis.csv").write_text("mine")
    code, _, err = run(capsys, "report", "hysteresis", "--quick", "--out", tmp_path)
    assert code == 2
    assert "not overwritten" in err
    assert (tmp_path / "hysteresis.csv").read_text() == "mine"
