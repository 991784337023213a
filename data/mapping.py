"""How a laboratory's log becomes a recording: which column is which quantity, in which unit."""

from dataclasses import dataclass
from pathlib import Path

from data.ask import Ask
from data.errors import BadInput, nearest
from data.options import find_toml, load_toml, option, read, shipped_names
from data.topics import Topic
from data.topics import listed as listed_topic
from data.units import UNDOCUMENTED, si_unit

FOLDER = Path(__file__).parent / "mappings"
SEPARATORS = {"comma": ",", "tab": "\t", "semicolon": ";", "space": None}


@dataclass(frozen=True, kw_only=True)
class Source:
    """Whose log it is: goes into the recording's origin."""

    title: str
    who: str
    licence: str
    url: str = ""
    version: str = ""
    when: str = ""


@dataclass(frozen=True, kw_only=True)
class Format:
    """The text: how cells are separated, what the columns are called, whether a header says so."""

    columns: tuple[str, ...]
    separator: str = option("comma", choices=tuple(SEPARATORS))
    header: bool = False


@dataclass(frozen=True, kw_only=True)
class Clock:
    """Which column is the time, and the repairs its faults are known to need.

    drop_first: leading rows without a sound stamp. duplicates: "drop" keeps the first row of each
    stamp that repeats. period: the clock is row number x period, believed only if every printed
    stamp agrees with it to its last printed digit; `digits`, how many significant ones are printed,
    must be stated with it.
    """

    column: str
    unit: str = "s"
    drop_first: int = option(0, least=0)
    duplicates: str = option("refuse", choices=("refuse", "drop"))
    period: float | None = option(None, unit="s", least=1e-9)
    digits: int | None = option(None, least=1, most=17)


@dataclass(frozen=True, kw_only=True)
class Column:
    """One topic: the columns it is made of, and the unit they are written in.

    unit "undocumented" records numbers as they are, marked so. nan: "head" lets the topic begin
    where its leading NaN rows end; "keep" records NaN as missing; otherwise NaN is refused.
    """

    topic: str
    columns: tuple[str, ...]
    unit: str
    components: tuple[str, ...] = ()
    frame: str = ""
    sensor: str = ""
    note: str = ""
    nan: str = option("refuse", choices=("refuse", "head", "keep"))

    def described(self) -> Topic:
        """Return the recording's topic; component names default to the standard list's."""
        listed = listed_topic(self.topic)
        names = self.components or (listed.components[: len(self.columns)] if listed else self.columns)
        unit = "1" if self.unit == UNDOCUMENTED else si_unit(self.unit)
        if not self.columns or len(names) != len(self.columns):
            raise BadInput(self.topic, f"{len(self.columns)} columns for components {names}", "name as many")
        expected = {listed.units[listed.components.index(n)] for n in names if listed and n in listed.components}
        if self.unit != UNDOCUMENTED and expected and expected != {unit}:
            raise BadInput(self.topic, f"unit {self.unit!r}", f"the topic is in {', '.join(sorted(expected))}")
        note = "; ".join(filter(None, (UNDOCUMENTED if self.unit == UNDOCUMENTED else "", self.note)))
        return Topic(
            name=self.topic,
            components=tuple(names),
            units=(unit,) * len(names),
            frame=self.frame,
            sensor=self.sensor,
            note=note,
        )


@dataclass(frozen=True, kw_only=True)
class Mapping:
    """A whole import mapping, as its TOML file holds it."""

    source: Source
    format: Format
    clock: Clock
    topics: tuple[Column, ...]
    ask: Ask
    text: str


def names() -> list[str]:
    """Return the names of the mappings that come with the project."""
    return shipped_names(FOLDER)


def load(name: str) -> Mapping:
    """Return a shipped mapping by name, or one from a TOML file by path.

    Raises BadInput naming the file and key of whatever is wrong in it.
    """
    path = find_toml(name, FOLDER, "mapping")
    tables, text = load_toml(path)
    for key in tables:
        if key not in ("source", "format", "clock", "topic", "ask"):
            raise BadInput(
                f"{path}, [{key}]", "is no such table", nearest(key, ("source", "format", "clock", "topic", "ask"))
            )
    listed = tables.get("topic", [])
    if not isinstance(listed, list) or not listed:
        raise BadInput(f"{path}, [[topic]]", "is missing", "name at least one topic")
    found = Mapping(
        source=read(Source, tables.get("source", {}), f"{path}, [source]"),
        format=read(Format, tables.get("format", {}), f"{path}, [format]"),
        clock=read(Clock, tables.get("clock", {}), f"{path}, [clock]"),
        topics=tuple(read(Column, table, f"{path}, [[topic]] {i + 1}") for i, table in enumerate(listed)),
        ask=read(Ask, tables.get("ask", {}), f"{path}, [ask]"),
        text=text,
    )
    _check(found, path)
    return found


def _check(found: Mapping, path: Path) -> None:
    """Refuse what the tables say together: names that repeat or are nowhere, a clock that is no time."""
    for what, listed in (("column", found.format.columns), ("topic", tuple(topic.topic for topic in found.topics))):
        twice = next((name for name in listed if listed.count(name) > 1), None)
        if twice is not None:
            raise BadInput(f"{path}, {what} {twice!r}", "stands twice", f"each {what} needs a name of its own")
    if found.clock.period is not None and found.clock.digits is None:
        raise BadInput(f"{path}, [clock] digits", "is missing", "a period is checked to the stamps' last printed digit")
    if si_unit(found.clock.unit) != "s":
        raise BadInput(f"{path}, [clock] unit", f"is {found.clock.unit!r}", "expected a unit of time")
    for topic in found.topics:
        try:
            topic.described()
        except BadInput as error:
            raise BadInput(f"{path}, [[topic]] {topic.topic}", str(error)) from error
    for column in (found.clock.column, *(c for topic in found.topics for c in topic.columns)):
        if column not in found.format.columns:
            raise BadInput(
                f"{path}, column {column!r}", "is not in [format] columns", nearest(column, found.format.columns)
            )
