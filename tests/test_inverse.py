"""Inverse design: exact sensitivities, maps recovered, noise, bounds, printable choices, constants calibrated."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache
from multiprocessing import get_context

import numpy as np
import pytest

from catheter.calibrate import calibrate, groups, surrogate, twist_curve
from catheter.inflatable import Pattern, Shape
from catheter.inverse_sweep import Job, sweep, varied
from catheter.reconstruction import Case, Cube, Quality, Wanted, cube_case, solved, tube_case
from data.errors import BadInput, DidNotConverge
from fem.gap import bounded_least_squares, gap
from fem.inverse import Inversion, reconstruct
from fem.observation import Pose, nodes, twist
from fem.palette import binned, diffused, dithered, printed, swapped
from fem.regular import Variation, boxed, neighbours
from fem.sensitivity import adjoint, direct
from fem.thesis_inverse import ThesisWeights, thesis_inverse, thesis_seed, two_classes
from fem.uncertainty import determined

SMALL = Shape(length=16e-3, divisions=(8, 8, 1), voxels=(8, 8))
WRAP = Pattern(pattern="helix", period=4, width=1)
SEVEN = (0.20e6, 0.22e6, 0.29e6, 0.41e6, 0.73e6, 1.89e6, 19.8e6)
WANTED = Wanted(pressures=(40e3,))


@cache
def small(**given: object) -> Case:
    return tube_case(SMALL, WRAP, replace(WANTED, **given))  # type: ignore[arg-type]


def test_direct_and_adjoint_sensitivities_are_the_difference_quotients() -> None:
    case = small()
    voxels, standing = case.voxels, case.whole[0]
    change = np.random.default_rng(0).standard_normal(voxels.count)
    rows = case.observations[0].slope(standing.state.x)
    ends = [voxels.moved(standing, standing.log + h * change).state.x.ravel() for h in (1e-4, -1e-4)]
    quotient = rows @ (ends[0] - ends[1]) / 2e-4
    foreseen = direct(voxels, standing, rows) @ change
    assert np.abs(quotient - foreseen).max() <= 1e-6 * np.abs(quotient).max()  # the difference's own error: h^2
    few = rows[::97]
    assert adjoint(voxels, standing, few) == pytest.approx(direct(voxels, standing, few), rel=1e-8, abs=1e-14)


def test_a_pressed_cube_with_free_rims_has_exact_adjoints_too() -> None:
    case = cube_case(Cube(divisions=(2, 2, 2), sizes=(2e-3, 2e-3, 2e-3)), WANTED)
    voxels, standing = case.voxels, case.whole[0]
    assert not voxels.system.symmetric
    rows = case.observations[0].slope(standing.state.x)
    forward = direct(voxels, standing, rows)
    assert adjoint(voxels, standing, rows) == pytest.approx(forward, rel=1e-9, abs=1e-12 * np.abs(forward).max())


@pytest.mark.parametrize("angle_only", [False, True])
def test_a_poses_slope_is_its_difference_quotient(angle_only: bool) -> None:
    case = small()
    mesh, x = case.voxels.mesh, case.whole[0].state.x
    turn = np.array([0.0, 0.0, twist(mesh.nodes[mesh.ring], x[mesh.ring])])
    pose = Pose(
        pressure=1.0, ring=mesh.ring, rest=mesh.nodes, shift=np.zeros(3), turn=turn, arm=5e-3, angle_only=angle_only
    )
    rate = case.voxels.onto(x) @ np.random.default_rng(1).standard_normal(case.voxels.onto(x).shape[1])
    step = 1e-7 * rate.reshape(x.shape)
    quotient = (pose.misfit(x + step) - pose.misfit(x - step)) / 2e-7
    assert quotient == pytest.approx(pose.slope(x) @ rate, rel=1e-5, abs=1e-6 * np.abs(quotient).max())


def test_the_gap_is_exact_for_exact_positions_and_minds_its_bounds() -> None:
    case = small()
    x = case.whole[0].state.x
    assert gap(case.voxels, x, 40e3, 0.05e6, 20e6).moduli == pytest.approx(case.truth, rel=1e-8)
    held = gap(case.voxels, x, 40e3, 0.05e6, 1e6)
    assert held.moduli.max() <= 1e6
    assert held.bounded.any()
    assert held.unbalanced > 1e-3


def test_bounded_least_squares_is_optimal() -> None:
    from scipy.sparse import csc_array

    rng = np.random.default_rng(2)
    matrix, right = rng.standard_normal((40, 12)), 3 * rng.standard_normal(40)
    x, side = bounded_least_squares(csc_array(matrix), right, 0.05, 0.5)
    slope = matrix.T @ (matrix @ x - right)
    inside = (x > 0.05) & (x < 0.5)
    assert np.abs(slope[inside]).max(initial=0) < 1e-10
    assert (slope[x == 0.05] >= -1e-10).all()
    assert (slope[x == 0.5] <= 1e-10).all()
    assert side.any()
    low, high = np.full(12, 0.05), np.full(12, 0.5)
    assert boxed(matrix.T @ matrix, -matrix.T @ right, low, high) == pytest.approx(x, abs=1e-10)


def test_variations_quadratic_touches_it_from_above() -> None:
    variation = Variation(neighbours((8, 8), (True, False)), 0.01)
    assert variation.pairs.shape == (64 + 56, 64)  # around a tube 8 pairs a ring, along it 7 a row
    rng = np.random.default_rng(3)
    here, there = rng.standard_normal(64), rng.standard_normal(64)
    bent = variation.curvature(here)
    above = variation.value(here) + (there @ bent @ there - here @ bent @ here) / 2
    assert variation.value(there) <= above
    close = here + 1e-6 * there
    assert (variation.value(close) - variation.value(here)) / 1e-6 == pytest.approx(here @ bent @ there, rel=1e-3)


@pytest.mark.parametrize("seed", ["uniform", "random"])
def test_exact_positions_give_every_modulus(seed: str) -> None:
    case = small(seed=seed, number=3)
    found = solved(case, Inversion())
    assert found.why == "explained"
    assert found.moduli == pytest.approx(case.truth, rel=1e-6)
    assert found.weight < 1e-18  # what is left of the regularisation where nothing is left to explain
    assert found.history[-1].misfit < 1e-3 * found.history[-2].misfit  # quadratic convergence at the end


def test_a_seed_too_soft_for_the_pressure_is_survived() -> None:
    case = small()
    found = reconstruct(case.voxels, case.observations, np.full(64, 0.05e6), case.variation)
    assert found.strengthened >= 1
    assert found.moduli == pytest.approx(case.truth, rel=1e-6)


def test_the_outside_alone_with_noise_still_tells_stiff_from_soft() -> None:
    for number in range(3):
        case = small(seen="outer", noise=0.01, number=number)
        found = solved(case, Inversion())
        quality = Quality.of(found.moduli, case.truth)
        assert quality.right >= 0.98
        assert quality.median < 0.1
        assert 0.6 < found.misfit < 1.1  # in noises: neither unexplained nor explained away


def test_outliers_of_5_mm_do_little() -> None:
    case = small(seen="outer", noise=0.01, outliers=2)
    robust = Quality.of(solved(case, Inversion()).moduli, case.truth)
    plain = Quality.of(solved(case, Inversion(robust=0.0, most_iterations=25)).moduli, case.truth)
    assert robust.median < 0.1
    assert plain.median > 2 * robust.median


def test_a_target_twice_too_large_ends_and_says_what_binds() -> None:
    case = small(stretched=2.0)
    found = solved(case, Inversion(least=0.15e6, most_iterations=40))
    assert found.why != "explained"
    assert (found.bounded < 0).any()
    assert 1e-3 < found.misfit < 1.0


def test_a_twist_is_found_although_one_modulus_everywhere_has_no_slope_towards_it() -> None:
    case = small(seen="twist")
    level = np.log(np.full(case.voxels.count, 1e6))
    flat = [case.voxels.inflate(level, 40e3)]
    slope, bent = case.problem.slope(flat), case.problem.slope(case.whole)
    assert np.abs(slope).max() < 1e-6 * np.abs(bent).max()  # by symmetry
    found = solved(case, Inversion())
    assert found.why.startswith("explained")
    assert "symmetry" in found.why


def test_a_pure_torsion_ends_and_says_how_near_it_came() -> None:
    case = small(turned=-0.2)
    found = solved(case, Inversion())
    assert not found.why.startswith("explained")
    twists = [Pose.misfit(_angle(case), one.state.x)[0] for one in (found.standings[0], case.whole[0])]
    assert np.ptp(np.log(found.moduli)) > 1.0  # not stuck at one modulus
    assert abs(twists[0]) < abs(twists[1])


def _angle(case: Case) -> Pose:
    mesh = case.voxels.mesh
    turn = np.array([0.0, 0.0, -0.2])
    return Pose(pressure=1.0, ring=mesh.ring, rest=mesh.nodes, shift=np.zeros(3), turn=turn, arm=1.0, angle_only=True)


def test_what_data_do_not_see_is_said_to_be_undetermined() -> None:
    whole, tip = small(noise=0.01), small(noise=0.01, seen="tip")
    known = [determined(c.problem, solved(c, Inversion()), c.variation, Inversion()) for c in (whole, tip)]
    assert known[0].seen.mean() > 0.5 > known[1].seen.mean()
    assert np.median(known[1].sd) > 3 * np.median(known[0].sd)
    assert (known[1].singular > 1e-9 * known[1].singular[0]).sum() <= 6  # six numbers say six things


def test_binning_and_dithering() -> None:
    assert binned(np.array([0.2e6, 0.34e6, 0.36e6, 1.3e6, 1.32e6]), SEVEN).tolist() == [0, 2, 3, 4, 5]
    assert binned(np.array([1.17e6, 1.18e6]), SEVEN, log=True).tolist() == [4, 5]
    grey = np.full((32, 32), 0.45)
    chosen = dithered(grey, (1e-9, 1.0))
    assert chosen.mean() == pytest.approx(0.45, abs=0.02)  # the mean is kept
    assert np.abs(chosen.mean(axis=0) - 0.45).max() < 0.1  # in every ring: nothing is lost at the seam


def test_choice_by_mechanics_errs_less_than_binning() -> None:
    case = tube_case(SMALL, Pattern(pattern="graded", period=8), WANTED)
    problem, start = case.problem, case.whole
    nearest = printed(problem, binned(case.truth, SEVEN), SEVEN, start)
    better = swapped(problem, diffused(problem, start, SEVEN, parts=4), SEVEN)
    assert better.misfit <= 0.6 * nearest.misfit  # 64 voxels leave little to choose; 1,024 give 0.35
    again = printed(problem, better.chosen, SEVEN, None)  # solved anew from rest
    assert again.misfit == pytest.approx(better.misfit, rel=1e-6)
    plain, even = (swapped(problem, nearest, SEVEN, power=power) for power in (2.0, 6.0))
    left = [float((problem.misfit(one.standings) ** 6).mean()) for one in (even, plain)]
    assert left[0] < 0.95 * left[1]  # each is the best by its own mean
    assert plain.misfit < even.misfit
    assert even.largest < plain.largest


def test_the_thesis_method_descends_and_its_classes_are_two() -> None:
    case = tube_case(SMALL, Pattern(), WANTED)
    seen, pairs = case.observations[0], case.variation
    seed = thesis_seed(case.voxels, seen, (0.05e6, 20e6))  # type: ignore[arg-type]
    weights = ThesisWeights(displacement=1, strain=0, similarity=0, most=12)
    steps = thesis_inverse(case.voxels, seen, seed, pairs, (0.05e6, 20e6), weights)  # type: ignore[arg-type]
    assert steps[-1].misfit < 0.2 * steps[0].misfit
    assert np.unique(two_classes(np.array([1.0, 1.2, 5.0, 6.0]))).tolist() == [1.1, 5.5]


def test_constants_from_a_twist_curve_fall_into_their_intervals() -> None:
    case = small()
    few = groups(case.voxels, (case.truth > 0.6e6).astype(int))
    full = twist_curve(few, np.linspace(0, 45e3, 6)[1:])
    truth, table = np.array([0.21e6, 1.80e6]), np.array([0.20e6, 1.89e6])
    model = surrogate(full, np.log(table), 0.6, 4)
    at = np.linspace(0.5e3, 40e3, 800)
    exact = full(np.log(truth)).at(at)[0]
    assert model(np.log(truth)).angle == pytest.approx(full(np.log(truth)).angle, abs=1e-5)
    rng, hits = np.random.default_rng(4), np.zeros(2)
    for _ in range(200):
        angle = exact + np.radians(0.05) * rng.standard_normal(800)
        pressure = at * (1 + 0.01 * rng.standard_normal(800))
        one = calibrate(model, pressure, angle, angle_sd=np.radians(0.05), pressure_share=0.01, seed=table)
        hits += (one.interval[:, 0] <= truth) & (truth <= one.interval[:, 1])
    assert hits.min() >= 182
    assert hits.max() <= 198  # the 99 % band of 200 draws at 95 %


def test_a_sweep_gives_in_other_processes_what_it_gives_here() -> None:
    job = Job(body=SMALL, pattern=WRAP, wanted=WANTED, inversion=Inversion(most_iterations=2))
    jobs = varied(job, ["seen=outer", "noise=0.01", "number=0:2"])
    jobs.append(replace(job, wanted=replace(WANTED, seed="gap", outliers=1)))
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        there = list(sweep(jobs, pool))
    here = list(sweep(jobs))
    for one, other in zip(here[:2], there, strict=False):
        assert one.quality == other.quality
        assert one.iterations == other.iterations == 2
    assert [run.wanted.number for run in there] == [0, 1, 0]
    assert here[0].quality.largest != here[1].quality.largest  # another noise
    assert here[2].failed == there[2].failed != ""
    with pytest.raises(BadInput, match="did you mean 'number'"):
        varied(job, ["numbr=0:2"])
    with pytest.raises(BadInput, match="whole numbers"):
        varied(job, ["number=0:x"])
    with pytest.raises(BadInput, match="is -1"):
        varied(job, ["noise=-1"])


def test_what_cannot_be_is_refused_with_numbers() -> None:
    case = small()
    with pytest.raises(BadInput, match="least"):
        Inversion(least=2.0, most=1.0)
    with pytest.raises(BadInput, match="none"):
        reconstruct(case.voxels, [], case.truth, case.variation)
    x, every = case.whole[0].state.x, np.arange(3)
    mixed = [nodes(case.voxels.mesh, every, x, 40e3), nodes(case.voxels.mesh, every, x, 40e3, sd=1e-5)]
    with pytest.raises(BadInput, match="exact"):
        reconstruct(case.voxels, mixed, case.truth, case.variation)
    with pytest.raises(DidNotConverge):  # no map this soft bears 40 kPa
        reconstruct(case.voxels, case.observations, case.truth, case.variation, Inversion(least=1e3, most=2e3))
    with pytest.raises(BadInput, match="inside out"):
        gap(case.voxels, -case.voxels.mesh.nodes, 40e3, 0.05e6, 20e6)
