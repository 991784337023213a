"""A measured or simulated quantity against time."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data.errors import BadInput
from data.units import UNDOCUMENTED

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Signal:
    """A quantity against time, in SI.

    time_s: (n,) seconds from the recording's start, finite and strictly increasing.
    value: (n,) or (n, k); a missing sample is NaN. unit: its SI unit ("Pa", "m^3", "1").
    frame: what a vector is expressed in. components: the k column names of a vector.
    note: what a reader must know ("undocumented" for a unit its maker never stated).
    name: the topic it came from. Raises BadInput naming the first sample that breaks this.
    """

    time_s: Array
    value: Array
    unit: str
    frame: str = ""
    components: tuple[str, ...] = ()
    note: str = ""
    name: str = "signal"

    def __post_init__(self) -> None:
        """Freeze the arrays as float64 and check every promise above."""
        for field in ("time_s", "value"):
            object.__setattr__(self, field, _float64(getattr(self, field), f"{self.name}, {field}"))
        if self.time_s.ndim != 1 or self.value.ndim not in (1, 2) or len(self.value) != len(self.time_s):
            shapes = f"time_s has shape {self.time_s.shape}, value {self.value.shape}"
            raise BadInput(self.name, shapes, "expected (n,) and (n,) or (n, k)")
        if self.components and (self.value.ndim == 1 or len(self.components) != self.value.shape[1]):
            raise BadInput(self.name, f"{len(self.components)} component names for value {self.value.shape}")
        check_increasing(self.time_s, self.name)

    @property
    def documented(self) -> bool:
        """Whether the signal's maker stated its unit."""
        return not (self.unit == "1" and self.note.startswith(UNDOCUMENTED))

    def __len__(self) -> int:
        return len(self.time_s)

    def window(self, start_s: float | None = None, end_s: float | None = None) -> "Signal":
        """Return the samples with start_s <= time < end_s; None leaves that side open."""
        first = 0 if start_s is None else int(np.searchsorted(self.time_s, start_s))
        last = len(self) if end_s is None else int(np.searchsorted(self.time_s, end_s))
        return replace(self, time_s=self.time_s[first:last], value=self.value[first:last])

    def at(self, time_s: ArrayLike) -> Array:
        """Return the value at other times, (m,) or (m, k), linear in between.

        Outside the signal, and where a neighbouring sample is NaN, the answer is NaN: nothing is
        extrapolated.
        """
        wanted = np.asarray(time_s, dtype=np.float64)
        if not len(self):
            return np.full(wanted.shape + self.value.shape[1:], np.nan)
        columns = [
            np.interp(wanted, self.time_s, column, left=np.nan, right=np.nan) for column in np.atleast_2d(self.value.T)
        ]
        return columns[0] if self.value.ndim == 1 else np.stack(columns, axis=-1)


def check_increasing(time_s: Array, place: str) -> None:
    """Raise BadInput naming the first stamp that is not finite or not after the one before."""
    if not np.isfinite(time_s).all():
        at = int(np.flatnonzero(~np.isfinite(time_s))[0])
        raise BadInput(f"{place}, sample {at}", f"time is {time_s[at]}", "every time stamp must be a finite number")
    backwards = np.flatnonzero(np.diff(time_s) <= 0)
    if backwards.size:
        at = int(backwards[0]) + 1
        raise BadInput(
            f"{place}, sample {at}",
            f"time goes from {time_s[at - 1]:.9g} s to {time_s[at]:.9g} s ({backwards.size} such steps)",
            "time stamps must increase; repair the clock when importing, see `import --list`",
        )


def _float64(values: ArrayLike, place: str) -> Array:
    try:
        array = np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise BadInput(place, str(error), "expected numbers") from error
    if array.flags.owndata and array is values:
        array = array.view()
    array.flags.writeable = False
    return array
