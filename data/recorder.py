"""Writing recordings: MCAP with protobuf messages, zstd, checksums, and nothing ever lost."""

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from data import message
from data.errors import BadInput, CatheterError
from data.files import cannot_write, check_free, place, unused
from data.seal import LIBRARY, SEAL, seal
from data.signal import Array, Signal
from data.topics import Topic
from data.units import SI_SPELLINGS, si_unit

CHUNK_BYTES = 1 << 20
RESERVED = ("origin", "scene", "truth")


class Recorder:
    """Writes one recording, as a context manager.

        origin = {"kind": "measured", "who": "bench 2", "when": "2026-11-22"}
        with Recorder("run.mcap", origin) as recorder:
            recorder.add(standard("/pressure"))
            recorder.write("/pressure", 0.012, 101.3e3)

    Until it is complete the file is named run.partial.mcap; complete, it moves to run.mcap in
    one step. A crash or a kill leaves the partial file, readable up to its last `flush_s`
    seconds of real time (None: up to the last full chunk, for data that is made faster than it
    happens). An older run.mcap stays untouched until then, and is replaced only with `replace`.

    origin: must say `kind`: "simulated" or "measured". scene: the scene's TOML text.
    truth: the parameters that made a simulated recording.
    start_ns: the wall clock at time 0, nanoseconds since 1970 (0 when there is none).
    Raises CannotWrite for a place that is taken, missing or full, BadInput for data no reader
    could trust: no origin, a wrong shape, time that does not increase within a topic.
    """

    def __init__(
        self,
        path: Path | str,
        origin: Mapping[str, str],
        *,
        scene: str = "",
        truth: Mapping[str, str] | None = None,
        start_ns: int = 0,
        flush_s: float | None = 1.0,
        replace: bool = False,
    ) -> None:
        if not isinstance(start_ns, int) or not 0 <= start_ns < 1 << 62:
            raise BadInput("start_ns", f"is {start_ns!r}", "expected whole nanoseconds since 1970")
        self.path = Path(path)
        self.partial = self.path
        if flush_s is not None and not (isinstance(flush_s, int | float) and flush_s > 0):
            raise BadInput("flush_s", f"is {flush_s!r}", "expected seconds, or None")
        self._written = 0
        self._failure: OSError | None = None
        self._records = _metadata(origin, scene, truth)
        self._start_ns, self._flush_s, self._replace = start_ns, flush_s, replace
        self._topics: dict[str, tuple[Topic, int]] = {}
        self._schemas: dict[tuple[str, tuple[str, ...]], int] = {}
        self._last_ns: dict[str, int] = {}
        self._lock = threading.RLock()
        self._stop = threading.Event()
        self._stop.set()

    def __enter__(self) -> Self:
        """Open the partial file, write what the recording is, and start the flush timer."""
        from mcap.writer import CompressionType, Writer

        if self._written or not self._stop.is_set() or self._topics:
            raise BadInput(self.path, "the recorder was used before", "make one for each recording")
        check_free(self.path, self._replace)
        self.partial = unused(self.path.with_stem(f"{self.path.stem}.partial"))
        try:
            self._file = self.partial.open("xb")
            self._writer = Writer(
                self._file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True
            )
            self._writer.start(library=LIBRARY)
            for name, fields in self._records.items():
                self._writer.add_metadata(name, seal(name, dict(fields)))
            self._writer.flush()
        except OSError as error:
            self.partial.unlink(missing_ok=True)
            raise cannot_write(self.path, error) from error
        self._stop.clear()
        if self._flush_s is not None:
            self._timer = threading.Thread(target=self._flush_often, args=(0.7 * self._flush_s,), daemon=True)
            self._timer.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        """Finish the file; move it to its place unless the block failed."""
        self._stop.set()
        with self._lock:
            empty = error is not None and not self._written  # it holds nothing that could be lost
            try:
                if self._failure is None and not empty:
                    self._writer.finish()
                    self._file.close()
            except OSError as failure:
                self._failure = failure
            if self._failure or empty:
                self._close_quietly()
                if not self._written or not self.partial.stat().st_size:
                    self.partial.unlink(missing_ok=True)
        if error is None and self._failure is None:
            place(self.partial, self.path, self._replace)
            return
        kept = f"what was recorded before that is kept in {self.partial}" if self.partial.exists() else ""
        if error is None and self._failure is not None:
            lost = cannot_write(self.path, self._failure)
            lost.add_note(kept)
            raise lost from self._failure
        if kept and isinstance(error, CatheterError):
            error.add_note(kept)

    def add(self, topic: Topic) -> None:
        """Declare a topic; once for each, before its first message."""
        if topic.name in self._topics:
            raise BadInput(topic.name, "was added before", "a topic is added once")
        _check_texts(topic.name, topic.metadata())
        for unit in set(topic.units) - set(SI_SPELLINGS):
            if si_unit(unit) != unit:
                raise BadInput(topic.name, f"unit {unit!r} is not SI", f"convert to {si_unit(unit)!r} before recording")
        key = (topic.schema_name, topic.components)
        with self._writing():
            if key not in self._schemas:
                camera = topic.is_camera
                data = message.camera_schema() if camera else message.schema(*key)
                self._schemas[key] = self._writer.register_schema(key[0], "protobuf", data)
            channel = self._writer.register_channel(topic.name, "protobuf", self._schemas[key], topic.metadata())
            self._topics[topic.name] = (topic, channel)

    def note(self, name: str, fields: Mapping[str, str]) -> None:
        """Write a metadata record, at any time before the end."""
        if name in RESERVED:
            raise BadInput(f"metadata {name!r}", "is written by the recorder itself", "choose another name")
        _check_texts("name", {"name": name})
        _check_texts(name, fields)
        with self._writing():
            self._writer.add_metadata(name, seal(name, dict(fields)))

    def write(self, name: str, time_s: float, values: ArrayLike) -> None:
        """Write one message: `values` holds a number for each component, in SI."""
        try:
            row = np.atleast_1d(np.asarray(values, dtype=np.float64))
            time = np.array([time_s], dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise BadInput(name, f"{values!r:.40} at {time_s!r:.40}: {error}", "expected numbers") from error
        if values is None or row.ndim != 1:
            raise BadInput(name, f"got values of shape {row.shape}", "expected a number for each component")
        self._write_rows([(name, time, row[None, :])])

    def write_signals(self, signals: Mapping[str, Signal]) -> None:
        """Write whole signals (or blocks of them), topic -> signal, merged by time."""
        rows = [(name, s.time_s, s.value[:, None] if s.value.ndim == 1 else s.value) for name, s in signals.items()]
        for name, signal in signals.items():
            unit = set(self._known(name)[0].units)
            if unit != {signal.unit}:
                raise BadInput(name, f"signal is in {signal.unit!r}", f"the topic is in {sorted(unit)}")
        self._write_rows(rows)

    def write_picture(self, name: str, time_s: float, picture: bytes, picture_format: str = "jpeg") -> None:
        """Write one encoded picture ("jpeg", "png" or "webp") to a camera topic."""
        topic, channel = self._known(name)
        if not topic.is_camera:
            raise BadInput(name, "is no camera", f"it holds {topic.components}")
        if not (isinstance(picture, bytes) and picture and isinstance(time_s, int | float)):
            raise BadInput(name, f"got {type(picture).__name__} at {time_s!r:.40}", "expected bytes and a time")
        _check_texts(name, {"format": picture_format})
        with self._writing():
            stamps = self._stamps(name, np.array([time_s], dtype=np.float64))
            data = message.encode_picture(int(stamps[0]), topic.frame or name, picture, picture_format)
            self._put([(int(stamps[0]), channel, data)], {name: stamps})

    def _write_rows(self, rows: list[tuple[str, Array, Array]]) -> None:
        with self._writing():  # stamps are checked and written under one lock, all of them or none
            messages: list[tuple[int, int, bytes]] = []
            stamped = {}
            for name, time_s, values in rows:
                topic, channel = self._known(name)
                if values.shape != (len(time_s), len(topic.components)) or topic.is_camera:
                    found = f"got values of shape {values.shape} for {len(time_s)} stamps"
                    raise BadInput(name, found, f"its components are {topic.components}")
                table = message.encode(values)
                data, size = table.tobytes(), table.itemsize
                stamped[name] = self._stamps(name, time_s)
                stamps = stamped[name].tolist()
                messages += [(ns, channel, data[i * size : (i + 1) * size]) for i, ns in enumerate(stamps)]
            if len(rows) > 1:
                messages.sort(key=lambda item: item[0])
            self._put(messages, stamped)

    def _stamps(self, name: str, time_s: Array) -> Any:
        """Return int64 nanoseconds since 1970, checked to follow what the topic holds."""
        if not np.isfinite(time_s).all() or (np.abs(time_s) > 1e9).any():
            bad = time_s[~(np.abs(time_s) <= 1e9)][0]
            raise BadInput(name, f"time is {bad} s", "expected finite seconds since the recording's start")
        stamps = self._start_ns + np.rint(time_s * 1e9).astype(np.int64)
        if len(stamps) and stamps[0] < 0:
            raise BadInput(name, f"time {time_s[0]} s lies before 1970", "MCAP stamps cannot be negative")
        before = self._last_ns.get(name, -1)
        steps = np.diff(stamps, prepend=before)
        if (steps <= 0).any():
            at = int(np.flatnonzero(steps <= 0)[0])
            raise BadInput(name, f"time {time_s[at]:.9g} s does not come after the one before", "stamps must increase")
        return stamps

    def _check_open(self) -> None:
        if self._failure is not None:
            raise cannot_write(self.path, self._failure)
        if self._stop.is_set():
            raise BadInput(self.path, "the recorder is not open", "use it inside its `with` block")

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Hold the lock; once the disk has failed nothing more is written: a gap would hide in the file."""
        with self._lock:
            self._check_open()
            try:
                yield
            except OSError as error:
                self._failure = error
                raise cannot_write(self.path, error) from error

    def _known(self, name: str) -> tuple[Topic, int]:
        self._check_open()
        if name not in self._topics:
            raise BadInput(name, "was not added", f"known topics: {', '.join(self._topics) or 'none'}")
        return self._topics[name]

    def _put(self, messages: list[tuple[int, int, bytes]], stamped: Mapping[str, Any]) -> None:
        self._last_ns |= {name: int(stamps[-1]) for name, stamps in stamped.items() if len(stamps)}
        for stamp, channel, data in messages:
            self._written += 1
            self._writer.add_message(channel, log_time=stamp, data=data, publish_time=stamp)

    def _flush_often(self, every_s: float) -> None:
        """Close the open chunk again and again; the caller leaves time for the flush itself."""
        while not self._stop.wait(every_s):
            with self._lock:
                if self._stop.is_set():
                    return
                try:
                    self._writer.flush()
                except OSError as error:  # a full disk: the next write, or the end, says so
                    self._failure = error
                    return

    def _close_quietly(self) -> None:
        try:
            self._file.close()
        except OSError:  # closing flushes, and the disk is what failed
            return


def _metadata(
    origin: Mapping[str, str],
    scene: str,
    truth: Mapping[str, str] | None,
) -> dict[str, Mapping[str, str]]:
    kind = origin.get("kind")
    if kind not in ("simulated", "measured"):
        raise BadInput("origin, kind", f"is {kind!r}", "expected 'simulated' or 'measured'")
    if truth and kind == "measured":
        raise BadInput("truth", "given for a measured recording", "only a simulation knows its truth")
    _check_texts("origin", origin)
    _check_texts("truth", truth or {})
    _check_texts("scene", {"toml": scene})
    found: dict[str, Mapping[str, str]] = {"origin": origin}
    if scene:
        found["scene"] = {"toml": scene}
    if truth:
        found["truth"] = truth
    return found


def _check_texts(name: str, fields: Mapping[str, str]) -> None:
    for key, value in fields.items():
        if not (isinstance(key, str) and isinstance(value, str)) or not _is_unicode(key + value):
            raise BadInput(f"metadata {name}, {key!r:.40}", f"is {value!r:.60}", "expected text")
        if key == SEAL:
            raise BadInput(f"metadata {name}, {key!r}", "is written by the recorder itself", "choose another key")


def _is_unicode(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:  # half a surrogate pair, as in a file name that is not UTF-8
        return False
    return True
