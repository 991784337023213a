"""The circuit against exact solutions, an independent solver, its own books, and what cannot be."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from catheter import circuit_kernel as kernel
from catheter.hydraulics import (
    Accumulator,
    Circuit,
    ConicalValve,
    Drive,
    Orifice,
    Segment,
    Solver,
    SquareWave,
    recorded,
    sampled,
    simulate,
    thesis_circuit,
)
from catheter.lab.scene import Scene
from data.errors import BadInput, CatheterError, DidNotConverge
from data.signal import Signal

REFERENCE = np.loadtxt(Path(__file__).parent / "reference" / "hydraulics_waveform.csv", delimiter=",", skiprows=1)
V, C1 = 2e-5, 1e5


def one(coefficient: float, transition: float) -> Circuit:
    spring = Accumulator(rest_volume=V, coefficients=(C1,))
    return Circuit(
        segments=(Segment(accumulator=spring, valve=Orifice(coefficient=coefficient, transition=transition)),)
    )


def constant(pressure_pa: float, end_s: float) -> Drive:
    return Drive(np.array([0.0, end_s]), np.array([[pressure_pa, 0.0, 0.0, 0.0]]))


def test_laminar_filling_is_the_exponential() -> None:
    # drops of at most 1 Pa under a transition of 1e7 Pa: Q = K dp / sqrt(d) to 2e-15
    rate = 1e-3 * C1 / (math.sqrt(1e7) * V)
    run = simulate(one(1e-3, 1e7), constant(1.0, 5 / rate), [1.0], Solver(tolerance=1e-13))
    times = np.linspace(0, 5 / rate, 101)
    assert run.at(times)[:, 0] - 1 == pytest.approx(1 / C1 * -np.expm1(-rate * times), abs=1e-12)


@pytest.mark.parametrize("shape", ["sampled", "recorded"])
def test_laminar_answer_to_a_moving_source(shape: str) -> None:
    rate = 1e-3 * C1 / (math.sqrt(1e7) * V)
    omega = 3 * rate
    times = np.linspace(0, 4 / rate, 41)
    if shape == "sampled":
        drive = sampled(lambda t: math.sin(omega * t), times[-1], tolerance_pa=1e-9)
        phase = math.atan2(omega, rate)
        gain = rate / math.hypot(rate, omega)
        exact = gain * (np.sin(omega * times - phase) + math.sin(phase) * np.exp(-rate * times))
    else:
        drive = recorded(Signal(times, times / times[-1], "Pa"))  # a ramp in 40 pieces
        exact = (times - -np.expm1(-rate * times) / rate) / times[-1]
    run = simulate(one(1e-3, 1e7), drive, [1.0], Solver(tolerance=1e-13))
    assert (run.at(times)[:, 0] - 1) * C1 == pytest.approx(exact, abs=3e-8)  # of drops of 1 Pa: 3e-13 in V


def test_turbulent_filling_is_the_parabola() -> None:
    # sqrt(dp) falls linearly; a transition of 1e-3 Pa changes Q by (d/dp)^2/4 < 1e-9 while dp > 20 Pa
    k, u = 1e-6, 5e4
    run = simulate(one(k, 1e-3), constant(u, 0.08), [1.0], Solver(tolerance=1e-11))
    times = np.linspace(0, 0.08, 50)
    drop = (math.sqrt(u) - k * C1 / (2 * V) * times) ** 2
    assert drop.min() > 20
    assert run.at(times)[:, 0] == pytest.approx(1 + (u - drop) / C1, abs=1e-9)


@pytest.mark.parametrize("rise_pa_s", [0.0, 2e5])
def test_the_order_is_five(rise_pa_s: float) -> None:
    def end(pieces: int, tolerance: float) -> np.ndarray:
        breaks = np.linspace(0, 0.2, pieces + 1)
        shape = np.stack([4e4 + rise_pa_s * breaks[:-1], np.full(pieces, rise_pa_s), *np.zeros((2, pieces))], axis=1)
        return simulate(thesis_circuit(1e4), Drive(breaks, shape), [1.2] * 3, Solver(tolerance=tolerance)).volume[-1]

    # so loose a tolerance takes each piece in one step
    coarse, fine = (np.abs(end(pieces, 1e-2) - end(1, 1e-13)).max() for pieces in (80, 160))
    assert 4.6 < np.log2(coarse / fine) < 5.7


def test_the_reference_waveform_is_met() -> None:
    run = simulate(thesis_circuit(0.01), SquareWave().drive(), REFERENCE[0, 2:], Solver(tolerance=1e-8))
    assert run.at(REFERENCE[:, 0]) == pytest.approx(REFERENCE[:, 2:], abs=1e-7)  # it carries 2e-9


@pytest.mark.parametrize("method", ["Radau", "BDF", "LSODA"])
def test_scipy_agrees_on_our_right_hand_side(method: str) -> None:
    drive, start, times = SquareWave().drive(), REFERENCE[0, 2:], np.linspace(0, 2, 201)
    ours = simulate(thesis_circuit(), drive, start, Solver(tolerance=1e-9)).at(times)
    theirs = simulate(thesis_circuit(), drive, start, Solver(tolerance=1e-9, method=method)).at(times)
    assert theirs == pytest.approx(ours, abs=2e-7)  # BDF's global error


def test_an_independent_circuit_and_solver_agree() -> None:
    c = 1e5 * np.array([[1.60, 5.92, -11.14, 7.18], [0.44, 6.64, -8.79, 4.28], [-0.28, 10.61, -12.39, 5.06]])
    k, volume = [1.64e-6, 3.05e-7, 4.30e-8], math.pi * 0.005**2 * 0.3

    def slope(t: float, x: np.ndarray) -> list[float]:
        p = [83e3 if t < 1 else 0.0, *(sum(c[i, j] * x[i] ** (j + 1) for j in range(4)) for i in range(3))]
        q = [k[i] * (p[i] - p[i + 1]) / ((p[i] - p[i + 1]) ** 2 + 1.0) ** 0.25 for i in range(3)] + [0.0]
        return [(q[i] - q[i + 1]) / volume for i in range(3)]

    start, times = REFERENCE[0, 2:], np.linspace(0, 0.999, 100)
    found = solve_ivp(slope, (0, 0.999), start - 1, "Radau", times, rtol=1e-10, atol=1e-12)
    run = simulate(thesis_circuit(1.0), SquareWave().drive(), start, Solver(tolerance=1e-11))
    assert run.at(times) == pytest.approx(1 + found.y.T, abs=1e-8)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8, 1e-10])
def test_what_flows_in_is_what_is_stored(tolerance: float) -> None:
    run = simulate(thesis_circuit(0.01), SquareWave().drive(2), solver=Solver(tolerance=tolerance))
    assert run.accounting_error() < 10 * tolerance


def test_volumes_at_rest() -> None:
    circuit = thesis_circuit()
    assert circuit.volume(83e3) == pytest.approx([1.3205296, 1.4169465, 1.3739434], abs=1e-7)
    assert circuit.volume() == pytest.approx([1, 1, 1.02725], abs=3e-6)
    for segment, v in zip(circuit.segments, circuit.volume(-500.0), strict=True):
        assert segment.accumulator.pressure_pa(v) == pytest.approx(-500.0, abs=1e-6)


def test_derivatives_of_the_laws() -> None:
    cone = ConicalValve(coefficient=1e-6, forward=2e4, reverse=5e4, opening=300.0)
    table = Circuit(segments=(thesis_circuit().segments[2], replace(thesis_circuit().segments[1], valve=cone))).table()
    for drop, q in ((2.09e4, 3e-5), (1e4, 0.0), (-4.9e4, 0.0), (-5.16e4, -4e-5)):  # K sqrt(excess), opening 300 Pa
        assert kernel.flow(table, 1, drop)[0] == pytest.approx(q, rel=0.1)
        assert kernel.plain_flow(table, 1, drop) == pytest.approx(kernel.flow(table, 1, drop)[0], rel=1e-14)
    for k, points in ((0, (-900.0, -0.3, 0.0, 2.0, 5e4)), (1, (-6e4, -5.01e4, -1e4, 2.02e4, 9e4))):
        for p in points:
            h = 1e-3
            low, middle, high = (np.array(kernel.flow(table, k, p + s)) for s in (-h, 0.0, h))
            assert (high - low)[:2] / (2 * h) == pytest.approx(middle[1:], rel=1e-5, abs=1e-15)
        for x in (-0.2, 0.01, 0.2, 0.4):
            low, middle, high = (np.array(kernel.pressure(table, k, x + s)) for s in (-1e-6, 0, 1e-6))
            assert (high - low)[:2] / 2e-6 == pytest.approx(middle[1:], rel=1e-6, abs=1e-3)


def test_a_conical_valve_holds_between_its_cracking_pressures() -> None:
    spring = Accumulator(rest_volume=V, coefficients=(C1,))
    cone = ConicalValve(coefficient=1e-6, forward=2e4, reverse=5e4, opening=1.0)
    circuit = Circuit(segments=(Segment(accumulator=spring, valve=cone),))
    held = simulate(circuit, SquareWave(high=6e4, period=200.0).drive(), solver=Solver(tolerance=1e-9))
    pressure = held.pressure_pa([100.0, 200.0])[:, 0]
    assert pressure == pytest.approx([4e4, 4e4], abs=2.0)  # 60 - 20 kPa; 40 kPa do not crack 50 kPa backwards
    again = simulate(circuit, SquareWave(high=9e4, period=200.0).drive())
    assert again.pressure_pa(200.0)[0, 0] == pytest.approx(5e4, abs=2.0)


def scaled(volume: float = 1.0, ratio: float = 0.0) -> Circuit:
    circuit = thesis_circuit()
    if ratio:
        circuit = circuit.with_coefficients(1.64e-6, 1.64e-6 / math.sqrt(ratio), 1.64e-6 / ratio)
    springs = [replace(s.accumulator, rest_volume=s.accumulator.rest_volume * volume) for s in circuit.segments]
    return Circuit(segments=tuple(replace(s, accumulator=a) for s, a in zip(circuit.segments, springs, strict=True)))


EXTREMES = {
    "K1/K3 = 1e6": (scaled(ratio=1e6), SquareWave()),
    "K1/K3 = 1e9": (scaled(ratio=1e9), SquareWave()),
    "volumes x 1e-3": (scaled(1e-3), SquareWave()),
    "volumes x 1e-6": (scaled(1e-6), SquareWave()),
    "0.01 Hz": (thesis_circuit(), SquareWave(period=100.0)),
    "500 Hz": (thesis_circuit(), SquareWave(period=2e-3)),
    "10 MPa": (thesis_circuit(), SquareWave(high=1e7)),
    "valve 2 closed": (thesis_circuit().with_coefficients(1.64e-6, 0.0, 4.3e-8), SquareWave()),
    "equal pressures": (thesis_circuit(), SquareWave(high=0.0)),
}


@pytest.mark.parametrize("name", EXTREMES)
def test_extremes_are_solved_to_their_tolerance(name: str) -> None:
    circuit, source = EXTREMES[name]
    coarse, fine = (simulate(circuit, source.drive(), [1.0, 1.0, 1.0], Solver(tolerance=t)) for t in (1e-6, 1e-9))
    times = np.unique(np.concatenate([coarse.time_s, coarse.time_s[:-1] + np.diff(coarse.time_s) / 3]))
    assert (np.abs(coarse.at(times) - fine.at(times)) / np.maximum(1.0, fine.at(times))).max() < 1e-6
    assert coarse.accounting_error() < 1e-5


def test_negative_sources_are_solved_or_refused() -> None:
    run = simulate(thesis_circuit(), constant(-3e3, 5.0))  # Act 2 would run away below -0.7 kPa by its polynomial
    assert run.pressure_pa(5.0)[0, :2] == pytest.approx([-3e3, -3e3], abs=2.0)
    with pytest.raises(DidNotConverge, match=r"at 0\.\d+ s.*accumulator 2 was emptied; keep the source"):
        simulate(thesis_circuit(), constant(-5e4, 5.0))


def test_too_many_steps_are_refused_with_numbers() -> None:
    with pytest.raises(DidNotConverge, match=r"at 0\.\d+ s, tolerance 1e-06: 20 steps were not enough; raise"):
        simulate(thesis_circuit(), SquareWave().drive(), solver=Solver(most_steps=20))


SPRING = Accumulator(rest_volume=V, coefficients=(C1,))


@pytest.mark.parametrize(
    ("make", "found"),
    [
        (lambda: Accumulator(rest_volume=0.0, coefficients=(C1,)), "rest_volume: is 0"),
        (lambda: Accumulator(rest_volume=V, coefficients=(C1, math.nan)), "expected finite"),
        (lambda: Accumulator(rest_volume=V, coefficients=(1.0, 0.0, -1.0)), r"falls or is flat at x = 0.5774"),
        (lambda: Accumulator(rest_volume=V, coefficients=(-1.0,)), "no rest state"),
        (lambda: SPRING.volume(-2e5), "no volume holds -200000 Pa"),
        (lambda: Orifice(coefficient=1e-6, transition=0.0), "transition: is 0"),
        (lambda: Orifice(coefficient=math.inf), "coefficient: is inf"),
        (lambda: Circuit(segments=()), "segments: are 0"),
        (lambda: SquareWave(period=0.0), "period: is 0"),
        (lambda: SquareWave(high=math.nan), "high: is nan"),
        (lambda: Drive(np.array([0.0, 0.0]), np.zeros((1, 4))), "do not increase"),
        (lambda: recorded(Signal(np.arange(3.0), np.array([0, np.nan, 1]), "Pa")), "missing samples"),
        (lambda: recorded(Signal(np.arange(3.0), np.zeros(3), "V")), "is in V"),
        (lambda: sampled(lambda t: float(t > 0.3), 1.0), r"changes by 0\.\d+ Pa near 0.3 s; name its jumps"),
        (lambda: sampled(lambda t: math.nan, 1.0), "is not finite"),
        (lambda: simulate(thesis_circuit(), SquareWave().drive(), [1.0, 1.0]), "expected 3 volume"),
        (lambda: Solver(tolerance=1.0), "tolerance: is 1"),
        (lambda: Solver(method="ode45"), "method: is 'ode45'"),
    ],
)
def test_what_cannot_be_is_refused(make, found: str) -> None:
    with pytest.raises(CatheterError, match=found):
        make()


def test_a_jump_that_is_named_is_exact() -> None:
    named = sampled(lambda t: 83e3 if t < 1.0 else 0.0, 2.0, breaks_s=[1.0])
    ours, theirs = (simulate(thesis_circuit(), d, solver=Solver(tolerance=1e-9)) for d in (named, SquareWave().drive()))
    assert ours.volume[-1] == pytest.approx(theirs.volume[-1], abs=1e-9)


def test_the_scene_is_the_thesis() -> None:
    scene = Scene.load("locomotion")
    assert scene.tables["source"] == SquareWave()
    mine, tables = scene.tables["circuit"], thesis_circuit(0.01)
    assert mine is not None
    assert mine.table() == pytest.approx(tables.table(), rel=1e-12)
    text = scene.text.replace('transition = "0.01 Pa"', 'transitoin = "1 Pa"', 1)
    with pytest.raises(BadInput, match=r"segments\[0\], valve, transitoin: is no such key; did you mean 'transition'"):
        Scene.parse(text, "here")


def test_a_run_reads_as_signals() -> None:
    run = simulate(thesis_circuit(), SquareWave().drive())
    signals = run.signals(np.linspace(0, 2, 11))
    assert signals["/volume/2"].value[0] == pytest.approx(math.pi * 0.005**2 * 0.3, rel=1e-12)
    assert signals["/pressure/source"].value[[0, 10]].tolist() == [83e3, 0.0]
    assert np.isnan(run.at([-1.0, 3.0])).all()
