"""A periodic state closes, is where waiting leads, and its derivative is the derivative."""

import numpy as np
import pytest

from catheter.hydraulics import Solver, SquareWave, simulate, thesis_circuit
from catheter.periodic import Closing, periodic
from data.errors import BadInput, DidNotConverge


@pytest.mark.parametrize("frequency", [0.01, 0.5, 5.0, 50.0, 500.0])
def test_it_closes_within_8_cycles_at_any_frequency(frequency: float) -> None:
    solver = Solver(tolerance=1e-9)
    orbit = periodic(thesis_circuit(), SquareWave(period=1 / frequency).drive(), solver=solver)
    assert orbit.cycles <= 8
    assert np.abs(orbit.run.volume[-1] - orbit.run.volume[0]).max() < 1e-8
    tighter = periodic(thesis_circuit(), SquareWave(period=1 / frequency).drive(), solver=Solver(tolerance=1e-12))
    assert orbit.run.volume[0] == pytest.approx(tighter.run.volume[0], abs=2e-8)


def test_waiting_leads_there_too() -> None:
    orbit = periodic(thesis_circuit(), SquareWave(period=0.2).drive(), solver=Solver(tolerance=1e-9))
    waited = simulate(thesis_circuit(), SquareWave(period=0.2).drive(60), solver=Solver(tolerance=1e-9))
    assert waited.volume[-1] == pytest.approx(orbit.run.volume[0], abs=1e-7)


def test_the_derivative_is_that_of_the_cycle() -> None:
    circuit, drive, solver = thesis_circuit(), SquareWave(period=0.05).drive(), Solver(tolerance=1e-12)
    orbit = periodic(circuit, drive, solver=solver)
    start = orbit.run.volume[0]
    for k in range(3):
        h = 1e-5 * np.eye(3)[k]
        ends = [simulate(circuit, drive, start + s * h, solver).volume[-1] for s in (1, -1)]
        # integration noise 1e-12 over 2e-5, and the difference's own 1e-10
        assert (ends[0] - ends[1]) / 2e-5 == pytest.approx(orbit.derivative[:, k], abs=3e-7)


def test_any_guess_leads_to_the_same_state() -> None:
    found = [
        periodic(thesis_circuit(), SquareWave().drive(), guess=guess).run.volume[0]
        for guess in ([1.0, 1.0, 1.0], [1.3, 1.4, 1.3], [0.5, 3.0, 1.1])
    ]
    assert found[1] == pytest.approx(found[0], abs=1e-5)
    assert found[2] == pytest.approx(found[0], abs=1e-5)


def test_what_does_not_close_is_refused() -> None:
    drive = SquareWave(period=0.02).drive()
    with pytest.raises(DidNotConverge, match=r"after 2 cycles the state is known to .*; lower the solver's tolerance"):
        periodic(thesis_circuit(), drive, closing=Closing(most_cycles=2))
    with pytest.raises(BadInput, match="only 'rodas5p'"):
        periodic(thesis_circuit(), drive, solver=Solver(method="LSODA"))
    with pytest.raises(BadInput, match="no volume holds"):
        periodic(thesis_circuit(), SquareWave(low=-1e5).drive())
    with pytest.raises(BadInput, match="expected 3 volume coefficients"):
        periodic(thesis_circuit(), drive, guess=[1.0])
