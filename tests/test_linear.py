"""Small changes about an operating point go as the nonlinear simulation says."""

import numpy as np
import pytest

from catheter.hydraulics import Solver, sampled, simulate, thesis_circuit
from catheter.linear import frequency_response, linearise
from data.errors import BadInput

CIRCUIT = thesis_circuit(transition_pa=1000.0)  # so that 1 Pa is a small change


@pytest.mark.parametrize("frequency_hz", [0.2, 2.0])
def test_the_response_is_that_of_a_small_sine(frequency_hz: float) -> None:
    base_pa, amplitude_pa, cycles = 40e3, 1.0, 12
    end_s = cycles / frequency_hz + 20.0
    drive = sampled(lambda t: base_pa + amplitude_pa * np.sin(2 * np.pi * frequency_hz * t), end_s, tolerance_pa=1e-7)
    run = simulate(CIRCUIT, drive, CIRCUIT.volume(base_pa), Solver(tolerance=1e-12))
    time_s = np.linspace(end_s - 4 / frequency_hz, end_s, 4001)[:-1]
    wave = np.exp(-2j * np.pi * frequency_hz * time_s)
    measured = 2j * (wave[:, None] * (run.at(time_s) - CIRCUIT.volume(base_pa))).mean(axis=0) / amplitude_pa
    response = frequency_response(CIRCUIT, base_pa, frequency_hz)[:, 0]
    assert np.abs(measured - response).max() < 2e-3 * np.abs(response).max()  # 1 Pa of 1000 is not infinitely small


def test_at_rest_it_is_the_static_stiffness_and_stable() -> None:
    system = linearise(CIRCUIT, 40e3)
    assert (system.poles().real < 0).all()
    step = 1.0
    static = (CIRCUIT.volume(40e3 + step) - CIRCUIT.volume(40e3 - step)) / (2 * step)
    np.testing.assert_allclose(frequency_response(CIRCUIT, 40e3, 1e-9)[:, 0].real, static, rtol=1e-6)


def test_what_cannot_be_an_operating_point_is_refused() -> None:
    for source_pa, volume in ((np.nan, [1.1, 1.1, 1.1]), (1e4, [1.1, 1.1]), (1e4, [1.1, -1.0, 1.1])):
        with pytest.raises(BadInput, match="operating point"):
            linearise(CIRCUIT, source_pa, volume)
