"""The one list of topics: what a recording may hold, in which unit, made of which components."""

import re
from dataclasses import dataclass, replace

from data.errors import BadInput, nearest
from data.units import UNDOCUMENTED

CAMERA_SCHEMA = "foxglove.CompressedImage"


@dataclass(frozen=True, kw_only=True)
class Topic:
    """What one topic's messages hold: component names, an SI unit for each, and where it is from.

    An empty `components` is a camera: its messages are compressed pictures.
    """

    name: str
    components: tuple[str, ...]
    units: tuple[str, ...]
    frame: str = ""
    note: str = ""
    sensor: str = ""
    rate_hz: float | None = None

    def __post_init__(self) -> None:
        """Refuse what no reader could walk: a bad name, or units that do not match components."""
        if not re.fullmatch(r"(/[A-Za-z0-9_]+)+", self.name):
            raise BadInput(f"topic {self.name!r}", "is not written like a topic", "write for example '/pressure/1'")
        if len(self.units) != len(self.components):
            raise BadInput(self.name, f"{len(self.units)} units for {len(self.components)} components")
        for component in self.components:
            if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", component):
                raise BadInput(self.name, f"component {component!r}", "expected letters, digits and underscores")
        if len(set(self.components)) < len(self.components) or len(self.components) > 1000:
            raise BadInput(self.name, "component names repeat or are more than 1000")

    @property
    def is_camera(self) -> bool:
        """Whether the messages are pictures."""
        return not self.components

    @property
    def schema_name(self) -> str:
        """The message's name: '/pressure/1' -> 'catheter.Pressure'."""
        if self.is_camera:
            return CAMERA_SCHEMA
        words = [word for word in re.split(r"[/_]", self.name) if word and not word.isdigit()]
        return "catheter." + ("".join(word[:1].upper() + word[1:] for word in words) or "Signal")

    def metadata(self) -> dict[str, str]:
        """Return the channel metadata that says all this in the file."""
        if len(set(self.units)) == 1:
            text = {"unit": self.units[0]}
        else:
            text = {f"unit.{name}": unit for name, unit in zip(self.components, self.units, strict=True)}
        rate = f"{self.rate_hz:.12g}" if self.rate_hz else ""
        extra = {"frame": self.frame, "note": self.note, "sensor": self.sensor, "rate_hz": rate}
        return text | {key: value for key, value in extra.items() if value}


def from_metadata(name: str, components: tuple[str, ...], text: dict[str, str]) -> Topic:
    """Return the topic a file's channel describes; a unit it does not state is '1', 'undocumented'."""
    stated = "unit" in text or all(f"unit.{component}" in text for component in components)
    units = tuple(text.get(f"unit.{component}", text.get("unit", "1")) for component in components)
    note = text.get("note", "" if stated else UNDOCUMENTED)
    try:
        rate_hz = float(text["rate_hz"]) if "rate_hz" in text else None
    except ValueError:
        rate_hz = None
    return Topic(
        name=name,
        components=components,
        units=units,
        frame=text.get("frame", ""),
        note=note,
        sensor=text.get("sensor", ""),
        rate_hz=rate_hz,
    )


def _topic(name: str, components: str, units: str, frame: str = "") -> Topic:
    names = tuple(components.split())
    given = tuple(units.split())
    return Topic(name=name, components=names, units=given * len(names) if len(given) == 1 else given, frame=frame)


# Numbered topics (/pressure/1 to /pressure/3, one for each segment) stand here without their number.
STANDARD = {
    topic.name: topic
    for topic in (
        _topic("/drive", "command", "V"),
        _topic("/pressure", "pressure", "Pa"),
        _topic("/volume", "volume ratio", "m^3 1"),
        _topic("/stroke", "displacement", "m"),
        _topic("/force", "force", "N"),
        _topic("/flow", "flow", "m^3/s"),
        _topic("/twist", "angle sigma", "rad"),
        _topic("/extension", "length", "m"),
        _topic("/tip", "x y z", "m", "base"),
        _topic("/led", "state", "1"),
        _topic("/camera/top", "", ""),
        _topic("/camera/side", "", ""),
    )
}


def listed(name: str) -> Topic | None:
    """Return the listed topic of that name ('/pressure/2' is '/pressure' by another name), or None."""
    found = STANDARD.get(re.sub(r"/\d+$", "", name))
    return replace(found, name=name) if found else None


def standard(name: str) -> Topic:
    """Return the listed topic of that name, for `Recorder.add`. Raises BadInput naming the nearest."""
    found = listed(name)
    if found is None:
        raise BadInput(f"topic {name!r}", "is not listed", f"{nearest(name, STANDARD)}; or make a Topic of your own")
    return found


def markers(components: tuple[str, ...], *, note: str = "", rate_hz: float | None = None) -> Topic:
    """Return the topic of markers' coordinates m1_x, m1_y, m1_z, m2_x ... in the base's frame."""
    return Topic(
        name="/markers", components=components, units=("m",) * len(components), frame="base", note=note, rate_hz=rate_hz
    )
