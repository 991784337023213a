"""A replay shows what the topics allow, and says what it left out."""

from pathlib import Path

import numpy as np
import pytest
from helpers import SIMULATED

from catheter.lab.recording_commands import SHIPPED
from catheter.lab.replay import Replay
from data.ask import Ask
from data.errors import BadInput
from data.recorder import Recorder
from data.recording import Recording
from data.signal import Signal
from data.topics import Topic


def record(path: Path, **signals: Signal) -> Path:
    with Recorder(path, SIMULATED, flush_s=None) as recorder:
        for name, signal in signals.items():
            recorder.add(Topic(name=f"/{name}", components=("value",), units=(signal.unit,)))
        recorder.write_signals({f"/{name}": signal for name, signal in signals.items()})
    return path


T = np.linspace(0, 20, 1500)
X = 0.01 * np.sin(T)


def test_the_shipped_bender_is_explained_to_its_noise() -> None:
    with Recording(SHIPPED) as recording:
        replay = Replay(recording)
        assert replay.title.endswith("(simulated)")
        assert replay.best is not None
        # force noise 20 mN; volume noise 0.01 mL times a slope of up to 2.2 N/mL adds as much again
        assert 0.02 < replay.best.held_out_rmse < 0.045
        assert "Maxwell" in replay.best.model.name
        assert len(replay.loops) == 2
        assert replay.left_out == []


def test_the_error_is_that_of_model_minus_measurement() -> None:
    with Recording(SHIPPED) as recording:
        replay = Replay(recording)
        force = recording.signal("/force").value
        for fit in replay.models:
            assert np.sqrt(np.mean((fit.predicted - force) ** 2)) == pytest.approx(fit.rmse, rel=1e-9)


def test_signals_on_clocks_of_their_own_meet_on_the_responses(tmp_path: Path) -> None:
    slow = np.linspace(0, 20, 301)
    path = record(tmp_path / "a.mcap", force=Signal(T, 100 * X, "N"), stroke=Signal(slow, 0.01 * np.sin(slow), "m"))
    with Recording(path) as recording:
        experiment = Replay(recording).experiment
        assert experiment is not None
        assert experiment.time_s == pytest.approx(T, abs=1e-9)
        assert np.abs(experiment.input - X).max() < 0.01 * (20 / 300) ** 2 / 8 * 1.01  # linear in between: h^2/8 x"


@pytest.mark.parametrize(
    ("signals", "said"),
    [
        ({"force": Signal(T, X, "N")}, "they need a response"),
        ({"force": Signal(T, X, "N"), "stroke": Signal(T, 0 * X, "m")}, "never changes"),
        ({"force": Signal(T, X, "N"), "stroke": Signal(T + 100, X, "m")}, "never overlap"),
        ({"force": Signal(T[:9], X[:9], "N"), "stroke": Signal(T[:9], X[:9], "m")}, "too few"),
        ({"force": Signal(T, X, "N"), "stroke": Signal(T, T, "m")}, "never rises and falls"),
        ({"force": Signal(T[:1], X[:1], "N")}, "/force: fewer than 2 samples"),
    ],
)
def test_what_the_topics_do_not_allow_is_left_out_and_said(tmp_path: Path, signals: dict, said: str) -> None:
    with Recording(record(tmp_path / "a.mcap", **signals)) as recording:
        replay = Replay(recording)
        models, loops = replay.models, replay.loops
        assert any(said in text for text in replay.left_out)
        assert not models or not any(family.loops for family in loops)


def test_nan_samples_are_left_out_and_counted(tmp_path: Path) -> None:
    force = 100 * X
    force[100:130] = np.nan
    path = record(tmp_path / "a.mcap", force=Signal(T, force, "N"), stroke=Signal(T, X, "m"))
    with Recording(path) as recording:
        replay = Replay(recording)
        assert replay.experiment is not None
        assert len(replay.experiment) == 1470
        assert any("30 samples of /force" in text for text in replay.left_out)


def test_asking_for_what_is_not_there_is_refused(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", force=Signal(T, X, "N"))
    with Recording(path) as recording, pytest.raises(BadInput, match="/speed: is not in the recording; signals are"):
        assert Replay(recording, Ask(response="/speed")).ask


def test_nothing_is_computed_that_is_not_asked_for(recorded: Path) -> None:
    with Recording(recorded) as recording:
        replay = Replay(recording)
        assert replay.title
        assert replay.ask.response == "/force"
        assert "models" not in vars(replay)
        assert "loops" not in vars(replay)
