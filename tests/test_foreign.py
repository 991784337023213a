"""Recordings by other tools: numbers in JSON and ROS 2 CDR, against independent decoders."""

import base64
import json
import struct
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

from data.cdr import PRIMITIVES, cdr
from data.chunk import Messages
from data.decimals import number, powers
from data.errors import BadInput, DamagedRecording
from data.json_messages import json_decoder
from data.recording import Recording

DRAW = np.random.default_rng(12)


class Oracle:
    """A plain CDR writer, value by value: what the reader must agree with."""

    def __init__(self, order: str) -> None:
        self.order, self.content = order, bytearray(b"\0\1\0\0" if order == "<" else b"\0\0\0\0")

    def put(self, kind: str, value: object) -> None:
        code = {"?": "?", "u1": "B", "i1": "b", "u2": "H", "i2": "h", "u4": "I", "i4": "i", "u8": "Q", "i8": "q"}
        letter = {**code, "f4": "f", "f8": "d"}[kind]
        self.align(struct.calcsize(letter))
        self.content += struct.pack(self.order + letter, value)

    def align(self, size: int) -> None:
        self.content += b"\0" * (-(len(self.content) - 4) % size)

    def string(self, text: str) -> None:
        self.put("u4", len(text) + 1)
        self.content += text.encode() + b"\0"


def messages_of(contents: list[bytes]) -> Messages:
    lengths = np.array([len(content) for content in contents], np.int64)
    offsets = np.concatenate([[0], np.cumsum(lengths)[:-1]])
    zeros = np.zeros(len(contents), np.int64)
    return Messages(np.frombuffer(b"".join(contents), np.uint8), zeros.astype(np.uint16), zeros, offsets, lengths)


def value_of(kind: str) -> object:
    if kind == "?":
        return bool(DRAW.integers(2))
    if kind in ("f4", "f8"):
        return float(np.dtype(kind).type(DRAW.normal()))
    info = np.iinfo(kind)
    return int(DRAW.integers(max(info.min, -(2**53)), min(info.max, 2**53)))


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("seed", range(25))
def test_random_definitions_are_read_as_an_independent_writer_wrote_them(order: str, seed: int) -> None:
    draw = np.random.default_rng(seed)
    kinds = list(PRIMITIVES.items())
    fields = []
    for i in range(draw.integers(1, 12)):
        name, kind = kinds[draw.integers(len(kinds))]
        shape = ["", "[3]", "[]", "string"][draw.integers(4)]
        fields.append((f"f{i}", name, kind, shape))
    lines = [f"{'string' if shape == 'string' else name + shape} {field}" for field, name, _, shape in fields]
    definition = "# made up\nint32 CONSTANT=7\n" + "\n".join(lines) + "\nfloat64 last\n"
    decoder = cdr("made_up/Type", definition)
    contents, expected = [], []
    for _ in range(20):
        oracle, row = Oracle(order), []
        for _, _, kind, shape in fields:
            if shape == "string":
                oracle.string("x" * int(draw.integers(0, 4)))
                continue
            count = {"": 1, "[3]": 3, "[]": int(draw.integers(0, 4))}[shape]
            if shape == "[]":
                oracle.put("u4", count)
            values = [value_of(kind) for _ in range(count)]
            for value in values:
                oracle.put(kind, value)
            row += [] if shape == "[]" else values
        last = float(DRAW.normal())
        oracle.put("f8", last)
        contents.append(bytes(oracle.content))
        expected.append([*map(float, row), last])
    assert decoder.decode(messages_of(contents), "here").tolist() == expected


def test_nested_types_and_headers() -> None:
    definition = (
        "std_msgs/Header header\nPoint[2] at\nEmpty nothing\nfloat64 force\n"
        "=====\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
        "=====\nMSG: made_up/Point\nfloat64 x\nfloat32 y\n"
        "=====\nMSG: made_up/Empty\n"
    )
    decoder = cdr("made_up/msg/Load", definition)
    names = ("header_stamp_sec", "header_stamp_nanosec", "at_0_x", "at_0_y", "at_1_x", "at_1_y", "force")
    assert decoder.components == names
    oracle = Oracle("<")
    oracle.put("i4", 5), oracle.put("u4", 6), oracle.string("base")
    for x, y in ((1.5, 2.5), (3.5, 4.5)):
        oracle.put("f8", x), oracle.put("f4", y)
    oracle.put("u1", 0), oracle.put("f8", 9.25)
    assert decoder.decode(messages_of([bytes(oracle.content)]), "here").tolist() == [[5, 6, 1.5, 2.5, 3.5, 4.5, 9.25]]


def test_a_message_shorter_than_its_definition_is_damage() -> None:
    decoder = cdr("a/B", "string s\nfloat64 x\n")
    for content in (b"", b"\0\1\0\0", b"\0\1\0\0\xff\xff\xff\xff", b"\0\1\0\0\2\0\0\0a\0\0\0\0\0"):
        with pytest.raises(DamagedRecording):
            decoder.decode(messages_of([content]), "here")
    with pytest.raises(BadInput, match="holds no numbers"):
        cdr("a/B", "string s\n")
    with pytest.raises(BadInput, match="holds no numbers"):
        cdr("a/B", "A again\n=====\nMSG: a/A\nA again\n")  # a type inside itself


def written(path: Path, encoding: str, schema: tuple[str, str, bytes], messages: list[bytes]) -> Path:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        number = writer.register_schema(*schema) if schema[0] else 0
        channel = writer.register_channel("/other", encoding, number)
        for i, content in enumerate(messages):
            writer.add_message(channel, i * 10**7, content, i * 10**7)
        writer.finish()
    return path


def decimal_texts(count: int) -> list[str]:
    draw = np.random.default_rng(8)
    texts = [repr(x) for x in draw.integers(0, 2**64, count, np.uint64).view(np.float64).tolist() if np.isfinite(x)]
    texts += [repr(float(x)) for x in draw.normal(size=count) * 10.0 ** draw.integers(-20, 20, count)]
    texts += [
        f"{m}e{q}" for m, q in zip(draw.integers(-(2**63), 2**63, count), draw.integers(-345, 310, count), strict=True)
    ]
    halfway = (2 * draw.integers(2**52, 2**53, count) + 1).tolist()  # between two doubles: to even
    texts += [f"{m}e{q}" for m, q in zip(halfway, draw.integers(0, 24, count).tolist(), strict=True)]
    texts += [str(m) for m in halfway] + [f"{m / 2}" for m in range(-9, 9)]
    return [*texts, "0", "-0", "-0.0e9", "5e-324", "1.7976931348623159e308", "123456789012345678901234567890"]


def test_decimals_are_the_nearest_doubles_or_left_to_python() -> None:
    texts = decimal_texts(20_000)
    left = 0
    for text in texts:
        end, bits = number(np.frombuffer(text.encode(), np.uint8), 0, len(text), powers())
        left += end < 0
        if end >= 0:
            assert end == len(text)
            assert struct.pack("<Q", int(bits)) == struct.pack("<d", float(text)), text
    assert left < 0.1 * len(texts)


@pytest.mark.parametrize("text", ["01", "-", "1.", ".5", "1e", "1e+", "--1", "+1", "", " 1", "-01", "1.e5", "00", "x"])
def test_what_json_does_not_call_a_number_is_none(text: str) -> None:
    end, _ = number(np.frombuffer(text.encode(), np.uint8), 0, len(text), powers())
    assert end < len(text) or not text


@pytest.mark.parametrize(
    "odd",
    [
        '{"b": 2.5, "a": 1.5}',  # another order
        '{"a": 1.5, "b": 2.5, "c": 9}',
        '{"a": 7, "a": 1.5, "b": 2.5}',  # the last counts
        ' {"a" :\t1.5,\n"b":25e-1 } ',
        '{"t": "a\\"b 3", "a": 1.5, "b": 2.5}',
        '{"t": "\u00e9 1", "a": 1.5, "b": 2.5}',
        '{"t": [1, 2, {"a": 3}], "a": 1.5, "b": 2.5}',
        '{"a": 1.5, "b": 2.5000000000000000000000000001}',
    ],
)
@pytest.mark.parametrize("code", ["utf-8", "utf-16"])
def test_json_of_any_shape_reads_as_the_json_package_does(odd: str, code: str) -> None:
    contents = [text.encode(code) for text in ['{"a": 3.5, "b": 4.5}', odd, '{"a": null, "b": true}', odd] * 3]
    read = json_decoder("x", contents[0]).decode(messages_of(contents), "here")
    np.testing.assert_array_equal(read, [[3.5, 4.5], [1.5, 2.5], [np.nan, 1.0], [1.5, 2.5]] * 3)


def test_digits_of_two_bytes_are_not_taken_for_numbers() -> None:
    contents = [text.encode("utf-16") for text in ('{"a": 0.0, "b": 0.0}', '{"a": 0.5, "b": 0.0}')]
    assert json_decoder("x", contents[0]).decode(messages_of(contents), "here").tolist() == [[0.0, 0.0], [0.5, 0.0]]


def test_a_broken_json_message_is_damage_wherever_it_stands() -> None:
    sound = b'{"a": 1.5}'
    for broken in (b'{"a": 1.5', b'{"a": 1.5}}', b'{"a": 01.5}', b'{"a": 1.5e}', b"", b'{"a": 1.5} x'):
        with pytest.raises(DamagedRecording, match="message 3.*is not JSON"):
            json_decoder("x", sound).decode(messages_of([sound, sound, sound, broken, sound]), "here")


@pytest.mark.parametrize("tidy", [True, False])
def test_json_numbers_are_read_bit_for_bit(tmp_path: Path, tidy: bool) -> None:
    values = DRAW.normal(size=(500, 3)) * 10.0 ** DRAW.integers(-200, 200, (500, 3))
    contents = []
    for i, (x, y, z) in enumerate(values.tolist()):
        read = {"t": "text", "x": x, "at": {"y": y, "deep": {"z": z}}, "n": i}
        if not tidy and i == 77:
            read["at"] = None  # its numbers are missing
        if not tidy and i == 78:
            read["x"] = True
        contents.append(json.dumps(read, indent=1 if i % 2 else None).encode())
    path = written(tmp_path / "a.mcap", "json", ("", "", b""), contents)
    with Recording(path) as recording:
        topic = recording.channels["/other"].topic
        assert topic.components == ("x", "at_y", "at_deep_z", "n")
        assert topic.note == "undocumented"
        read = recording.signal("/other").value
    expected = np.column_stack([values, np.arange(500)])
    if not tidy:
        expected[77, 1:3], expected[78, 0] = np.nan, 1.0
    assert read.tobytes() == expected.tobytes()


def test_json_that_is_none_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap", "json", ("", "", b""), [b'{"x": 1}', b'{"x": ', b'{"x": 2}'])
    with Recording(path) as recording, pytest.raises(DamagedRecording, match="message 1: is not JSON"):
        recording.signal("/other")
    path = written(tmp_path / "b.mcap", "json", ("", "", b""), [b'{"text": "no number"}'])
    with Recording(path) as recording:
        assert "holds no numbers" in recording.channels["/other"].unreadable


def test_frames_of_other_tools(tmp_path: Path) -> None:
    picture = DRAW.bytes(5000)
    oracle = Oracle("<")
    oracle.put("i4", 1), oracle.put("u4", 2), oracle.string("cam"), oracle.string("jpeg; compressed bgr8")
    oracle.put("u4", len(picture))
    ros = bytes(oracle.content) + picture
    foxglove = json.dumps({"data": base64.b64encode(picture).decode(), "format": "jpeg"}).encode()
    for encoding, schema, content in (
        ("cdr", ("sensor_msgs/msg/CompressedImage", "ros2msg", b"std_msgs/Header header\n"), ros),
        ("json", ("foxglove.CompressedImage", "jsonschema", b"{}"), foxglove),
    ):
        with Recording(written(tmp_path / "a.mcap", encoding, schema, [content] * 3)) as recording:
            assert recording.channels["/other"].topic.is_camera
            read = list(recording.pictures("/other"))
        assert [(one.data, one.format) for one in read] == [(picture, "jpeg")] * 3
        with (
            Recording(written(tmp_path / "b.mcap", encoding, schema, [content[:-9]])) as recording,
            pytest.raises(DamagedRecording, match="CompressedImage"),
        ):
            list(recording.pictures("/other"))


def test_the_real_bags_hold_what_their_maker_put_in(real: Path) -> None:
    with Recording(real / "mcap" / "cdr_test_0.mcap") as recording:
        basic = recording.signal("/test_topic")
        assert dict(zip(basic.components, basic.value[0], strict=True))["int32_value"] == 123
        arrays = recording.signal("/array_topic")
        read = dict(zip(arrays.components, arrays.value[0].tolist(), strict=True))
    # the defaults that the type's definition prints, behind strings, nested types and an empty one
    assert [read[f"float64_values_default_{i}"] for i in range(3)] == [3.1415, 0, -3.1415]
    assert [read[f"int16_values_default_{i}"] for i in range(3)] == [0, 32767, -32768]
    assert read["defaults_values_2_int64_value"] == -40000000
