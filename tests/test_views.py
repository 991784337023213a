"""Dashboards: what they hold is what was recorded, every view says where its data are from, pictures show it."""

import json
import os
import re
import signal as signals
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import psutil
import pytest
import rerun.blueprint as rrb
from helpers import DRIVERS, NO_DRIVER, ROOT, SIMULATED
from rerun.chunk import RrdReader

from catheter.lab.display import display
from catheter.lab.replay import Replay
from catheter.lab.views.clocks import Clocks
from catheter.lab.views.labels import ticks
from catheter.lab.views.layout import Pages
from catheter.lab.views.loops import MOST_PLACES, Axis
from catheter.lab.views.output import Output
from catheter.lab.views.picture import save_picture
from catheter.lab.views.plots import Line, plot
from catheter.lab.views.replay import save
from catheter.lab.views.viewer import viewer
from data.errors import BadInput, CannotWrite, CatheterError
from data.recorder import Recorder
from data.recording import Recording
from data.signal import Signal
from data.topics import Topic, standard

MEASURED = {"kind": "measured", "title": "test"}
T = np.arange(3000) / 100
ML = 1e-5 * (1 - np.cos(T))
N = 2e5 * ML + 0.2 * np.tanh(9 * np.sin(T))

Fill = Callable[[Recorder], object]
Pixels = np.ndarray[tuple[int, ...], np.dtype[np.uint8]]


def topic(name: str, components: tuple[str, ...], *units: str, note: str = "") -> Topic:
    return Topic(name=name, components=components, units=units, note=note)


def bender(recorder: Recorder) -> None:
    """Force and volume on one clock, pressure on a slower one, and a vector."""
    for known in (standard("/force"), standard("/pressure"), standard("/tip"), topic("/volume", ("volume",), "m^3")):
        assert known
        recorder.add(known)
    tip = np.stack([np.sin(T), np.cos(T), T], axis=-1) / 100
    recorder.write_signals(
        {
            "/force": Signal(T, N, "N"),
            "/volume": Signal(T, ML, "m^3"),
            "/pressure": Signal(np.linspace(0, T[-1], 901), np.linspace(0, 4e4, 901), "Pa"),
            "/tip": Signal(T[5:], tip[5:], "m", components=("x", "y", "z")),
        }
    )


def gaps(recorder: Recorder) -> None:
    """A response in Pa, shown in kPa, that starts late and has a gap: its models have a clock of their own."""
    recorder.add(topic("/pressure", ("pressure",), "Pa"))
    recorder.add(topic("/volume", ("volume",), "m^3"))
    pressure = 1e4 * N
    pressure[700:800] = np.nan
    recorder.write_signals({"/pressure": Signal(T + 0.005, pressure, "Pa"), "/volume": Signal(T, ML, "m^3")})


def undocumented(recorder: Recorder) -> None:
    for name, values in (("/force", N), ("/stroke", ML)):
        recorder.add(topic(name, ("value",), "1", note="undocumented"))
        recorder.write_signals({name: Signal(T, values, "1")})


def constant(recorder: Recorder) -> None:
    recorder.add(topic("/force", ("force",), "N"))
    recorder.add(topic("/stroke", ("displacement",), "m"))
    recorder.write_signals({"/force": Signal(T, 0 * T, "N"), "/stroke": Signal(T, ML, "m")})


def rising(recorder: Recorder) -> None:
    """An input that never falls: models, but no loops."""
    recorder.add(topic("/force", ("force",), "N"))
    recorder.add(topic("/stroke", ("displacement",), "m"))
    recorder.write_signals({"/force": Signal(T, N, "N"), "/stroke": Signal(T, T / 1e3, "m")})


def dead(recorder: Recorder) -> None:
    """A vector with one component that never had a number, and a sensor that never had one."""
    for name, components in (("/tip", ("x", "y")), ("/led", ("state",))):
        recorder.add(topic(name, components, *["1"] * len(components)))
    nan = np.full_like(T, np.nan)
    tip = Signal(T, np.stack([T, nan], axis=-1), "1", components=("x", "y"))
    recorder.write_signals({"/tip": tip, "/led": Signal(T, nan, "1")})


def single(recorder: Recorder) -> None:
    recorder.add(topic("/led", ("state",), "1"))
    recorder.write_signals({"/led": Signal(T, np.sign(np.sin(T)), "1")})


def nothing(_: Recorder) -> None:
    pass


def many(recorder: Recorder) -> None:
    """More topics than a page has room for."""
    for number in range(1, 25):
        name = f"/pressure/{number}"
        recorder.add(topic(name, ("pressure",), "Pa"))
        recorder.write_signals({name: Signal(T[:50], 1e3 * number + T[:50], "Pa")})


def frames(recorder: Recorder, name: str, count: int, picture_format: str = "jpeg") -> list[bytes]:
    camera = standard(name)
    assert camera
    recorder.add(camera)
    written = []
    for number in range(count):
        image = np.full((48, 64, 3), 40, np.uint8)
        cv2.circle(image, (10 + number % 40, 24), 6, (0, 200, 255) if number == 7 else (255, 0, 0), -1)
        written.append(cv2.imencode(f".{picture_format}", image)[1].tobytes())
        recorder.write_picture(name, 0.1 * number + 0.0123456789, written[-1], picture_format)
    return written


def cameras(recorder: Recorder) -> None:
    bender(recorder)
    frames(recorder, "/camera/top", 12)
    frames(recorder, "/camera/side", 5, "png")


def cameras_alone(recorder: Recorder) -> None:
    frames(recorder, "/camera/top", 3, "webp")
    frames(recorder, "/camera/side", 3)


ALL = [bender, gaps, undocumented, constant, rising, dead, single, nothing, many, cameras, cameras_alone]


def record(folder: Path, fill: Fill, origin: dict[str, str] = SIMULATED) -> Path:
    path = folder / f"{fill.__name__}.mcap"
    with Recorder(path, origin, flush_s=None) as recorder:
        fill(recorder)
    return path


Shown = Callable[[Fill], tuple[Replay, Path]]


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    """Return the replay and the dashboard of a recording, made once for all tests that only look at it."""

    @cache
    def make(fill: Fill) -> tuple[Replay, Path]:
        folder = tmp_path_factory.mktemp(fill.__name__)
        with Recording(record(folder, fill)) as recording:
            return dashboard(recording, folder)

    return make


def dashboard(recording: Recording, folder: Path) -> tuple[Replay, Path]:
    replay, path = Replay(recording), folder / "view.rrd"
    save(replay, path)
    return replay, path


def rows(path: Path, *, blueprint: bool = False) -> list[tuple[str, bool, dict[str, Any]]]:
    """Return (entity, static, column name -> arrow array) of every chunk."""
    reader = RrdReader(path)
    store = reader.blueprints()[0] if blueprint else reader.recordings()[0]
    found = []
    for chunk in reader.stream(store=store):
        batch = chunk.to_record_batch()
        columns = {field.name: batch.column(field.name) for field in batch.schema}
        found.append((str(chunk.entity_path), chunk.is_static, columns))
    return found


def numbers(path: Path) -> dict[str, tuple[str, np.ndarray, np.ndarray]]:
    """Return component -> (entity, times in ns, values) of all that is drawn against time."""
    found = {}
    for entity, static, columns in rows(path):
        if entity.startswith("/clock/") and not static:
            stamps = np.asarray(columns["t"].cast("int64"))
            for name, column in columns.items():
                if name.partition(":")[0] in ("Signal", "Model", "Residual"):
                    assert name not in found
                    found[name] = entity, stamps, np.asarray(column.flatten())
    return found


def texts(path: Path) -> str:
    return next(c["TextDocument:text"][0].as_py()[0] for e, _, c in rows(path) if e == "/summary")


def views(path: Path) -> dict[str, dict[str, Any]]:
    """Return name -> class, origin, query and drawn components of each view of the blueprint."""
    found: dict[str, dict[str, Any]] = {}
    for entity, _, columns in rows(path, blueprint=True):
        number = entity.split("/")[2] if entity.startswith("/view/") else ""
        view = found.setdefault(number, {"components": []})
        for name, column in columns.items():
            if name in ("ViewBlueprint:display_name", "ViewBlueprint:class_identifier", "ViewBlueprint:space_origin"):
                view[name.partition(":")[2]] = column.to_pylist()[0][0]
            elif name == "ViewContents:query":
                view["query"] = column.to_pylist()[0]
            elif name == "VisualizerInstruction:component_map":
                view["components"] += [mapping["source_component"] for mapping in column.to_pylist()[0]]
    return {f"{view['display_name']} ({number[:4]})": view for number, view in found.items() if "display_name" in view}


@pytest.mark.parametrize("fill", [bender, gaps, undocumented, constant, many])
def test_what_is_shown_is_what_was_recorded_to_the_last_bit(shown: Shown, fill: Fill) -> None:
    replay, path = shown(fill)
    found = numbers(path)
    assert {name for name in found if name.startswith("Signal:")} == {f"Signal:{label}" for label in replay.signals}
    for label, signal in replay.signals.items():
        _, stamps, values = found[f"Signal:{label}"]
        assert np.array_equal(stamps, np.rint(signal.time_s * 1e9))
        assert np.array_equal(values, signal.value * display(signal.unit)[1], equal_nan=True)


@pytest.mark.parametrize("fill", [bender, gaps, undocumented, constant])
def test_measured_and_residual_add_up_to_each_model_to_the_last_bit(shown: Shown, fill: Fill) -> None:
    replay, path = shown(fill)
    found = numbers(path)
    _, clock, response = found[f"Signal:{replay.ask.response}"]
    assert len(replay.models) >= 7
    for fit in replay.models:
        _, stamps, model = found[f"Model:{fit.model.name}"]
        _, same, residual = found[f"Residual:{fit.model.name}"]
        assert np.array_equal(stamps, same)
        assert np.array_equal(residual, model - response[np.isin(clock, stamps)])
        assert np.array_equal(model, fit.predicted * display(replay.signals[replay.ask.response].unit)[1])


def test_signals_that_share_a_clock_share_an_entity_and_no_others_do(shown: Shown) -> None:
    path = shown(bender)[1]
    where = {name: entity for name, (entity, _, _) in numbers(path).items()}
    force = where["Signal:/force"]
    assert where["Signal:/volume"] == force
    assert {entity for name, entity in where.items() if name.startswith(("Model:", "Residual:"))} == {force}
    assert where["Signal:/tip:x"] == where["Signal:/tip:y"] == where["Signal:/tip:z"]
    assert len({force, where["Signal:/pressure"], where["Signal:/tip:x"]}) == 3
    assert sum(entity == force for entity, _, _ in rows(path)) == 1  # by column: one chunk, however many samples


@pytest.mark.parametrize("fill", ALL)
def test_every_view_shows_something_that_is_there(shown: Shown, fill: Fill) -> None:
    path = shown(fill)[1]
    logged = {(entity, name) for entity, _, columns in rows(path) for name in columns}
    entities = {entity for entity, _ in logged}
    for name, view in views(path).items():
        if view["class_identifier"] == "TimeSeries":
            assert view["components"], name
            assert set(view["query"]) <= entities
            for component in view["components"]:
                assert any((entity, component) in logged for entity in view["query"]), (name, component)
        else:
            origin = view["space_origin"]
            assert any(entity == origin or entity.startswith(f"{origin}/") for entity in entities), name


@pytest.mark.parametrize("fill", [bender, gaps, rising])
def test_each_signal_is_drawn_and_the_response_only_with_its_models(shown: Shown, fill: Fill) -> None:
    replay, path = shown(fill)
    drawn = [view["components"] for view in views(path).values()]
    assert {component for components in drawn for component in components} == set(numbers(path))
    assert [f"Signal:{replay.ask.response}"] not in drawn
    assert any(view["class_identifier"] == "2D" for view in views(path).values()) == (fill is not rising)


def test_a_signal_without_numbers_has_no_plot_and_is_listed(shown: Shown) -> None:
    path = shown(dead)[1]
    shown_components = sorted(view["components"] for view in views(path).values())  # a file keeps them in no order
    assert shown_components == [[], ["Signal:/tip:x"]]  # the text, and a plot
    assert all(f"{name}: no sample" in texts(path) for name in ("/led", "/tip:y"))


def says(path: Path, kind: str) -> bool:
    """Return whether every view and page of a dashboard, and its text, begin with the word."""
    pages = "ContainerBlueprint:display_name"
    names = [columns[pages].to_pylist()[0][0] for _, _, columns in rows(path, blueprint=True) if pages in columns]
    assert names
    assert views(path)
    silent = [name for name in (*names, *views(path)) if not re.match(rf"{kind}\b", name)]
    return silent == [] and texts(path).startswith(f"## {kind.upper()}")


@pytest.mark.parametrize("fill", ALL)
def test_no_view_and_no_page_is_without_the_word_that_says_where_its_data_are_from(shown: Shown, fill: Fill) -> None:
    assert says(shown(fill)[1], "simulated")


def test_measured_data_are_called_measured_and_unstated_data_unstated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Recording(record(tmp_path, cameras, MEASURED)) as recording:
        assert says(dashboard(recording, tmp_path)[1], "measured")
        monkeypatch.setattr(Recording, "kind", "unstated")
        assert says(dashboard(recording, tmp_path)[1], "unstated")


@pytest.mark.parametrize(("fill", "unit", "factor", "area"), [(bender, "N", 1, "N mL"), (gaps, "kPa", 1e-3, "mJ")])
def test_the_text_names_file_split_and_errors_and_areas_in_the_unit_that_is_shown(
    shown: Shown, fill: Fill, unit: str, factor: float, area: str
) -> None:
    replay, path = shown(fill)
    text, family = texts(path), replay.loops[0]
    assert f"{fill.__name__}.mcap" in text
    assert "second half held out" in text
    assert f"RMSE [{unit}]" in text
    low, high = re.findall(rf"over volume: (\S+) to (\S+) {area} \({len(family.loops)} loops\)", text)[0]
    areas = [loop.area * display(family.unit)[1] for loop in family.loops]
    assert [float(low), float(high)] == pytest.approx([min(areas), max(areas)], rel=6e-3)  # printed to three digits
    table = [[cell.strip(" *") for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:1] == "|"]
    cells = {row[0].replace("\\", ""): row[1:] for row in table}
    for fit in replay.models:
        weights, percent, *errors = map(float, cells[fit.model.name])
        assert weights == fit.parameters
        assert percent == pytest.approx(fit.fit_percent, abs=5.1e-3)  # printed to two decimals
        assert errors == pytest.approx([fit.rmse * factor, fit.held_out_rmse * factor], rel=6e-3)


def test_a_unit_nobody_documented_is_called_so_wherever_it_is_shown(shown: Shown) -> None:
    path = shown(undocumented)[1]
    names = [name for name, view in views(path).items() if view["class_identifier"] == "TimeSeries"]
    assert all("[undocumented]" in name for name in names)
    assert "RMSE [undocumented]" in texts(path)


def test_a_title_cannot_write_markdown_and_a_reason_left_out_is_listed(tmp_path: Path) -> None:
    title = "a | b <script> [x](http://y) *z* \n# heading"
    with Recording(record(tmp_path, single, {"kind": "measured", "title": title})) as recording:
        _, path = dashboard(recording, tmp_path)
    text = texts(path)
    assert re.search(r"(?<!\\)[<>|\[*]", text.splitlines()[0]) is None
    assert "\n# heading" not in text
    assert "they need a response" in text


def test_a_recording_that_was_cut_off_says_so(tmp_path: Path) -> None:
    path = record(tmp_path, cameras)
    path.write_bytes(path.read_bytes()[:-3000])
    with pytest.warns(UserWarning, match="cut"), Recording(path) as recording:
        _, out = dashboard(recording, tmp_path)
    assert "This recording was cut" in texts(out)


@pytest.mark.parametrize("name", ["/camera/top", "/camera/side"])
def test_every_picture_is_there_at_its_time_byte_for_byte(tmp_path: Path, name: str) -> None:
    path, form = tmp_path / "pictures.mcap", "jpeg" if name.endswith("top") else "png"
    with Recorder(path, SIMULATED, flush_s=None) as recorder:
        recorder.add(topic("/led", ("state",), "1"))
        recorder.write("/led", 0.0, 1.0)  # so that time starts at 0
        written = frames(recorder, name, 40, form)
    with Recording(path) as recording:
        _, out = dashboard(recording, tmp_path)
    chunks = [columns for entity, _, columns in rows(out) if "EncodedImage:blob" in columns]
    stamps = [stamp for columns in chunks for stamp in columns["t"].cast("int64").to_pylist()]
    blobs = [bytes(blob[0]) for columns in chunks for blob in columns["EncodedImage:blob"].to_pylist()]
    media = {kind for columns in chunks for row in columns["EncodedImage:media_type"].to_pylist() for kind in row}
    order = np.argsort(stamps)
    assert [stamps[i] for i in order] == [round((0.1 * i + 0.0123456789) * 1e9) for i in range(40)]
    assert [blobs[i] for i in order] == written
    assert media == {f"image/{form}"}


def test_a_format_the_viewer_cannot_show_is_counted_and_left_out(shown: Shown) -> None:
    path = shown(cameras_alone)[1]
    assert "3 pictures of /camera/top" in texts(path).replace("\\", "")
    assert not any("camera/top" in name for name in views(path))


def test_the_moving_point_stands_where_the_recording_was_at_that_time(shown: Shown) -> None:
    replay, path = shown(bender)
    family = replay.loops[0]
    points = next(c for e, static, c in rows(path) if e.endswith("/force_over_volume/now") and not static)
    stamps = np.asarray(points["t"].cast("int64"))
    drawn = np.asarray(points["Points2D:positions"].flatten().flatten()).reshape(-1, 2)
    assert 2 < len(stamps) <= MOST_PLACES
    x, y = Axis.over(family.x, ("mL", 1e6), 0.9), Axis.over(family.y, ("N", 1.0), 1.0)
    at = np.searchsorted(np.rint(family.x.time_s * 1e9), stamps)
    # the viewer's coordinates are 32-bit floats: 6e-8 of a drawing one unit high, times its 21 mL and 4.5 N
    assert drawn[:, 0] / 0.9 * (x.high - x.low) + x.low == pytest.approx(family.x.value[at] * 1e6, abs=5e-6)
    assert -drawn[:, 1] * (y.high - y.low) + y.low == pytest.approx(family.y.value[at], abs=2e-6)


def test_the_loops_that_are_drawn_keep_their_turning_points(shown: Shown) -> None:
    replay, path = shown(bender)
    family = replay.loops[0]
    strips = next(c for e, _, c in rows(path) if e.endswith("/force_over_volume/loops"))["LineStrips2D:strips"][
        0
    ].as_py()
    assert len(strips) == len(family.loops) > 2
    x = Axis.over(family.x, ("mL", 1e6), 0.9)
    for strip, loop in zip(strips, family.loops, strict=True):
        ends = [strip[0][0], max(point[0] for point in strip), strip[-1][0]]
        recorded = family.x.value[[loop.first, loop.peak, loop.last]] * 1e6
        assert ends == pytest.approx(x.place(recorded), abs=1e-6)


@pytest.mark.parametrize(("low", "high"), [(-0.04, 29.1), (0.0, 1e-7), (-3e5, 2e5), (99.3, 105.4), (-1.0, -0.2)])
def test_ticks_are_few_round_and_within_the_axis(low: float, high: float) -> None:
    found = ticks(low, high)
    assert 2 <= len(found) <= 6
    assert low - 1e-9 * (high - low) <= found[0]
    assert found[-1] <= high + 1e-9 * (high - low)
    mantissa = float(f"{np.diff(found).mean():e}".split("e")[0])
    assert min(abs(mantissa - round_number) for round_number in (1, 2, 5, 10)) < 1e-6
    assert not np.signbit(found[found == 0]).any()


def test_all_plots_start_with_the_whole_recording_on_one_linked_axis(shown: Shown) -> None:
    replay, path = shown(bender)
    end_ns = round(replay.recording.duration_s * 1e9)
    chunks = rows(path, blueprint=True)
    shared = next(columns for entity, _, columns in chunks if entity == f"/{Pages.SHARED_AXIS}")
    assert f"{end_ns}" in str(shared["TimeAxis:view_range"].to_pylist())
    linked = [columns["TimeAxis:link"].to_pylist() for _, _, columns in chunks if "TimeAxis:link" in columns]
    plots = [view for view in views(path).values() if view["class_identifier"] == "TimeSeries"]
    assert linked == [[[2]]] * len(plots)


@pytest.mark.parametrize("fill", [bender, nothing, cameras])
def test_the_viewers_own_check_accepts_the_file(shown: Shown, tmp_path: Path, fill: Fill) -> None:
    path = shown(fill)[1]
    command = [str(Path(sys.executable).parent / "rerun"), "rrd", "verify", str(path)]
    environment = os.environ | {"XDG_CONFIG_HOME": str(tmp_path), "XDG_DATA_HOME": str(tmp_path)}
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, env=environment, check=False)
    assert done.returncode == 0, done.stderr


def test_progress_rises_to_1(tmp_path: Path) -> None:
    told: list[float] = []
    with Recording(record(tmp_path, cameras)) as recording:
        save(Replay(recording), tmp_path / "a.rrd", progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0
    assert len(told) > 17  # at least once for each of the 17 pictures


@pytest.mark.parametrize("place", ["missing/a.rrd", "", "/dev/full"])
def test_a_place_that_cannot_be_written_is_named(tmp_path: Path, place: str) -> None:
    path = tmp_path / place
    with Recording(record(tmp_path, bender)) as recording, pytest.raises(CannotWrite, match=re.escape(str(path))):
        save(Replay(recording), path)


def group_is_gone(number: int, within_s: float = 5.0) -> bool:
    """Return whether no process of a group runs; zombies that nobody has reaped do not run."""
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        alive = []
        for process in psutil.process_iter(["pid", "status"]):
            try:
                if os.getpgid(process.pid) == number and process.status() != psutil.STATUS_ZOMBIE:
                    alive.append(process)
            except (ProcessLookupError, psutil.NoSuchProcess):
                continue
        if not alive:
            return True
        time.sleep(0.05)
    return False


def test_a_viewer_listens_to_this_machine_alone_collects_nothing_and_ends_with_its_block() -> None:
    with pytest.raises(KeyError), viewer((320, 240)) as running:
        group = running.process.pid
        deadline = time.monotonic() + 10
        listening: list[Any] = []
        while not listening and time.monotonic() < deadline:
            family = psutil.Process(group).children(recursive=True)
            listening = [c for process in family for c in process.net_connections("tcp") if c.status == "LISTEN"]
        assert {connection.laddr.ip for connection in listening} == {"127.0.0.1"}
        settings = Path(psutil.Process(group).environ()["XDG_CONFIG_HOME"], "rerun", "analytics.json")
        assert settings.is_relative_to(running.log.parent)
        assert json.loads(settings.read_text())["analytics_enabled"] is False
        raise KeyError
    assert group_is_gone(group)


def test_a_session_that_is_killed_leaves_no_viewer() -> None:
    code = (
        "import time\nfrom catheter.lab.views.viewer import viewer\n"
        "with viewer((320, 240)) as running:\n"
        "    print(running.process.pid, running.log.parent, flush=True)\n    time.sleep(60)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, cwd=ROOT) as session:
        assert session.stdout
        group, _, folder = session.stdout.readline().strip().partition(" ")
        session.send_signal(signals.SIGKILL)
        session.wait()
    assert group_is_gone(int(group))
    assert folder
    assert not Path(folder).exists()


def test_without_a_driver_the_error_names_the_packages(
    shown: Shown, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VK_ICD_FILENAMES", "/dev/null")
    monkeypatch.setenv("VK_DRIVER_FILES", "/dev/null")
    path = shown(single)[1]
    with pytest.raises(CatheterError, match=r"mesa-vulkan-drivers and libvulkan1"):
        save_picture(path, tmp_path / "a.png")
    assert not (tmp_path / "a.png").exists()


def test_a_picture_of_no_dashboard_is_refused_at_once(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="no.rrd"):
        save_picture(tmp_path / "no.rrd", tmp_path / "a.png")


needs_driver = pytest.mark.skipif(not DRIVERS, reason=NO_DRIVER)


@pytest.mark.viewer
@needs_driver
def test_a_picture_shows_something_in_every_part(shown: Shown, tmp_path: Path) -> None:
    path = shown(cameras)[1]
    save_picture(path, tmp_path / "a.png", at_s=0.75, size=(1000, 640))
    pixels: Pixels = cv2.imread(str(tmp_path / "a.png"), cv2.IMREAD_COLOR)
    assert pixels.shape == (640, 1000, 3)
    # plots, texts and pictures with smooth edges have hundreds of colours, an empty window has a dozen
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 300
    for part in (pixels[:320, :500], pixels[:320, 500:], pixels[320:, :500], pixels[320:, 500:]):
        assert part.astype(np.float64).std() > 8  # a blank panel of the viewer has less than 3
    blue, green, red = (pixels[..., i].astype(int) for i in range(3))
    assert np.sum((red > 230) & (abs(green - 200) < 15) & (blue < 40)) > 100  # the disc of frame 7, at 0.71 s


@pytest.mark.viewer
@needs_driver
def test_a_view_that_fails_is_not_photographed(tmp_path: Path) -> None:
    clocks = Clocks()
    there = clocks.add("Signal", "/force", T, N)
    missing = replace(there, component="Signal:/none")
    with Output("broken", tmp_path / "a.rrd") as output:
        clocks.send(output, lambda: None)
        output.stream.send_blueprint(rrb.Blueprint(plot("broken", [Line(missing, "none", (255, 0, 0))])))
    with pytest.raises(CatheterError, match=r"view 'broken'.*Signal:/none"):
        save_picture(tmp_path / "a.rrd", tmp_path / "a.png", size=(400, 300))
