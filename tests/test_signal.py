"""A signal keeps its promises or is not made."""

import numpy as np
import pytest

from data.errors import BadInput
from data.signal import Signal


@pytest.mark.parametrize(
    ("time_s", "value", "found"),
    [
        ([0.0, 1.0, 1.0], [1, 2, 3], "from 1 s to 1 s"),
        ([0.0, 2.0, 1.0], [1, 2, 3], "from 2 s to 1 s"),
        ([0.0, np.nan, 1.0], [1, 2, 3], "time is nan"),
        ([0.0, 1.0], [1, 2, 3], "shape"),
        ([0.0, 1.0], ["a", "b"], "convert"),
        ([0.0, 1.0], np.zeros((2, 2, 2)), "shape"),
    ],
)
def test_a_signal_that_breaks_a_promise_is_refused_naming_the_sample(time_s, value, found) -> None:
    with pytest.raises(BadInput, match=found):
        Signal(time_s, value, "N", name="/force")


def test_interpolation_is_exact_on_straight_lines_and_never_extrapolates() -> None:
    time_s = np.array([0.0, 0.3, 1.0, 1.1])
    signal = Signal(time_s, np.stack([2 * time_s + 1, -time_s], axis=1), "m", components=("x", "y"))
    wanted = np.array([0.15, 0.7, 1.05])
    assert signal.at(wanted) == pytest.approx(np.stack([2 * wanted + 1, -wanted], axis=1), rel=1e-15)
    assert np.isnan(signal.at([-0.1, 1.2])).all()


def test_a_window_is_half_open_and_windows_join_to_the_whole() -> None:
    signal = Signal(np.arange(10.0), np.arange(10.0), "1")
    halves = [signal.window(None, 4.0), signal.window(4.0)]
    assert np.concatenate([half.value for half in halves]).tolist() == signal.value.tolist()
    assert halves[0].value.tolist() == [0, 1, 2, 3]


def test_a_signal_cannot_be_changed_nor_freeze_its_makers_array() -> None:
    mine = np.arange(3.0)
    signal = Signal(mine, mine, "1")
    with pytest.raises(ValueError, match="read-only"):
        signal.value[0] = 7
    mine[0] = -1.0
