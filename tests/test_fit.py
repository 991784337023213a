"""Models find the truth they were made from, and the real recordings' published marks."""

from pathlib import Path

import numpy as np
import pytest

from catheter.lab.replay import Replay
from data.ask import Ask
from data.csv_import import import_log
from data.errors import BadInput
from data.mapping import load
from data.recording import Recording
from sysid.fit import SHARES, SPLITS, Model, alternate_steps, candidates, compare, fit, second_half
from sysid.hysteresis import stop
from sysid.terms import Experiment, Other, Play, Power, Stop

DRAW = np.random.default_rng(5)
TIME = np.arange(4000) / 83.0
X = np.sin(0.7 * TIME) * (1 + 0.3 * np.sin(0.11 * TIME)) * 1e-5


def experiment(response: np.ndarray, **others: np.ndarray) -> Experiment:
    return Experiment(TIME, X, response, {f"/{name}": value for name, value in others.items()})


def test_maxwell_slip_recovers_the_springs_it_was_made_from() -> None:
    radii = np.array(SHARES) * np.ptp(X)
    stiffness = np.array([3e4, 0.0, 2e4, 0.0, 1e4])
    made = experiment(0.5 + 1e5 * X + stop(X, radii) @ stiffness)
    found = fit(candidates(())[-2], made, second_half(made))
    weights = dict(zip((term.name for term in found.model.terms), found.weights, strict=True))
    assert found.model.name == "Maxwell slip"
    assert [weights[Stop(share).name] for share in SHARES[:4]] == pytest.approx(stiffness[:4], rel=1e-8, abs=1e-6)
    assert found.rmse < 1e-12
    assert found.held_out_rmse < 1e-12
    assert found.fit_percent == pytest.approx(100, abs=1e-9)


def test_rmse_and_fit_percent_are_what_they_are_called() -> None:
    noise = DRAW.normal(size=4000)
    made = experiment(2.0 + noise)
    found = fit(Model("constant", (Power(0),)), made, second_half(made))
    assert found.rmse == pytest.approx(noise.std(), rel=1e-12)
    assert found.fit_percent == pytest.approx(0, abs=1e-9)  # the mean explains nothing of the spread
    half = TIME[-1] / 2 > TIME
    held = noise[~half] - noise[half].mean()
    assert found.held_out_rmse == pytest.approx(np.sqrt(np.mean(held**2)), rel=1e-12)


def test_held_out_data_do_not_touch_the_fit_they_judge() -> None:
    made = experiment(1e5 * X)
    changed = made.response.copy()
    changed[~second_half(made).fitted] += 7.0
    judged = fit(Model("line", (Power(0), Power(1))), experiment(changed), second_half(made))
    assert judged.held_out_rmse == pytest.approx(7.0, rel=1e-9)


def test_extrapolation_is_noticed() -> None:
    x = np.linspace(0, 1, 4000)
    ramp = Experiment(TIME, x, x**2)
    cubic = Model("cubic", tuple(map(Power, range(4))))
    assert fit(cubic, ramp, second_half(ramp)).extrapolated > 0.9
    wave = experiment(X)
    assert fit(cubic, wave, second_half(wave)).extrapolated < 0.05


def test_steps_are_counted_and_too_few_refused() -> None:
    x = np.repeat(np.arange(8.0), 500)
    split = alternate_steps(Experiment(TIME, x, x))
    assert split.name == "every other of 8 steps held out"
    assert split.fitted.tolist() == (x % 2 == 0).tolist()
    with pytest.raises(BadInput, match="at least 4"):
        alternate_steps(experiment(X))


def test_what_cannot_be_fitted_is_refused() -> None:
    still = Experiment(TIME, np.ones(4000), TIME)
    with pytest.raises(BadInput, match="input span of 0"):
        fit(Model("line", (Power(0), Power(1))), still, second_half(still))
    with pytest.raises(BadInput, match="/pressure: is not in the experiment"):
        fit(Model("p", (Other("/pressure"),)), experiment(X), second_half(experiment(X)))


def test_every_candidate_has_its_constant_and_helpers() -> None:
    for model in candidates(("/pressure",)):
        assert Power(0) in model.free
    assert not any(isinstance(term, Other) for model in candidates(()) for term in model.terms)
    assert sum(isinstance(term, Play) for term in candidates(())[3].nonnegative) == len(SHARES)


def replayed(real: Path, folder: Path, log: str, name: str, ask: Ask | None = None) -> dict[str, tuple[float, float]]:
    import_log(real / log, load(name), folder / "log.mcap")
    with Recording(folder / "log.mcap") as recording:
        return {m.model.name: (m.rmse, m.held_out_rmse) for m in Replay(recording, ask).models}


def test_maxwell_slip_on_the_real_piston(real: Path, tmp_path: Path) -> None:
    found = replayed(real, tmp_path, "soft_actuators/zillen/friction_O-ring257_1bar.csv", "zillen")
    in_sample, held_out = found["Maxwell slip + pressure"]
    assert in_sample <= 0.8  # N, where the force's standard deviation is 6.66 N
    assert held_out <= 0.95
    assert found["pressure"][0] == pytest.approx(1.60, abs=0.01)
    assert found["cubic + pressure"][0] == pytest.approx(1.05, abs=0.01)


def test_signed_play_on_the_real_motor(real: Path, tmp_path: Path) -> None:
    found = replayed(real, tmp_path, "hydraulic_rig/MotorRotation.csv", "motor_rotation")
    assert found["cubic, signed"][0] == pytest.approx(0.083, abs=0.001)
    assert found["cubic + play, signed"][0] <= 0.06
    assert found["cubic + play, signed"][1] < found["cubic, signed"][1]


def test_on_the_real_motor_a_rising_and_falling_split_extrapolates(real: Path, tmp_path: Path) -> None:
    import_log(real / "hydraulic_rig/MotorRotation.csv", load("motor_rotation"), tmp_path / "log.mcap")
    with Recording(tmp_path / "log.mcap") as recording:
        experiment = Replay(recording).experiment
        assert experiment is not None
        play = [model for model in candidates(()) if model.name == "cubic + play, signed"]
        assert compare(play, experiment, SPLITS["half"](experiment))[0].extrapolated > 0.9
        assert compare(play, experiment, SPLITS["steps"](experiment))[0].extrapolated < 0.2
