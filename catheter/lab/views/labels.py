"""What views are called, and the colours that are theirs."""

import re

import numpy as np

from data.recording import SIMULATED, UNSTATED
from data.signal import Array

Colour = tuple[int, int, int]

MEASURED: Colour = (76, 160, 235)
BEST: Colour = (255, 165, 60)
MODELS: tuple[Colour, ...] = (
    (214, 96, 180),
    (110, 200, 110),
    (225, 90, 85),
    (160, 130, 235),
    (80, 200, 200),
    (200, 180, 70),
    (180, 130, 100),
    (150, 170, 190),
    (235, 130, 160),
)
SIGNALS: tuple[Colour, ...] = (MEASURED, MODELS[1], BEST, *MODELS[3:6], MODELS[0], MODELS[2])
FRAME: Colour = (140, 140, 145)
TEXT: Colour = (200, 200, 205)
GRID: Colour = (60, 60, 64)
MARK: Colour = (255, 80, 70)

# Five anchors of the viridis ramp, lifted at the dark end to show on a dark ground.
_RAMP = np.array([(125, 95, 200), (70, 110, 190), (33, 145, 140), (94, 201, 98), (253, 231, 37)], dtype=np.float64)


def view_name(what: str, unit: str, kind: str) -> str:
    """Return 'simulated force [N]': no view is without the word that says where its data are from.

    The word comes first, because a narrow view cuts the end of its name.
    """
    if what.startswith(SIMULATED):  # a model's topic, which says so itself, beside a measurement
        return f"{what} [{unit}]" if unit else what
    word = f"{kind}:" if kind == UNSTATED else kind
    return f"{word} {what} [{unit}]" if unit else f"{word} {what}"


def plain(label: str) -> str:
    """Return a signal's label as views print it: '/tip:x' -> 'tip x'."""
    return label.lstrip("/").replace(":", " ")


def literal(text: str, most: int = 300) -> str:
    """Return a text for markdown that shows as it is written, on one line, cut to `most` characters."""
    line = " ".join(text.split())
    cut = line if len(line) <= most else f"{line[:most]} ..."
    return re.sub(r"([\\`*_{}\[\]<>#|~!$&])", r"\\\1", cut)


def ramp(count: int) -> list[Colour]:
    """Return `count` colours from violet (first) to yellow (last)."""
    places = np.linspace(0, len(_RAMP) - 1, max(count, 2))
    columns = [np.interp(places, np.arange(len(_RAMP)), channel) for channel in _RAMP.T]
    return [(int(r), int(g), int(b)) for r, g, b in zip(*columns, strict=True)][:count]


def ticks(low: float, high: float, most: int = 6) -> Array:
    """Return at most `most` round numbers (1, 2 or 5 times a power of ten) between low and high."""
    span = high - low
    if not (np.isfinite(span) and span > 0):
        return np.array([low])
    power = 10.0 ** np.floor(np.log10(span / most))
    step = next(power * m for m in (1, 2, 5, 10, 20) if span / (power * m) <= most - 1 or m == 20)
    first, last = np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9)
    return np.asarray(np.arange(first, last + 1) * step + 0.0)  # adding 0 turns -0 into 0
