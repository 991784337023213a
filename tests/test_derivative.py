"""The differentiator is exact where its theory says so, and quiet where noise is."""

import numpy as np
import pytest

from catheter.lab.sysid_study import PUBLISHED, chirp_truth, noisy, polynomial_force
from data.errors import BadInput
from sysid.derivative import _weights, noise_robust_derivative
from sysid.motion import DEFAULT, METHODS, choose_half, motion


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


def test_the_default_is_exact_for_polynomials_up_to_its_order() -> None:
    time_s = np.arange(100) / 83
    cubic = motion(time_s, time_s**6 - time_s**3, half=9)
    known = cubic.known
    assert known.sum() == 100 - 18
    t = time_s[known]
    assert cubic.position[known] == pytest.approx(t**6 - t**3, abs=1e-9)
    assert cubic.velocity[known] == pytest.approx(6 * t**5 - 3 * t**2, abs=1e-7)
    assert cubic.acceleration[known] == pytest.approx(
        30 * t**4 - 6 * t, abs=1e-4
    )  # rounding of scipy's weights, 1e-11, times 83 twice


@pytest.mark.parametrize("method", METHODS)
def test_every_method_follows_a_slow_wave(method: str) -> None:
    time_s = np.arange(1500) / 83
    wave = np.sin(2 * time_s)
    found = motion(time_s, wave, method, half=4)
    inner = slice(200, -200)  # the Kalman filter begins with a velocity of 0
    assert found.velocity[inner] == pytest.approx(2 * np.cos(2 * time_s[inner]), abs=5e-3)
    assert found.acceleration[inner] == pytest.approx(-4 * wave[inner], abs=2e-2)


@pytest.mark.parametrize("method", METHODS)
def test_the_gain_that_chooses_a_width_is_the_methods_own(method: str) -> None:
    time_s, half = np.arange(3000.0), 6
    for phase in (0.1, 0.3, 0.6):
        found = motion(time_s, np.cos(phase * time_s), method, half)
        inner = slice(500, -500)
        gain = found.acceleration[inner] @ np.cos(phase * time_s[inner]) / np.sum(np.cos(phase * time_s[inner]) ** 2)
        # the Kalman gain is that of continuous time
        assert METHODS[method].gain(half, np.array([phase]))[0] == pytest.approx(gain, abs=0.03 * phase**2)


def test_noise_is_measured_and_more_noise_widens_the_window() -> None:
    draw = np.random.default_rng(0).normal(size=20_000)
    wave = np.sin(np.cumsum(np.linspace(0.01, 0.3, 20_000)))
    widths = []
    for noise in (1e-4, 1e-3, 1e-2, 1e-1):
        half, found = choose_half(wave + noise * draw)
        assert found == pytest.approx(noise, rel=0.05)
        widths.append(half)
    assert widths == sorted(widths)
    assert widths[0] < widths[-1]


def test_the_default_is_best_at_40_db_and_its_bias_small() -> None:
    time_s, exact = chirp_truth(1800.0)
    plant, _ = PUBLISHED["unconstrained"]
    force, biases, errors = polynomial_force(plant, exact), [], {}
    for method in (DEFAULT, "noise-robust"):
        for seed in range(2):
            found = motion(time_s, noisy(exact.position, 40, seed), method)
            known = found.known
            errors[method] = np.std((found.acceleration - exact.acceleration)[known])
            x, xdd = found.position[known], found.acceleration[known]
            columns = np.column_stack([np.ones_like(x), x**3 / 1e4, x**2 / 1e3, xdd**2 / 1e5])
            weight = np.linalg.lstsq(columns, force[known])[0][3] / 1e5
            biases += [weight / plant.inertia - 1] if method == DEFAULT else []
    assert errors[DEFAULT] < errors["noise-robust"]
    assert np.abs(biases).max() < 0.05


def test_gaps_nan_and_jitter_are_repaired_and_said() -> None:
    time_s = np.arange(3000) / 83
    wave = np.sin(2 * time_s)
    wave[:100] = wave[1500:1600] = np.nan
    time_s[2500:] += 4.0
    found = motion(time_s, wave, half=9)
    assert len(found.notes) == 2
    assert "200 samples are NaN" in found.notes[0]
    assert "2 gaps wider" in found.notes[1]
    assert not found.known[[50, 105, 1495, 1550, 1605, 2495, 2505]].any()
    assert found.acceleration[200:1400] == pytest.approx(-4 * wave[200:1400], abs=1e-6)
    jittered = np.cumsum(np.random.default_rng(1).uniform(0.8, 1.2, 2000)) / 83
    carried = motion(jittered, np.sin(2 * jittered), half=9)
    assert "cubic spline" in carried.notes[0]
    assert carried.acceleration[50:-50] == pytest.approx(-4 * np.sin(2 * jittered[50:-50]), abs=2e-3)


@pytest.mark.parametrize(
    ("time_s", "value", "found"),
    [
        (np.arange(3.0), np.arange(3.0), "longest stretch has 3 samples; at least 17"),
        (np.array([0.0, 1.0, 1.0]), np.arange(3.0), "time stamps must increase"),
        (np.arange(50.0), np.full(50, np.nan), "longest stretch has 0"),
        (np.arange(50.0), np.full(50, np.inf), "infinite"),
        (np.arange(50.0), np.where(np.arange(50) % 16 < 8, np.nan, 1.0), "8 samples; at least 17"),
    ],
)
def test_what_cannot_be_differentiated_is_refused(time_s: np.ndarray, value: np.ndarray, found: str) -> None:
    with pytest.raises(BadInput, match=found):
        motion(time_s, value)
    with pytest.raises(BadInput, match="known: Savitzky-Golay"):
        motion(time_s, value, "Euler")
