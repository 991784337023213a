"""Reading recordings: columns of a topic, windows of time, pictures one by one, checksums always."""

import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from data import container
from data.chunk import Messages
from data.container import ChunkPlace
from data.decoders import Reader, reader
from data.errors import BadInput, DamagedRecording, RecordingCut
from data.files import open_regular
from data.signal import Array, Signal, check_increasing
from data.topics import Topic

if TYPE_CHECKING:
    import pandas as pd

Found = TypeVar("Found")

# One fixed set of words for what a user may find in `Recording.kind`.
SIMULATED, MEASURED, UNSTATED = "simulated", "measured", "unstated"


@dataclass(frozen=True)
class Picture:
    """One encoded picture of a camera topic: seconds from the start, "jpeg" or "png", the bytes."""

    time_s: float
    format: str
    data: bytes


@dataclass(frozen=True)
class Channel:
    """What a topic of this file is. `unreadable` says why its numbers cannot be had, if so."""

    topic: Topic
    ids: tuple[int, ...]
    messages: int
    reader: Reader = field(compare=False, repr=False)

    @property
    def unreadable(self) -> str:
        """Why the topic cannot be read, or an empty text."""
        return self.reader.unreadable


class Recording:
    """One recording, read on demand; a context manager.

        with Recording("run.mcap") as recording:
            pressure = recording.signal("/pressure")

    Whatever the file's length, memory holds three chunks and what is asked for. Every chunk that is
    read has its checksum verified. A file that was cut off is read up to the cut, which `cut` and
    a RecordingCut warning put in words. Times are seconds from `start_ns`, the first message.
    Raises BadInput for a file that is no recording, DamagedRecording for one whose bytes changed.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self._file = open_regular(self.path)
        try:
            self._contents = container.walk(self._file, self.path)
            self._verified: set[int] = set()  # chunks, by byte
            self.channels = self._describe()
            self.start_ns, self.end_ns = self._span()
            self.cut = self._contents.cut
            if self.cut:
                warnings.warn(f"{self.path} was {self.cut}", RecordingCut, stacklevel=2)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        """Return the recording itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        """Close the file."""
        self.close()

    def close(self) -> None:
        """Close the file; what was read stays."""
        self._file.close()

    @property
    def metadata(self) -> dict[str, dict[str, str]]:
        """The metadata records by name: origin, scene, truth, import."""
        return self._contents.metadata

    @property
    def kind(self) -> str:
        """'simulated', 'measured', or 'unstated' when the file does not say."""
        found = self.metadata.get("origin", {}).get("kind", UNSTATED)
        return found if found in (SIMULATED, MEASURED) else UNSTATED

    @property
    def scene(self) -> str:
        """The TOML text of the scene that was recorded, or an empty text."""
        return self.metadata.get("scene", {}).get("toml", "")

    @property
    def duration_s(self) -> float:
        """Seconds from the first to the last message."""
        return (self.end_ns - self.start_ns) / 1e9

    def signal(
        self,
        topic: str,
        component: str | None = None,
        *,
        start_s: float | None = None,
        end_s: float | None = None,
    ) -> Signal:
        """Return a topic's samples with start_s <= time < end_s, in SI.

        One component is an (n,) signal, several an (n, k) one; components in different units
        must be asked for one by one. Raises BadInput naming the topic and what there is instead.
        """
        parts = list(self.blocks(topic, component, start_s=start_s, end_s=end_s))
        columns, unit, channel = self._columns(topic, component)
        single = len(columns) == 1
        width = () if single else (len(columns),)
        return Signal(
            np.concatenate([part.time_s for part in parts]) if parts else np.empty(0),
            np.concatenate([part.value for part in parts]) if parts else np.empty((0, *width)),
            unit,
            channel.topic.frame,
            () if single else tuple(channel.topic.components[i] for i in columns),
            channel.topic.note,
            topic if component is None or len(channel.topic.components) == 1 else f"{topic}:{component}",
        )

    def blocks(
        self,
        topic: str,
        component: str | None = None,
        *,
        start_s: float | None = None,
        end_s: float | None = None,
    ) -> Iterator[Signal]:
        """Yield a topic piece by piece, one chunk's samples at a time; arguments as for `signal`."""
        columns, unit, channel = self._columns(topic, component)
        place = f"{self.path}, {topic}"
        base = Signal(np.empty(0), np.empty(0), unit, channel.topic.frame, (), channel.topic.note, topic)
        single = len(columns) == 1
        names = () if single else tuple(channel.topic.components[i] for i in columns)
        numbers = channel.reader.numbers
        assert numbers is not None

        def decoded(messages: Messages) -> tuple[Array, Array]:
            return self._seconds(messages.stamp_ns), numbers.decode(messages, place)[:, columns]

        last_s, total = -np.inf, 0
        for time_s, values in self._each(channel, start_s, end_s, decoded):
            check_increasing(time_s, place)
            if time_s[0] <= last_s:
                check_increasing(np.array([last_s, time_s[0]]), place)
            last_s, total = time_s[-1], total + len(time_s)
            yield replace(base, time_s=time_s, value=values[:, 0] if single else values, components=names)
        whole = start_s is None and end_s is None and self._contents.counts is not None
        if whole and total != channel.messages:
            raise DamagedRecording(place, f"holds {total} messages", f"its summary counts {channel.messages}")

    def pictures(self, topic: str, *, start_s: float | None = None, end_s: float | None = None) -> Iterator[Picture]:
        """Yield a camera topic's pictures one by one, still encoded."""
        channel = self._channel(topic)
        if not channel.topic.is_camera:
            raise BadInput(f"{self.path}, {topic}", "is no camera", f"it holds {channel.topic.components}")
        for messages in self._each(channel, start_s, end_s, _same):
            for index, time_s in enumerate(self._seconds(messages.stamp_ns).tolist()):
                place = f"{self.path}, {topic} at t = {time_s:.3f} s"
                assert channel.reader.pictures is not None
                picture, kind = channel.reader.pictures(messages.view(index), place)
                yield Picture(time_s, kind, picture)

    def messages(
        self, topic: str, *, start_s: float | None = None, end_s: float | None = None
    ) -> Iterator[tuple[float, bytes]]:
        """Yield any topic's messages one by one, as (seconds from the start, bytes as they were written).

        For what `signal` and `pictures` cannot read: texts, unknown encodings.
        """
        for messages in self._each(self._known(topic), start_s, end_s, _same):
            for index, time_s in enumerate(self._seconds(messages.stamp_ns).tolist()):
                yield time_s, messages.content(index)

    @property
    def verified(self) -> str:
        """How much of the file was read and its checksums verified so far; a window reads its own chunks only."""
        return f"{len(self._verified)} of {len(self._contents.chunks)} chunks read and verified; `check` reads all"

    def to_frame(self, topics: Sequence[str] | None = None) -> "pd.DataFrame":
        """Return topics as a pandas DataFrame: index time_s, columns such as '/force [N]'.

        Topics with clocks of their own meet in one index; where one has no sample stands NaN.
        """
        import pandas as pd

        columns = {}
        for name in topics or [n for n, c in self.channels.items() if not c.unreadable and not c.topic.is_camera]:
            topic = self._channel(name).topic
            for component, unit in zip(topic.components, topic.units, strict=True):
                signal = self.signal(name, component)
                label = name if len(topic.components) == 1 else f"{name}:{component}"
                columns[f"{label} [{unit}]"] = pd.Series(signal.value, index=pd.Index(signal.time_s, name="time_s"))
        return pd.DataFrame(columns)

    def _describe(self) -> dict[str, Channel]:
        """Return the channels by topic; several channels of one topic and schema are one."""
        found: dict[str, Channel] = {}
        for number, channel in self._contents.channels.items():
            count = (self._contents.counts or {}).get(number, 0)
            schema = self._contents.schemas.get(channel.schema_id)
            found_reader = reader(channel, schema, partial(self._first, number))
            topic = found_reader.topic
            before = found.get(channel.topic)
            if before and before.topic != topic:
                raise BadInput(f"{self.path}, {channel.topic}", "stands twice with different content")
            ids, messages = (before.ids, before.messages) if before else ((), 0)
            found[channel.topic] = Channel(topic, (*ids, number), messages + count, found_reader)
        return dict(sorted(found.items()))

    def _first(self, number: int) -> bytes | None:
        """Return the first message of a channel, which tells what a self-describing one holds."""
        for chunk in self._contents.chunks:
            if chunk.channels is None or number in chunk.channels:
                messages = self._chunk(chunk)
                at = np.flatnonzero(messages.channel == number)
                if at.size:
                    return messages.content(int(at[0]))
        for place in self._contents.loose:
            one = container.loose_message(self._file, place, self.path)
            if one.channel_id == number:
                return one.data
        return None

    def _span(self) -> tuple[int, int]:
        chunks = [chunk for chunk in self._contents.chunks if chunk.channels is None or chunk.channels]
        loose = [container.loose_message(self._file, place, self.path).log_time for place in self._contents.loose]
        starts = [chunk.start_ns for chunk in chunks] + loose
        ends = [chunk.end_ns for chunk in chunks] + loose
        return (min(starts), max(ends)) if starts else (0, 0)

    def _known(self, topic: str) -> Channel:
        if topic not in self.channels:
            found = ", ".join(self.channels) or "none"
            raise BadInput(self.path, f"has no topic {topic}", f"topics are: {found}")
        return self.channels[topic]

    def _channel(self, topic: str) -> Channel:
        channel = self._known(topic)
        if channel.unreadable:
            raise BadInput(f"{self.path}, {topic}", f"cannot be read: {channel.unreadable}")
        return channel

    def _columns(self, topic: str, component: str | None) -> tuple[list[int], str, Channel]:
        channel = self._channel(topic)
        names, units = channel.topic.components, channel.topic.units
        if channel.topic.is_camera:
            raise BadInput(f"{self.path}, {topic}", "is a camera", "read it with `pictures`")
        if component is not None and component not in names:
            raise BadInput(f"{self.path}, {topic}", f"has no component {component!r}", f"components are {names}")
        columns = list(range(len(names))) if component is None else [names.index(component)]
        if len({units[i] for i in columns}) > 1:
            raise BadInput(f"{self.path}, {topic}", f"components are in {units}", f"name one of {names}")
        return columns, units[columns[0]], channel

    def _each(
        self, channel: Channel, start_s: float | None, end_s: float | None, use: Callable[[Messages], Found]
    ) -> Iterator[Found]:
        """Yield use(a channel's messages) chunk by chunk, in the order of the file; threads work ahead."""
        start, end = self._nanoseconds(start_s, 0), self._nanoseconds(end_s, 1 << 63)

        def used(messages: Messages) -> Found | None:
            inside = (messages.stamp_ns >= start) & (messages.stamp_ns.astype(np.uint64) < end)
            kept = np.isin(messages.channel, channel.ids) & inside
            return use(messages.only(kept)) if kept.any() else None

        chunks = (c for c in self._contents.chunks if c.channels is None or not c.channels.isdisjoint(channel.ids))
        within = (chunk for chunk in chunks if chunk.end_ns >= start and chunk.start_ns < end)
        for found in _ahead(lambda chunk: used(self._chunk(chunk)), within):
            if found is not None:
                yield found
        for place in self._contents.loose:
            one = container.loose_message(self._file, place, self.path)
            found = used(Messages.of_one(one.channel_id, one.log_time, one.data))
            if found is not None:
                yield found

    def _chunk(self, chunk: ChunkPlace) -> Messages:
        messages = container.chunk_records(self._file, chunk, self.path).messages
        self._verified.add(chunk.place.offset)
        return messages

    def _nanoseconds(self, time_s: float | None, otherwise: int) -> int:
        """Return the stamp of a time: the one that a sample at that time was rounded to."""
        if time_s is None:
            return otherwise
        if not abs(time_s) < 9e9:  # 285 years, infinity, NaN
            if np.isnan(time_s):
                raise BadInput(self.path, "a window's border is NaN", "expected seconds or None")
            return 0 if time_s < 0 else 1 << 63
        return self.start_ns + round(time_s * 1e9)

    def _seconds(self, stamps_ns: NDArray[np.int64]) -> Array:
        return np.asarray((stamps_ns - self.start_ns) / 1e9)


def _same(messages: Messages) -> Messages:
    return messages


def _ahead(work: Callable[[ChunkPlace], Found], chunks: Iterable[ChunkPlace]) -> Iterator[Found]:
    """Yield work(chunk) in order; two threads are at most two chunks ahead, so memory stays bounded."""
    waiting: deque[Future[Found]] = deque()
    with ThreadPoolExecutor(2) as pool:
        try:
            for chunk in chunks:
                waiting.append(pool.submit(work, chunk))
                if len(waiting) > 2:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for left in waiting:
                left.cancel()
