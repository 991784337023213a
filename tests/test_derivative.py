"""The differentiator is exact where its theory says so, and quiet where noise is."""

import numpy as np
import pytest

from data.errors import BadInput
from sysid.derivative import _weights, noise_robust_derivative


def test_weights_are_the_published_ones() -> None:
    assert [tuple(32 * w for w in _weights(3))] == [(5.0, 4.0, 1.0)]  # Holoborodko, N = 7
    assert [tuple(128 * w for w in _weights(4))] == [(14.0, 14.0, 6.0, 1.0)]  # N = 9


def test_exact_for_quadratics_on_an_even_clock_and_lines_on_any() -> None:
    time_s = np.arange(40) / 83
    inner = slice(1, -1)
    assert noise_robust_derivative(time_s, 3 * time_s**2 - time_s)[inner] == pytest.approx(
        (6 * time_s - 1)[inner], abs=1e-12
    )
    jittered = np.cumsum(np.random.default_rng(0).uniform(0.5, 2, 40))
    assert noise_robust_derivative(jittered, 2.5 * jittered + 1) == pytest.approx(np.full(40, 2.5), rel=1e-12)


def test_error_falls_with_the_square_of_the_step() -> None:
    errors = []
    for n in (100, 200, 400):
        t = np.linspace(0, 1, n)
        errors.append(np.abs(noise_robust_derivative(t, np.sin(9 * t)) - 9 * np.cos(9 * t))[5:-5].max())
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.1)


def test_quieter_than_a_central_difference_on_noise() -> None:
    noise = np.random.default_rng(1).normal(size=20_000)
    ours = noise_robust_derivative(np.arange(20_000.0), noise)
    # variance 2 sum c_k^2, c = (14, 14, 6, 1) / 128, against 1/2 of the central difference
    assert ours.var() == pytest.approx(2 * (14**2 + 14**2 + 6**2 + 1) / 128**2, rel=0.05)


def test_one_sample_is_refused() -> None:
    with pytest.raises(BadInput, match="at least 2"):
        noise_robust_derivative(np.zeros(1), np.zeros(1))
    assert noise_robust_derivative(np.array([0.0, 2.0]), np.array([1.0, 5.0])).tolist() == [2.0, 2.0]
