"""A recording, replayed: its signals, its hysteresis loops, and models of its response.

Each stage is computed when it is asked for, and imports what it needs then.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from data.ask import Ask
from data.errors import BadInput
from data.recording import Recording
from data.signal import Signal
from data.topics import Topic

if TYPE_CHECKING:
    from sysid.fit import Fit
    from sysid.hysteresis import Loop
    from sysid.terms import Experiment

INPUTS = ("/volume", "/stroke")
RESPONSES = ("/force", "/pressure")
HELPERS = ("/pressure",)
MOST_SAMPLES = 400_000  # of one topic that are kept: a longer one is thinned, and `left_out` says so
MOST_NUMBERS = 20_000_000  # of all topics together


@dataclass(frozen=True)
class LoopFamily:
    """The loops of one signal over another, and the unit of their areas."""

    x: Signal
    y: Signal
    loops: list["Loop"]
    unit: str


class Replay:
    """What a recording shows, stage by stage. `ask` overrides the recording's own questions.

    Raises BadInput when a signal that was asked for by name is not there; what the topics do not
    allow is left out, and `left_out` says so.
    """

    def __init__(self, recording: Recording, ask: Ask | None = None) -> None:
        self.recording = recording
        self.left_out: list[str] = [
            f"{name}: {channel.unreadable}" for name, channel in recording.channels.items() if channel.unreadable
        ]
        salvaged = recording.metadata.get("salvage", {})
        self.left_out += [f"salvaged file, {key}: {text}" for key, text in salvaged.items() if "." in key]
        self._asked = ask

    @property
    def title(self) -> str:
        """What was recorded, and whether it was simulated or measured."""
        title = self.recording.metadata.get("origin", {}).get("title", self.recording.path.stem)
        return f"{title} ({self.recording.kind})"

    @cached_property
    def signals(self) -> dict[str, Signal]:
        """Every number the recording holds, one signal for each component: '/tip:x', '/force'."""
        found: dict[str, Signal] = {}
        for name, channel in self.recording.channels.items():
            if channel.unreadable or channel.topic.is_camera:
                continue
            found |= self._components(name, channel.topic)
        return {label: signal for label, signal in found.items() if len(signal) > 1 or self._skip(label)}

    @cached_property
    def cameras(self) -> list[str]:
        """The camera topics."""
        channels = self.recording.channels.items()
        return [name for name, channel in channels if channel.topic.is_camera and not channel.unreadable]

    @cached_property
    def ask(self) -> Ask:
        """Which signal answers which: as asked, else as the recording's scene asks, else by topic."""
        asked = self._asked or self._recorded_ask()
        response = asked.response or self._first(RESPONSES, ())
        named = asked.input or self._first(INPUTS, (response,))
        helpers = asked.others or tuple(topic for topic in HELPERS if topic in self.signals)
        others = tuple(label for label in helpers if label not in (response, named))
        if self._asked is not None and set(asked.others) - set(others):
            raise BadInput(f"{self.recording.path}, {response}", "is response or input already", "name another")
        for label in (*filter(None, (asked.response, asked.input)), *asked.others):
            if label not in self.signals:
                known = ", ".join(self.signals) or "none"
                raise BadInput(f"{self.recording.path}, {label}", "is not in the recording", f"signals are: {known}")
        if response and response == named:
            raise BadInput(f"{self.recording.path}, {response}", "is response and input at once", "name another")
        return Ask(response=response, input=named, others=others, split=asked.split)

    @cached_property
    def experiment(self) -> "Experiment | None":
        """Input, response and further signals on the response's clock; None without both."""
        from sysid.terms import Experiment

        ask = self.ask
        if not (ask.response and ask.input):
            self.left_out.append("loops and models: they need a response (/force) and an input (/stroke, /volume)")
            return None
        response = self.signals[ask.response]
        columns = [self.signals[label].at(response.time_s) for label in (ask.input, *ask.others)]
        sound = np.isfinite(np.stack([response.value, *columns])).all(axis=0)
        if not sound.all():
            count = int(np.sum(~sound))
            self.left_out.append(f"{count} samples of {ask.response} where it or another signal has no value")
        if sound.sum() < 2:
            self.left_out.append("loops and models: the signals never overlap in time")
            return None
        x, *others = (column[sound] for column in columns)
        return Experiment(
            response.time_s[sound],
            x,
            response.value[sound],
            dict(zip(ask.others, others, strict=True)),
            ask.input,
            ask.response,
        )

    @cached_property
    def loops(self) -> list[LoopFamily]:
        """Hysteresis loops: the response over the input, and each further signal over it too."""
        experiment = self.experiment
        if experiment is None:
            return []
        from sysid.hysteresis import loops

        x = replace(self.signals[self.ask.input], time_s=experiment.time_s, value=experiment.input)
        found = []
        for label, values in {self.ask.response: experiment.response, **experiment.others}.items():
            y = replace(self.signals[label], time_s=experiment.time_s, value=values)
            found.append(LoopFamily(x, y, loops(x.value, values), _product(x.unit, y.unit)))
        if not found[0].loops:
            self.left_out.append(f"loops: {x.name} never rises and falls by more than 10 % of its span")
        return found

    @cached_property
    def models(self) -> list["Fit"]:
        """Every candidate model, fitted and judged on held-out data."""
        from sysid.fit import SPLITS, candidates, compare

        experiment = self.experiment
        if experiment is None:
            return []
        if experiment.span == 0:
            self.left_out.append(f"models: {self.ask.input} never changes")
            return []
        models = candidates(self.ask.others)
        if len(experiment) <= 2 * max(len(model.terms) for model in models):
            self.left_out.append(f"models: {len(experiment)} samples are too few")
            return []
        try:
            return compare(models, experiment, SPLITS[self.ask.split](experiment))
        except BadInput as error:
            if self._asked is not None:  # the user chose: not ours to leave out
                raise
            self.left_out.append(f"models: {error}")
            return []

    @cached_property
    def best(self) -> "Fit | None":
        """The model with the smallest held-out error."""
        return min(self.models, key=lambda fit: fit.held_out_rmse, default=None)

    def _components(self, name: str, topic: Topic) -> dict[str, Signal]:
        """Return a topic's components as signals of their own; read once where they share a unit."""
        if len(topic.components) == 1:
            return {name: self._read(name)}
        if len(set(topic.units)) > 1:
            return {f"{name}:{one}": self._read(name, one) for one in topic.components}
        whole = self._read(name)
        return {
            f"{name}:{one}": replace(whole, value=whole.value[:, i], components=(), name=f"{name}:{one}")
            for i, one in enumerate(topic.components)
        }

    def _read(self, name: str, component: str | None = None) -> Signal:
        """Return a topic's numbers; of a very long one every second, third ... sample, read piece by piece."""
        count, stride = self.recording.channels[name].messages, self._stride(name)
        if stride == 1:
            return self.recording.signal(name, component)
        text = f"{name}: {stride - 1} of {stride} samples: it has {count:,}, more than a replay holds; `fit` uses all"
        if text not in self.left_out:
            self.left_out.append(text)
        times, values, skip = [], [], 0
        for part in self.recording.blocks(name, component):
            times.append(part.time_s[skip::stride])
            values.append(part.value[skip::stride])
            skip = (skip - len(part)) % stride
        label = name if component is None else f"{name}:{component}"
        return replace(part, time_s=np.concatenate(times), value=np.concatenate(values), name=label)

    def _stride(self, name: str) -> int:
        """Return which share of a topic's samples is kept: one in this many."""
        channels = [c for c in self.recording.channels.values() if not (c.unreadable or c.topic.is_camera)]
        numbers = sum(channel.messages * len(channel.topic.components) for channel in channels)
        longest = self.recording.channels[name].messages
        return max(1, -(-longest // MOST_SAMPLES), min(longest, -(-numbers // MOST_NUMBERS)))

    def _recorded_ask(self) -> Ask:
        try:
            return recorded_ask(self.recording)
        except BadInput as error:
            self.left_out.append(f"the questions of its scene: {error}")
            return Ask()

    def _first(self, preferred: tuple[str, ...], taken: tuple[str, ...]) -> str:
        return next((label for label in preferred if label in self.signals and label not in taken), "")

    def _skip(self, label: str) -> bool:
        self.left_out.append(f"{label}: fewer than 2 samples")
        return False


def recorded_ask(recording: Recording) -> Ask:
    """Return what the recording's own scene asks; nothing if it holds none. Raises BadInput for a bad scene."""
    from catheter.lab.scene import Scene

    return Scene.parse(recording.scene, f"{recording.path}, scene").ask if recording.scene else Ask()


def _product(x: str, y: str) -> str:
    """Return the unit of an area: 'J' for force over stroke and pressure over volume."""
    if {x, y} == {"N", "m"} or {x, y} == {"Pa", "m^3"}:
        return "J"
    return " ".join(unit for unit in (y, x) if unit != "1") or "1"
