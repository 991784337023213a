"""Hostile inputs from seeds: the same (kind, number) gives the same bytes and the same command, always.

A kind is a function (draw, folder) -> arguments of the command line. It writes its inputs into folder/in and names
outputs below folder/out only. A new kind (voxel maps, centrelines ...) is one function and one line in FUZZED.
"""

import json
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from catheter.lab.damage import KINDS as DAMAGES

Draw = np.random.Generator
MAPPING = """
[source]
title = "piston"
who = "nobody"
licence = "CC0 1.0"
[format]
columns = ["time", "stroke", "force"]
separator = "comma"
[clock]
column = "time"
unit = "ms"
drop_first = 1
duplicates = "drop"
[[topic]]
topic = "/stroke"
columns = ["stroke"]
unit = "mm"
[[topic]]
topic = "/force"
columns = ["force"]
unit = "N"
[ask]
response = "/force"
input = "/stroke"
"""
FITS = {  # what `fit` writes, and the commands that take it
    "accumulator": """
[fit]
model = "accumulator"
recording = "a.mcap"
kind = "simulated"
rmse = "141 Pa"
rising = [0.99, 1.44]
range = [0.99, 1.44]
standard_errors = ["143 Pa", "1716 Pa", "6347 Pa", "7301 Pa"]
[accumulator]
coefficients = ["160180 Pa", "589355 Pa", "-1103497 Pa", "705801 Pa"]
""",
    "valve": """
[fit]
model = "valve"
recording = "v.mcap"
kind = "simulated"
standard_error = "6.5e-10 m^3 Pa^-0.5 s^-1"
[valve]
coefficient = "3.05e-07 m^3 Pa^-0.5 s^-1"
""",
    "material": """
[fit]
model = "material"
kind = "measured"
law = "neo-Hooke"
c1_low = "200000 Pa"
c1_high = "208000 Pa"
[material]
name = "t"
law = "neo-Hooke"
elongation = 0.8
c1 = "204000 Pa"
""",
}
TUBE = """
[scene]
kind = "tube"
title = "t"
[tube]
divisions = [4, 4, 1]
voxels = [4, 4]
[map]
soft = "../in/f.toml"
pattern = "helix"
period = 4
width = 1
"""
NUMBERS = ("0", "-1", "1e308", "-1e308", "1e-308", "nan", "inf", "-inf", "1" + 400 * "0", "0x7fffffffffffffff", "true")
TEXTS = ('""', '"\\u0000"', '"\\u001b[31m"', "[]", "{}", '"../../x"', '"1 furlong"', '"83 kPa"', '"1e400 m"', "[[1]]",
         '"\\U0001F9A0"', "1979-05-27", '"1 m"', '"-5 s"', "''")  # fmt: skip
NAMES = ("/force", "/pressure", "/../../x", "/", "", "/a b", "/\x1b[31m", "/" + 3000 * "x", "/camera/top", "/t\u0000",
         "//", "/volume", "/\U0001f9a0", "force", "/drive", "/summary", "/clock/0", "/<b>")  # fmt: skip
# Shipped scenes are shortened, so that what is tried is their reading and not their length.
SHORTER = (
    *(('"1800 s"', '"20 s"'), ('"60 s"', '"2 s"'), ('chirp = "45 s"', 'chirp = "2 s"'), ("levels = 5", "levels = 1")),
    *(
        ('hold_s = "8 s"', 'hold_s = "0.1 s"'),
        ('step = "47 mV"', 'step = "0.5 V"'),
        ('fill_s = "12 s"', 'fill_s = "1 s"'),
    ),
    *((f"divisions = [32, {n}, {k}]", "divisions = [8, 8, 1]") for n in (32, 128) for k in (1, 2)),
    *((f"voxels = [32, {n}]", "voxels = [8, 8]") for n in (32, 128)),
    *(('time = "16 s"', 'time = "0.3 s"'), ('wait = "2 s"', 'wait = "0.1 s"')),
    ("[plant]\ncubic", '[drive]\nduration_s = "20 s"\n\n[plant]\ncubic'),
)
CLASSES = ("bender", "accumulator", "valve", "cracking", "hysteresis")


def damaged(draw: Draw, content: bytes) -> bytes:
    """Return bytes with one to four of the damages that `report damage` knows."""
    ways = list(DAMAGES.values())
    for _ in range(int(draw.integers(1, 5))):
        if len(content) > 16:
            content = ways[int(draw.integers(len(ways)))](draw, content)
    return content


def mangled(draw: Draw, text: str) -> str:
    """Return a text in whose lines values, keys, whole lines or single characters were changed."""
    for _ in range(int(draw.integers(1, 4))):
        lines = text.split("\n")
        at = int(draw.integers(len(lines)))
        match int(draw.integers(7)):
            case 0:
                del lines[at]
            case 1:
                lines.insert(at, lines[int(draw.integers(len(lines)))])
            case 2:
                lines[at] = re.sub(r"[-\d.][\d.e-]*", _pick(draw, NUMBERS), lines[at], count=1)
            case 3:
                lines[at] = re.sub(r"=.*", f"= {_pick(draw, (*NUMBERS, *TEXTS))}".replace("\\", r"\\"), lines[at])
            case 4:
                lines[at] = re.sub(r"^\w", "q", lines[at])
            case 5:
                lines[at] = lines[at].replace(" ", _pick(draw, ("", "\t", "\u00a0", ",", '"')), 1)
            case _:
                where = int(draw.integers(len(lines[at]) + 1))
                lines[at] = lines[at][:where] + chr(int(draw.integers(1, 0xD000))) + lines[at][where:]
        text = "\n".join(lines) or "x"
    return text


def _pick(draw: Draw, among: tuple[str, ...]) -> str:
    return among[int(draw.integers(len(among)))]


def _write(path: Path, content: bytes) -> str:
    path.write_bytes(content)
    return str(path)


@cache
def _recordings() -> tuple[bytes, ...]:
    """Return small sound recordings: our own, and others without checksums, so that damage reaches every reader."""
    import tempfile

    from data.recorder import Recorder
    from data.signal import Signal
    from data.topics import Topic, standard

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.mcap"
        time_s = np.arange(200) / 20
        with Recorder(path, {"kind": "simulated", "title": "fuzz"}, flush_s=None) as recorder:
            for name, unit in (("/force", "N"), ("/stroke", "m")):
                recorder.add(Topic(name=name, components=("value",), units=(unit,)))
            recorder.add(standard("/camera/top"))
            recorder.write_signals({"/force": Signal(time_s, np.sin(time_s) ** 3, "N"),
                                    "/stroke": Signal(time_s, np.sin(time_s), "m")})  # fmt: skip
            recorder.write_picture("/camera/top", 0.5, _pictures()[0], "jpeg")
        own = path.read_bytes()
        return own, *(_foreign(Path(folder) / f"{kind}.mcap", kind, time_s.tolist()) for kind in ("protobuf", "json"))


def _foreign(path: Path, kind: str, time_s: list[float]) -> bytes:
    from mcap.writer import CompressionType, Writer

    from data import message

    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, enable_crcs=False)
        writer.start()
        content = message.schema("fuzz.Force", ("force", "stroke")) if kind == "protobuf" else b'{"type": "object"}'
        schema = writer.register_schema("fuzz.Force", "protobuf" if kind == "protobuf" else "jsonschema", content)
        channel = writer.register_channel("/force", kind, schema, {"unit": "N"})
        for t in time_s:
            force, stroke = float(np.sin(t)), float(np.cos(t))
            data = json.dumps({"force": force, "stroke": stroke}).encode()
            if kind == "protobuf":
                data = message.encode(np.array([[force, stroke]])).tobytes()
            writer.add_message(channel, int(1e9 * t), data, int(1e9 * t))
        writer.finish()
    return path.read_bytes()


@cache
def _pictures() -> tuple[bytes, ...]:
    """Return the marker as JPEG and PNG."""
    import cv2

    from vision.render import Shot, render

    picture = render(Shot(width_px=160, height_px=120, middle_px=(80.0, 60.0), pitch_px=40.0), np.random.default_rng(1))
    return tuple(cv2.imencode(ending, picture)[1].tobytes() for ending in (".jpg", ".png"))


@cache
def _videos() -> tuple[tuple[str, bytes], ...]:
    """Return a film of the marker in two containers, with their endings."""
    import tempfile

    import cv2

    from vision.render import Shot, render

    found = []
    with tempfile.TemporaryDirectory() as folder:
        for ending, code in ((".mp4", "mp4v"), (".avi", "MJPG")):
            path = Path(folder) / f"a{ending}"
            film = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), 30.0, (160, 120))
            for number in range(6):
                shot = Shot(width_px=160, height_px=120, middle_px=(80.0, 60.0), pitch_px=40.0, angle_rad=0.1 * number)
                film.write(cv2.cvtColor(render(shot, np.random.default_rng(1)), cv2.COLOR_GRAY2BGR))
            film.release()
            found.append((ending, path.read_bytes()))
    return tuple(found)


@cache
def _scenes() -> dict[str, str]:
    from catheter.lab.scene import FOLDER

    return {path.stem: _shortened(path.read_text("utf-8")) for path in sorted(FOLDER.glob("*.toml"))}


def _shortened(text: str) -> str:
    for long, short in SHORTER:
        text = text.replace(long, short)
    return text


def recording(draw: Draw, folder: Path) -> list[str]:
    """A damaged recording: checked, salvaged, replayed with and without a dashboard, fitted, or looked at for twist."""
    contents = _recordings()
    path = _write(folder / "in" / "a.mcap", damaged(draw, contents[int(draw.integers(len(contents)))]))
    out = str(folder / "out" / "o")
    ways = (
        ["check", path],
        ["check", path, "--salvage", f"{out}.mcap"],
        ["replay", path, "--no-view"],
        ["replay", path, "--out", f"{out}.rrd"],
        ["fit", path, "--model", _pick(draw, CLASSES), "--resamples", "20", "--out", f"{out}.toml"],
        ["twist", path, "--out", f"{out}.csv"],
    )
    return ways[int(draw.integers(len(ways)))]


def hostile(draw: Draw, folder: Path) -> list[str]:
    """A sound recording with hostile names, units, stamps, values and scene, of another tool."""
    from mcap.writer import Writer

    from data import message

    path = folder / "in" / "h.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.add_metadata(
            "origin", {"kind": _pick(draw, ("simulated", "measured", "x", "\x1b[31m")), "title": "\x07"}
        )
        writer.add_metadata("scene", {"toml": mangled(draw, _scenes()["chirp"])})
        for name in draw.choice(np.array(NAMES, dtype=object), 3, replace=False).tolist():
            fields = ("a", "b")[: int(draw.integers(1, 3))]
            schema = writer.register_schema("fuzz.T", "protobuf", message.schema("fuzz.T", fields))
            unit = _pick(draw, ("N", "m", "", "furlong", "\x1b[31m", "[/red]", "1"))
            channel = writer.register_channel(name, "protobuf", schema, {"unit": unit, "frame": "../x"})
            stamps = np.cumsum(draw.integers(0, 10 ** int(draw.integers(1, 17)), 40))
            values = draw.choice([0.0, 1.0, -1.0, 1e308, -1e308, 1e-308, np.nan, np.inf], (40, len(fields)))
            for stamp, row in zip(stamps.tolist(), values, strict=True):
                writer.add_message(channel, stamp, message.encode(row[None]).tobytes(), stamp)
        writer.finish()
    out = str(folder / "out" / "o.rrd")
    return ["replay", str(path), *(["--out", out] if draw.random() < 0.5 else ["--no-view"])]


def scene(draw: Draw, folder: Path) -> list[str]:
    """A shipped scene with its text mangled, given to the command that records; what cannot be recorded is refused."""
    found = _scenes()
    name = _pick(draw, tuple(found))
    text = mangled(draw, found[name])
    path = _write(folder / "in" / "s.toml", text.encode("utf-8", "replace"))
    if name == "cone":
        return ["valve", path]
    if 'kind = "shape"' in found[name]:
        return ["shape", path, "--q", "1"]
    if name == "twist":
        return ["inflate", path, "--pressure", "1 kPa"]
    return ["record", path, "--out", str(folder / "out" / "o.mcap")]


def log(draw: Draw, folder: Path) -> list[str]:
    """A text log and its mapping, one or both of them mangled."""
    rows = "\n".join(f"{10 * k},{np.sin(k):.4f},{np.cos(k):.4f}" for k in range(30))
    text, mapping = mangled(draw, rows), mangled(draw, MAPPING) if draw.random() < 0.5 else MAPPING
    content = text.encode("utf-8", "replace")
    path = _write(folder / "in" / "l.csv", damaged(draw, content) if draw.random() < 0.2 else content)
    named = _write(folder / "in" / "m.toml", mapping.encode("utf-8", "replace"))
    return ["import", path, "--mapping", named, "--out", str(folder / "out" / "o.mcap")]


def picture(draw: Draw, folder: Path) -> list[str]:
    """A folder of pictures of a marker, damaged."""
    for number in range(int(draw.integers(1, 4))):
        kind = int(draw.integers(2))
        ending = _pick(draw, (".jpg", ".png", ".bmp", ".tif", ".webp", ".pgm"))
        _write(folder / "in" / f"{number}{ending}", damaged(draw, _pictures()[kind]))
    return ["twist", str(folder / "in"), "--out", str(folder / "out" / "o.csv")]


def video(draw: Draw, folder: Path) -> list[str]:
    """A damaged video of a marker."""
    ending, content = _videos()[int(draw.integers(2))]
    path = _write(folder / "in" / f"v{ending}", damaged(draw, content))
    return ["twist", path, "--out", str(folder / "out" / "o.csv")]


def voxel_map(draw: Draw, folder: Path) -> list[str]:
    """A voxel map of a small tube, its text mangled, printed."""
    rows = ",\n".join(f'    "{"ab"[k % 2]}{"aabba"}{"ba"[k % 2]}a"' for k in range(6))
    sizes = "".join(f'{name} = "{value} mm"\n' for name, value in (("length", 8), ("outer_radius", 5), ("wall", 1)))
    text = f'title = "t"\n{sizes}cap = "2 mm"\nrows = [\n{rows}\n]\n\n[materials]\na = "Agilus30"\nb = "FLX9785"\n'
    path = _write(folder / "in" / "m.toml", mangled(draw, text).encode("utf-8", "replace"))
    slices = ["--slices"] if draw.random() < 0.2 else []
    return ["print", path, "--out", str(folder / "out" / "p"), *slices]


def centreline(draw: Draw, folder: Path) -> list[str]:
    """A vessel's centreline as CSV, VTK or VTP, mangled or damaged, given to a shape."""
    rows = [f"{0.5 * k},{np.sin(0.1 * k):.4f},{0.01 * k * k:.4f},{2 + 0.01 * k:.3f}" for k in range(40)]
    points = " ".join(row.rpartition(",")[0].replace(",", " ") for row in rows)
    texts = {
        ".csv": "x_mm,y_mm,z_mm,radius_mm\n" + "\n".join(rows),
        ".vtk": f"# vtk DataFile Version 3.0\nt\nASCII\nDATASET POLYDATA\nPOINTS 40 float\n{points}\n"
        f"LINES 1 41\n40 {' '.join(map(str, range(40)))}\nPOINT_DATA 40\nSCALARS Radius float 1\n"
        f"LOOKUP_TABLE default\n{' '.join(row.rpartition(',')[2] for row in rows)}\n",
        ".vtp": _vtp(points, rows),
    }
    ending = _pick(draw, tuple(texts))
    content = mangled(draw, texts[ending]).encode("utf-8", "replace")
    path = _write(folder / "in" / f"c{ending}", damaged(draw, content) if draw.random() < 0.3 else content)
    return ["shape", "renal_balloon", "--vessel", path, "--q", "1"]


def fit(draw: Draw, folder: Path) -> list[str]:
    """A fit, its text mangled, put to use; or a table of tensile tests to be fitted."""
    kind = _pick(draw, (*FITS, "tests"))
    if kind == "tests":
        rows = [
            f"1,{k},{e},{0.2 * (1 + k / 9) * (1 + e - (1 + e) ** -2):.5f}" for k in (0, 1) for e in np.arange(20) / 20
        ]
        text = mangled(draw, "plate,spec,strain,stress_MPa\n" + "\n".join(rows))
        path = _write(folder / "in" / "t.csv", text.encode("utf-8", "replace"))
        more = ["--specimen", "plate,spec", "--resamples", "5", "--out", str(folder / "out" / "o.toml")]
        return ["fit", path, "--model", "material", *more]
    path = _write(folder / "in" / "f.toml", mangled(draw, FITS[kind]).encode("utf-8", "replace"))
    if kind == "material":
        scene = _write(folder / "in" / "s.toml", TUBE.encode())
        return ["inflate", scene, "--pressure", "1 kPa"]
    return ["run", "locomotion", "--fit", f"{draw.integers(1, 4)}={path}"]


def _vtp(points: str, rows: list[str]) -> str:
    def array(name: str, kind: str, text: str, width: int = 1) -> str:
        head = f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{width}" format="ascii">'
        return f"{head}\n{text}\n</DataArray>\n"

    order, radius = " ".join(str(k) for k in range(len(rows))), " ".join(row.rpartition(",")[2] for row in rows)
    lines = array("connectivity", "Int64", order) + array("offsets", "Int64", str(len(rows)))
    return (
        '<VTKFile type="PolyData" byte_order="LittleEndian">\n<PolyData>\n<Piece>\n'
        f"<Points>\n{array('Points', 'Float64', points, 3)}</Points>\n<Lines>\n{lines}</Lines>\n"
        f"<PointData>\n{array('Radius', 'Float64', radius)}</PointData>\n</Piece>\n</PolyData>\n</VTKFile>\n"
    )


FUZZED: dict[str, Callable[[Draw, Path], list[str]]] = {
    "damaged recordings": recording,
    "hostile recordings": hostile,
    "scenes": scene,
    "logs and mappings": log,
    "pictures": picture,
    "videos": video,
    "voxel maps": voxel_map,
    "centrelines": centreline,
    "fits": fit,
}
