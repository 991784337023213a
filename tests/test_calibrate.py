"""Constants from a noisy pressure and a noisy twist: unbiased, and as uncertain as said."""

import numpy as np
import pytest

from catheter.calibrate import Calibration, Curve, calibrate
from data.errors import BadInput
from data.signal import Array

TRUTH, SEED = np.log([0.21e6, 1.85e6]), np.array([0.20e6, 1.89e6])
LOADS = np.linspace(0.0, 70e3, 15)
ANGLE_SD, SHARE = 1e-3, 0.01


def _stiffening(log: Array) -> Curve:
    """Return an invented twist that turns up steeply towards the soft modulus, with its exact slopes."""
    soft, stiff = np.exp(log)
    near = LOADS / (0.5 * soft)
    value = 0.2 * np.expm1(3 * near) * (stiff / 1e6) ** -0.3
    rise = 0.6 * np.exp(3 * near) * (stiff / 1e6) ** -0.3
    return Curve(LOADS, value, rise / (0.5 * soft), np.stack([-rise * near, -0.3 * value], axis=1))


def _one(number: int) -> Calibration:
    rng = np.random.default_rng(number)
    load = np.linspace(1e3, 60e3, 200)
    noise = ANGLE_SD * rng.standard_normal(201)
    angle = _stiffening(TRUTH).at(load)[0] + noise[1:] - noise[0]  # counted from a frame of its own
    measured = load * (1 + SHARE * rng.standard_normal(200))
    return calibrate(_stiffening, measured, angle, angle_sd=ANGLE_SD, pressure_share=SHARE, seed=SEED)


def test_noise_in_the_pressure_does_not_pull_the_constants() -> None:
    found = [_one(number) for number in range(400)]
    error = np.array([np.log(one.moduli) - TRUTH for one in found])
    said = np.array([np.sqrt(np.diag(one.covariance)) for one in found])
    assert (np.abs(error.mean(axis=0)) < 0.15 * error.std(axis=0)).all()  # chance: 0.05
    held = (np.abs(error) < 1.96 * said).mean(axis=0)
    assert (np.abs(held - 0.95) < 0.03).all()
    assert 0.97 < np.mean([one.misfit for one in found]) < 1.03


def test_a_twist_that_turns_the_other_way_is_refused() -> None:
    load = np.linspace(1e3, 60e3, 50)
    angle = -_stiffening(TRUTH).at(load)[0]
    with pytest.raises(BadInput, match="from behind"):
        calibrate(_stiffening, load, angle, angle_sd=ANGLE_SD, pressure_share=SHARE, seed=SEED)
