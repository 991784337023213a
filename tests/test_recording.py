"""What is recorded is read back, bit for bit, whatever happens in between."""

import os
import signal as signals
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
from google.protobuf import descriptor_pool, message_factory
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from helpers import SIMULATED
from mcap.reader import make_reader

from data.errors import BadInput, CannotWrite, DamagedRecording, RecordingCut
from data.recorder import Recorder
from data.recording import Recording
from data.signal import Signal
from data.topics import STANDARD, Topic, standard


def odd_numbers(n: int) -> np.ndarray:
    draw = np.random.default_rng(7)
    values = draw.normal(size=n) * 10.0 ** draw.integers(-300, 300, n)
    values[:6] = [0.0, -0.0, np.nan, np.inf, -np.inf, 5e-324]
    return values


@pytest.mark.parametrize("size", [1, 3, 15, 16, 40])  # from field 16 on, protobuf tags have two bytes
def test_round_trip_is_exact_for_any_number_of_components(tmp_path: Path, size: int) -> None:
    names = tuple(f"c{i}" for i in range(size))
    values = odd_numbers(50 * size).reshape(50, size)
    time_s = np.cumsum(np.random.default_rng(2).uniform(1e-4, 1, 50))
    with Recorder(tmp_path / "a.mcap", SIMULATED) as recorder:
        recorder.add(Topic(name="/many", components=names, units=("1",) * size))
        recorder.write_signals({"/many": Signal(time_s, values, "1")})
    with Recording(tmp_path / "a.mcap") as recording:
        read = recording.signal("/many")
        assert read.value.reshape(50, size).tobytes() == values.tobytes()
        assert read.components == (names if size > 1 else ())


def test_stamps_are_rounded_to_the_nearest_nanosecond(recorded: Path) -> None:
    with Recording(recorded) as recording:
        read = recording.signal("/force").time_s
    assert np.abs(read - np.arange(20_000) / 83).max() < 0.501e-9


def test_many_fields_are_what_protobuf_itself_reads() -> None:
    from data import message
    from data.chunk import Messages

    names = tuple(f"c{i}" for i in range(40))
    pool = descriptor_pool.DescriptorPool()
    pool.Add(FileDescriptorSet.FromString(message.schema("catheter.Many", names)).file[0])
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName("catheter.Many"))
    values = odd_numbers(40)
    read = kind.FromString(message.encode(values[None, :]).tobytes())
    assert np.array([getattr(read, name) for name in names]).tobytes() == values.tobytes()
    again = Messages.of_one(1, 0, read.SerializeToString())
    assert message.decode(again, 40, "here").tobytes() == values.tobytes()


def test_messages_are_what_protobuf_itself_reads(recorded: Path) -> None:
    with recorded.open("rb") as file:
        plain = make_reader(file, validate_crcs=True)
        rows = {"/force": [], "/pressure": []}
        for schema, channel, message in plain.iter_messages():
            files = FileDescriptorSet.FromString(schema.data).file
            pool = descriptor_pool.DescriptorPool()
            for one in files:
                pool.Add(one)
            kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
            rows[channel.topic].append(kind.FromString(message.data).value)
            if len(rows["/pressure"]) == 300:
                break
    with Recording(recorded) as recording:
        for name, values in rows.items():
            assert recording.signal(name).value[:300].tolist() == values[:300]


def test_a_window_equals_the_same_part_of_the_whole_and_blocks_join_to_it(recorded: Path) -> None:
    with Recording(recorded) as recording:
        whole = recording.signal("/force")
        part = recording.signal("/force", start_s=100.0, end_s=200.0)  # both are samples
        expected = whole.window(100.0, 200.0)
        assert (part.time_s[0], len(part)) == (100.0, 8300)
        assert part.value.tolist() == expected.value.tolist()
        assert part.time_s.tolist() == expected.time_s.tolist()
        blocks = list(recording.blocks("/force"))
        assert len(blocks) > 1  # the file has several chunks, and a block is one
        assert np.concatenate([block.value for block in blocks]).tolist() == whole.value.tolist()


def test_a_window_reads_only_its_chunks(recorded: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from data import container

    opened = []
    real = container.chunk_records
    with Recording(recorded) as recording:
        monkeypatch.setattr(container, "chunk_records", lambda *a: opened.append(a[1]) or real(*a))
        recording.signal("/force", start_s=0.0, end_s=1.0)
    assert len(opened) == 1


def test_memory_does_not_grow_with_the_length_of_the_file(tmp_path: Path) -> None:
    import tracemalloc

    def peak(samples: int) -> int:
        path = tmp_path / f"{samples}.mcap"
        with Recorder(path, SIMULATED, flush_s=None) as recorder:
            recorder.add(standard("/force"))
            for first in range(0, samples, 10_000):
                time_s = (first + np.arange(10_000)) / 83
                recorder.write_signals({"/force": Signal(time_s, np.zeros(10_000), "N")})
        tracemalloc.start()
        with Recording(path) as recording:
            total = sum(len(block) for block in recording.blocks("/force"))
        used = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert total == samples
        return used

    peak(30_000)  # what is imported on first use is not counted
    assert peak(1_280_000) < 2 * peak(160_000)  # one to three chunks, by how far the threads are ahead


def test_pictures_come_back_one_by_one(tmp_path: Path) -> None:
    pictures = [os.urandom(1000 + i) for i in range(30)]
    with Recorder(tmp_path / "c.mcap", SIMULATED) as recorder:
        recorder.add(STANDARD["/camera/top"])
        for i, picture in enumerate(pictures):
            recorder.write_picture("/camera/top", i / 30, picture, "jpeg")
    with Recording(tmp_path / "c.mcap") as recording:
        read = recording.pictures("/camera/top", start_s=0.5)
        first = next(read)
        assert (first.time_s, first.format, first.data) == (0.5, "jpeg", pictures[15])
        assert [picture.data for picture in read] == pictures[16:]
        with pytest.raises(BadInput, match="is a camera"):
            recording.signal("/camera/top")


def test_pandas_frame_holds_the_signals_with_their_units(recorded: Path) -> None:
    with Recording(recorded) as recording:
        frame = recording.to_frame()
        assert list(frame.columns) == ["/force [N]", "/pressure [Pa]"]
        assert frame["/force [N]"].to_numpy().tolist() == recording.signal("/force").value.tolist()


def test_metadata_say_simulated_or_measured_and_hold_scene_and_truth(tmp_path: Path) -> None:
    with Recorder(tmp_path / "m.mcap", SIMULATED, scene="[scene]\n", truth={"k": "1.5"}) as recorder:
        recorder.add(Topic(name="/tip", components=("x", "y"), units=("m", "m"), frame="base", rate_hz=83.0))
    with Recording(tmp_path / "m.mcap") as recording:
        assert (recording.kind, recording.scene, recording.metadata["truth"]) == (
            "simulated",
            "[scene]\n",
            {"k": "1.5"},
        )
        topic = recording.channels["/tip"].topic
        assert (topic.units, topic.frame, topic.rate_hz) == (("m", "m"), "base", 83.0)
        assert len(recording.signal("/tip")) == 0
    with pytest.raises(BadInput, match="'simulated' or 'measured'"):
        Recorder(tmp_path / "n.mcap", {"who": "me"})


def test_components_in_different_units_are_read_one_by_one(tmp_path: Path) -> None:
    with Recorder(tmp_path / "v.mcap", SIMULATED) as recorder:
        recorder.add(standard("/volume"))
        recorder.write("/volume", 0.0, [1e-5, 1.3])
    with Recording(tmp_path / "v.mcap") as recording:
        assert recording.signal("/volume", "ratio").unit == "1"
        assert recording.signal("/volume", "volume").value.tolist() == [1e-5]
        with pytest.raises(BadInput, match="name one of"):
            recording.signal("/volume")


def test_an_older_file_stays_until_the_new_one_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"older")
    with pytest.raises(CannotWrite, match="not overwritten"), Recorder(path, SIMULATED):
        pass
    with pytest.raises(ZeroDivisionError), Recorder(path, SIMULATED, replace=True) as recorder:
        recorder.add(standard("/force"))
        recorder.write("/force", 0.0, 1.5)
        raise ZeroDivisionError
    assert path.read_bytes() == b"older"
    with Recording(tmp_path / "run.partial.mcap") as recording:  # what was recorded is kept
        assert recording.signal("/force").value.tolist() == [1.5]
    with Recorder(path, SIMULATED, replace=True) as recorder:
        assert recorder.partial.name == "run.partial-2.mcap"  # nor is the partial file overwritten
        recorder.add(standard("/force"))
        assert path.read_bytes() == b"older"
    with Recording(path) as recording:
        assert recording.cut is None


KILLED = """
import sys, time
from data.recorder import Recorder
from data.topics import standard
with Recorder(sys.argv[1], {"kind": "measured"}, flush_s=0.2) as recorder:
    recorder.add(standard("/force"))
    for i in range(100):
        recorder.write("/force", i * 0.01, i)
    print("written", flush=True)
    time.sleep(60)  # no further message: the timer alone must flush
"""


def test_a_killed_writer_leaves_a_readable_file(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with subprocess.Popen([sys.executable, "-c", KILLED, str(path)], stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == "written\n"
        time.sleep(1.0)  # five flush intervals
        writer.send_signal(signals.SIGKILL)
    assert not path.exists()
    with pytest.warns(RecordingCut, match="cut off"), Recording(tmp_path / "run.partial.mcap") as recording:
        assert recording.signal("/force").value.tolist() == list(range(100))


FULL = """
import resource, sys
import numpy as np
from data.recorder import Recorder
from data.signal import Signal
from data.topics import standard
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
with Recorder(sys.argv[1], {"kind": "measured"}, flush_s=None) as recorder:
    recorder.add(standard("/force"))
    values = np.random.default_rng(1).normal(size=50_000)
    recorder.write_signals({"/force": Signal(np.arange(50_000.0), values, "N")})
"""


def test_a_full_disk_is_one_sentence_and_keeps_what_was_written(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    done = subprocess.run([sys.executable, "-c", FULL, path], capture_output=True, text=True, check=False)
    assert "CannotWrite" in done.stderr
    assert "cannot be written" in done.stderr
    assert "is kept in" in done.stderr.splitlines()[-1]
    assert not path.exists()
    assert (tmp_path / "run.partial.mcap").exists()


@pytest.mark.parametrize(
    ("call", "found"),
    [
        (lambda r: r.write("/pressure", 0.0, 1.0), "was not added"),
        (lambda r: r.write("/force", 0.0, [1.0, 2.0]), "shape"),
        (lambda r: r.write("/force", float("nan"), 1.0), "time is nan"),
        (lambda r: (r.write("/force", 1.0, 1.0), r.write("/force", 1.0, 1.0)), "does not come after"),
        (lambda r: r.write_signals({"/force": Signal([0.0], [1.0], "Pa")}), "the topic is in"),
        (lambda r: r.add(standard("/force")), "added before"),
        (lambda r: r.write_picture("/force", 0.0, b"x"), "no camera"),
        (lambda r: r.write("/force", -1.0, 1.0), "before 1970"),
    ],
)
def test_what_no_reader_could_trust_is_refused(tmp_path: Path, call, found: str) -> None:
    with pytest.raises(BadInput, match=found), Recorder(tmp_path / "run.mcap", SIMULATED) as recorder:
        recorder.add(standard("/force"))
        call(recorder)


def test_listed_topics_come_by_name_and_number_and_units_must_be_si(tmp_path: Path) -> None:
    assert standard("/pressure/2").name == "/pressure/2"
    with pytest.raises(BadInput, match="'/presure': is not listed|did you mean '/pressure'"):
        standard("/presure")
    with Recorder(tmp_path / "run.mcap", SIMULATED) as recorder:
        recorder.add(standard("/pressure/2"))
        recorder.write("/pressure/2", 0.0, 1.0)
        for unit in ("kPa", "banana"):
            with pytest.raises(BadInput, match=unit):
                recorder.add(Topic(name="/other", components=("x",), units=(unit,)))


def test_a_recorder_outside_its_block_is_refused(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "run.mcap", SIMULATED)
    with pytest.raises(BadInput, match="not open"):
        recorder.add(standard("/force"))
    with recorder:
        recorder.add(standard("/force"))
    with pytest.raises(BadInput, match="not open"):
        recorder.write("/force", 0.0, 1.0)


def test_a_cut_file_is_read_up_to_the_cut(recorded: Path, tmp_path: Path) -> None:
    content = recorded.read_bytes()
    with Recording(recorded) as recording:
        whole = recording.signal("/force").value
    for share in (0.6, 0.9, 0.99):
        cut = tmp_path / f"cut{share}.mcap"
        cut.write_bytes(content[: int(share * len(content))])
        with pytest.warns(RecordingCut, match=r"cut off after \d+ bytes"), Recording(cut) as recording:
            part = recording.signal("/force").value
        assert 0 < len(part) <= len(whole)
        assert part.tolist() == whole[: len(part)].tolist()


def test_every_cut_is_noticed_and_none_crashes(tmp_path: Path) -> None:
    path, cut = tmp_path / "small.mcap", tmp_path / "cut.mcap"
    with Recorder(path, SIMULATED) as recorder:
        recorder.add(standard("/force"))
        for i in range(5):
            recorder.write("/force", i, i)
    content = path.read_bytes()
    for size in range(1, len(content)):
        cut.write_bytes(content[:size])
        with pytest.warns(RecordingCut):
            recording = Recording(cut)
        with recording:
            if "/force" in recording.channels:
                assert recording.signal("/force").value.tolist() == [0, 1, 2, 3, 4]


def test_a_flipped_bit_in_a_chunk_never_gives_a_different_number(recorded: Path, tmp_path: Path) -> None:
    content = recorded.read_bytes()
    with Recording(recorded) as recording:
        whole = recording.signal("/force").value.tobytes()
        chunk = recording._contents.chunks[1].place
    damaged, noticed = tmp_path / "damaged.mcap", 0
    for bit in range(0, 8 * (chunk.length - 40), 8 * chunk.length // 40):
        flipped = bytearray(content)
        flipped[chunk.offset + 40 + bit // 8] ^= 1 << bit % 8
        damaged.write_bytes(flipped)
        with Recording(damaged) as recording:
            try:  # a few bits of a zstd frame say nothing about its content
                assert recording.signal("/force").value.tobytes() == whole
            except DamagedRecording as error:
                noticed += f"chunk at byte {chunk.offset}" in str(error)
    assert noticed >= 35


@pytest.mark.parametrize(
    ("content", "found"),
    [(b"", "is empty"), (b"time,force\n0,1\n", "expected an MCAP"), (b"\x89MCAP0\r\n", None)],
)
def test_what_is_no_recording_is_refused(tmp_path: Path, content: bytes, found: str | None) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    if found is None:
        with pytest.warns(RecordingCut, match="before its first complete chunk"), Recording(path) as recording:
            assert recording.channels == {}
    else:
        with pytest.raises(BadInput, match=found):
            Recording(path)
    with pytest.raises(BadInput, match="cannot be read"):
        Recording(tmp_path / "missing.mcap")


def test_changed_times_and_a_changed_summary_are_noticed(recorded: Path, tmp_path: Path) -> None:
    content, damaged = recorded.read_bytes(), tmp_path / "damaged.mcap"
    with Recording(recorded) as recording:
        chunk = recording._contents.chunks[0].place
    summary = int.from_bytes(content[-28:-20], "little")  # the footer's first field
    for at, found in (
        (chunk.offset, "not as its summary lists it"),  # the chunk's start time
        (chunk.offset + 8, "not as its summary lists it"),
        *(
            (at, "fails its checksum|summary|record cannot be read")
            for at in range(summary + 9, len(content) - 37, 101)
        ),
    ):
        flipped = bytearray(content)
        flipped[at] ^= 1
        damaged.write_bytes(flipped)
        with pytest.raises(DamagedRecording, match=found), warnings.catch_warnings():
            warnings.simplefilter("ignore", RecordingCut)
            Recording(damaged)


def stamped(path: Path, *chunks: tuple[int, ...]) -> Path:
    """Write one force at each stamp (ns), chunk by chunk, as our recorder would refuse to."""
    from mcap.writer import Writer

    from data import message

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("catheter.Force", "protobuf", message.schema("catheter.Force", ("force",)))
        channel = writer.register_channel("/force", "protobuf", schema)
        for stamps in chunks:
            for stamp in stamps:
                writer.add_message(channel, stamp, message.encode(np.array([[1.0]])).tobytes(), stamp)
            writer.flush()
        writer.finish()
    return path


def test_time_running_backwards_from_one_chunk_to_the_next_is_refused(tmp_path: Path) -> None:
    path = stamped(tmp_path / "back.mcap", (2_000_000_000,), (1_000_000_000,))
    with Recording(path) as recording, pytest.raises(BadInput, match="from 1 s to 0 s"):
        list(recording.blocks("/force"))


def test_time_running_backwards_in_a_file_is_refused(tmp_path: Path) -> None:
    path = stamped(tmp_path / "back.mcap", (0, 2_000_000_000, 1_000_000_000))
    with Recording(path) as recording, pytest.raises(BadInput, match=r"/force, sample 2.*from 2 s to 1 s"):
        recording.signal("/force")


def test_a_foreign_topic_is_listed_and_refused_by_its_encoding(real: Path) -> None:
    with Recording(real / "mcap" / "wrong_rmw_test_0.mcap") as recording:
        reasons = [channel.unreadable for channel in recording.channels.values()]
        assert reasons
        assert all("wrong_format" in reason for reason in reasons)
        with pytest.raises(BadInput, match="encoding 'wrong_format'"):
            recording.signal(next(iter(recording.channels)))


def test_every_message_of_the_real_bags_is_iterated_even_where_its_numbers_cannot_be_had(real: Path) -> None:
    texts = set()
    for path in sorted((real / "mcap").glob("*.mcap")):
        with Recording(path) as recording, path.open("rb") as file:
            plain: dict[str, list[bytes]] = {}
            for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
                plain.setdefault(channel.topic, []).append(message.data)
            for topic in recording.channels:
                assert [content for _, content in recording.messages(topic)] == plain.get(topic, [])
            texts |= {topic for topic, channel in recording.channels.items() if channel.unreadable}
    assert texts  # std_msgs/String among them


def test_a_window_says_that_it_verified_only_what_it_read(recorded: Path) -> None:
    with Recording(recorded) as recording:
        total = len(recording._contents.chunks)
        recording.signal("/force", start_s=0.0, end_s=0.01)
        assert recording.verified.startswith(f"1 of {total} chunks")
        recording.signal("/force")
        recording.signal("/force")
        assert recording.verified.startswith(f"{total} of {total} chunks")
        assert total > 1


def test_rerun_opens_our_recording_by_itself_and_shows_frames(tmp_path: Path) -> None:
    import cv2

    _, jpeg = cv2.imencode(".jpg", np.full((48, 64, 3), 90, np.uint8))
    with Recorder(tmp_path / "r.mcap", SIMULATED) as recorder:
        recorder.add(STANDARD["/camera/top"])
        recorder.add(standard("/force"))
        for i in range(4):
            recorder.write_picture("/camera/top", i / 10, jpeg.tobytes(), "jpeg")
            recorder.write("/force", i / 10, i)
    rerun = Path(sys.executable).with_name("rerun")
    out = tmp_path / "r.rrd"
    command = [rerun, "mcap", "convert", tmp_path / "r.mcap", "-o", out]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    printed = subprocess.run([rerun, "rrd", "print", "-vv", out], check=True, capture_output=True, text=True).stdout
    assert "EncodedImage:blob" in printed
    assert "catheter.Force:message" in printed
