"""Fibres keep their length, a branch is never left, and what no fibre allows is refused by name."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from catheter.free import Infeasible, PairState, extension, inflate, lock, refusal, stretch, volume_slope
from data.errors import BadInput, CatheterError

DEG = np.pi / 180
GRID = np.arange(-90, 91) * DEG
ALPHA, BETA = (x.ravel() for x in np.meshgrid(GRID, GRID, indexing="ij"))


@pytest.fixture(scope="module")
def whole():
    """Every pair of the 1 degree grid at V = 1.30."""
    return inflate(ALPHA, BETA, 1.3)


def test_published_pairs() -> None:
    spiral, extender = inflate([72 * DEG, 80 * DEG], [-72 * DEG, -80 * DEG], 1.3).axial
    assert (spiral, extender) == (pytest.approx(1.4948131, abs=0.6e-7), pytest.approx(1.3320731, abs=0.6e-7))
    radial = inflate([72 * DEG, 80 * DEG], [-72 * DEG, -80 * DEG], 1.3).radial
    assert radial == pytest.approx([0.9325631, 0.9878878], abs=0.6e-7)  # the oracles have seven decimals


def test_fibres_and_volume_are_kept_over_the_whole_feasible_set(whole) -> None:
    good = whole.feasible
    with np.errstate(divide="ignore", invalid="ignore"):
        for angle in (ALPHA[good], BETA[good]):
            # thesis eq. 3.9 as it stands, its bracket squared: theta = L tan(angle) / r; at 90 deg the
            # share of the twist in it is nothing
            share = np.where(np.abs(angle) > 89.5 * DEG, 1 + whole.twist[good] / np.tan(angle), np.nan)
            share = np.where(np.isnan(share), (np.tan(angle) + whole.twist[good]) / np.tan(angle), share)
            kept = (whole.axial[good] * np.cos(angle)) ** 2 + (whole.radial[good] * np.sin(angle) * share) ** 2
            assert np.abs(kept - 1).max() < 1e-12
    # next to the axis dV/dl1 is 1e4 and more: one bit of l1 is that many bits of V
    assert np.abs(whole.axial * whole.radial**2 - 1.3)[good].max() < 1e-11


def test_counts_of_the_grid(whole) -> None:
    counts = dict(zip(*np.unique(whole.state, return_counts=True), strict=True))
    assert counts[PairState.ONE_FAMILY] == 183
    assert counts[PairState.STRAIGHT_FIBRE] == 360
    # The reference counts 19,360: it solves by Newton in steps of volume, which loses 56 pairs. The next test
    # shows without any solver that they are feasible.
    assert counts[PairState.FEASIBLE] == 19_416
    assert counts[PairState.BEYOND_LOCK] == 181**2 - 183 - 360 - 19_416


def test_walking_along_every_branch_without_a_solver_finds_the_same_pairs(whole) -> None:
    # Equal steps of the angle t at which the fibre nearer to the axis crosses it, l1 = cos(t) / cos(its
    # angle at rest): they resolve the neighbourhood of the axis, where dV/dl1 grows without bound.
    sure = (whole.state == PairState.FEASIBLE) | (whole.state == PairState.BEYOND_LOCK)
    sure &= (ALPHA > 0) & (np.abs(BETA) <= ALPHA)  # the rest is exchange and mirror images, another test
    alpha, beta = ALPHA[sure], BETA[sure]
    flat = np.minimum(np.abs(alpha), np.abs(beta))
    reached, walking = np.ones(alpha.shape), np.ones(alpha.shape, bool)
    slope = 1 + 2 / np.tan(alpha) / np.tan(beta)  # dV/dl1 at rest
    end = np.where(slope > 0, 0.0, np.pi / 2)
    for step in range(1, 1001):
        t = flat + (end - flat) * step / 1000
        axial = np.cos(t) / np.cos(flat)
        with np.errstate(divide="ignore", invalid="ignore"):
            radial = stretch(alpha, beta, np.where(step == 1000, axial * (1 - 1e-15), axial))[0]
        volume = axial * radial**2
        walking &= volume > reached
        reached = np.where(walking, volume, reached)
    # a walk of 1000 steps misses the top of a parabola by less than 1e-5
    clear = np.abs(reached - 1.3) > 1e-5
    assert ((reached > 1.3) == (whole.state[sure] == PairState.FEASIBLE))[clear].all()
    assert clear.sum() > 7000


def test_an_integrated_branch_ends_where_ours_does(whole) -> None:
    def slope(_: float, l1: np.ndarray, a: float, b: float) -> np.ndarray:  # 1 / (dV/dl1) by the quotient rule
        qa, qb = np.sqrt(1 - (l1 * np.cos(a)) ** 2), np.sqrt(1 - (l1 * np.cos(b)) ** 2)
        l2 = (np.sign(a) * qa * np.cos(b) - np.sign(b) * qb * np.cos(a)) / np.sin(a - b)
        dl2 = -np.sign(a) * np.cos(b) * l1 * np.cos(a) ** 2 / qa + np.sign(b) * np.cos(a) * l1 * np.cos(b) ** 2 / qb
        return 1 / (l2**2 + 2 * l1 * l2 * dl2 / np.sin(a - b))

    room = lock(ALPHA, BETA).volume_ratio
    sample = np.random.default_rng(3).choice(np.flatnonzero(whole.feasible & (room > 1.31)), 60, replace=False)
    for i in sample:
        branch = solve_ivp(slope, (1, 1.3), [1.0], args=(ALPHA[i], BETA[i]), rtol=1e-10, atol=1e-12, method="DOP853")
        assert branch.y[0, -1] == pytest.approx(whole.axial[i], abs=1e-8)  # the integrator's own error


def test_volume_is_monotone_from_rest_to_the_lock_for_every_pair() -> None:
    ends = lock(ALPHA, BETA)
    some = np.isfinite(ends.axial) & (ends.direction != 0)
    share = np.linspace(0, 1, 60)[:, None]
    axial = 1 + (ends.axial[some] - 1) * share
    volume = axial * stretch(ALPHA[some], BETA[some], axial)[0] ** 2
    assert (np.diff(volume, axis=0) > 0).all()
    turns = some & ends.turns
    for past in (1 + 1e-3, 1 - 1e-3):  # and there it turns
        beyond = ends.axial[turns] * past
        with np.errstate(invalid="ignore"):
            after = beyond * stretch(ALPHA[turns], BETA[turns], beyond)[0] ** 2
        assert not (after > ends.volume_ratio[turns]).any()
    slope = volume_slope(ALPHA[turns], BETA[turns], ends.axial[turns])
    assert np.abs(slope).max() < 1e-9


@pytest.mark.parametrize("degrees", [71, 72, 80, 89, 90, 54.8, 54.6, 37, 20, 1])
def test_mckibben_in_closed_form(degrees: float) -> None:
    alpha = degrees * DEG
    c, s = np.cos(alpha), np.sin(alpha)
    if degrees == 90:
        assert extension(alpha, [0.5, 1.7]) == pytest.approx([0.5, 1.7], rel=1e-15)
        return
    ends = lock(alpha, -alpha)
    assert ends.axial.item() == pytest.approx(1 / (np.sqrt(3) * c), rel=1e-14)
    assert ends.volume_ratio.item() == pytest.approx(2 / (3 * np.sqrt(3) * c * s**2), rel=1e-13)
    volume = np.linspace(0.3, min(3.0, ends.volume_ratio.item() * (1 - 1e-6)), 50)
    pair = inflate(alpha, -alpha, volume)
    assert np.abs(pair.twist).max() < 1e-13
    assert pair.axial == pytest.approx(extension(alpha, volume), rel=1e-10)  # next to the lock, sqrt(1e-16 / 1e-6)
    assert pair.axial * (1 - (pair.axial * c) ** 2) / s**2 == pytest.approx(volume, rel=1e-11)
    assert (np.diff(pair.axial) > 0).all() == (degrees > 54.7356)  # steeper ones extend as they fill


def test_known_locks_and_extensions() -> None:
    most = lock([72 * DEG, 80 * DEG], [-72 * DEG, -80 * DEG]).volume_ratio
    assert most == pytest.approx([1.3771, 2.2855], abs=0.6e-4)
    found = extension(80 * DEG, [1.05, 1.13, 1.30, 1.4169])
    assert found == pytest.approx([1.0536, 1.1407, 1.3321, 1.4698], abs=2e-4)  # the last V has four decimals only


def test_exchange_and_mirror(whole) -> None:
    shape = (181, 181)
    for name, mirrored in (("axial", 1), ("radial", 1), ("twist", -1)):
        field = getattr(whole, name).reshape(shape)
        # 1e-9: adjacent angles lose two digits, a root next to the axis some more
        assert np.allclose(field, field.T, rtol=0, atol=1e-9, equal_nan=True)
        assert np.allclose(field, mirrored * field[::-1, ::-1], rtol=0, atol=1e-9, equal_nan=True)


def test_slope_is_the_derivative_of_ln_v() -> None:
    draw = np.random.default_rng(5)
    alpha, beta = draw.uniform(15, 89, (2, 200)) * DEG * draw.choice([-1, 1], (2, 200))
    axial, h = np.full(200, 1.01), 1e-6
    high, low = (np.log((axial + e) * stretch(alpha, beta, axial + e)[0] ** 2) for e in (h, -h))
    assert volume_slope(alpha, beta, axial) == pytest.approx((high - low) / (2 * h), rel=1e-6, abs=1e-6)


def test_rest_is_rest_and_filling_is_continuous() -> None:
    volume = np.linspace(0.9, 1.3, 400)
    pair = inflate(72 * DEG, -70 * DEG, volume)
    assert pair.feasible.all()
    assert (np.diff(pair.axial) > 0).all()
    assert np.diff(pair.axial).max() < 0.02
    rest = inflate([72 * DEG, 30 * DEG, 30 * DEG], [-72 * DEG, 60 * DEG, -30 * DEG], 1.0)
    assert (rest.axial, rest.radial) == (pytest.approx([1] * 3, abs=1e-15), pytest.approx([1] * 3, abs=1e-14))


def test_the_lock_itself_is_reached_and_not_passed() -> None:
    most = float(lock(72 * DEG, -72 * DEG).volume_ratio.item())
    assert inflate(72 * DEG, -72 * DEG, most).axial == pytest.approx(1 / (np.sqrt(3) * np.cos(72 * DEG)), abs=3e-8)
    assert inflate(72 * DEG, -72 * DEG, most * (1 + 1e-12)).state == PairState.BEYOND_LOCK


@pytest.mark.parametrize(
    ("alpha", "beta", "volume", "said"),
    [
        (72, 72, 1.3, "one family, .* leave the twist undetermined; choose two different"),
        (90, -90, 1.3, "one family"),
        (0, 60, 1.3, "a fibre along the axis can turn either way"),
        (72, -72, 1.38, r"beyond the lock at l1 = 1\.86834; they allow V from 0 to 1\.37706"),
        (54.735610317245346, -54.735610317245346, 1.1, "beyond the lock at l1 = 1;"),
        (20, -70, 0.1, r"a fibre lies along the axis before that; they allow V from 0\.815"),
    ],
)
def test_what_fibres_do_not_allow_is_said_with_numbers(alpha, beta, volume, said) -> None:
    import re

    assert re.search(said, refusal(alpha * DEG, beta * DEG, volume))
    assert np.isnan(inflate(alpha * DEG, beta * DEG, volume).axial)


def test_bad_numbers_are_refused() -> None:
    for volume in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(BadInput, match="volume ratio"):
            inflate(72 * DEG, -72 * DEG, volume)
        with pytest.raises(BadInput, match="volume ratio"):
            extension(80 * DEG, volume)
    for angle in (91 * DEG, np.nan):
        with pytest.raises(BadInput, match="angles lie within"):
            inflate(angle, -72 * DEG, 1.3)
    for angle in (0.0, np.arctan(np.sqrt(2)), 72 * DEG):
        with pytest.raises(Infeasible, match="they lock at"):
            extension(angle, [1.0, 1.4])
    assert issubclass(Infeasible, CatheterError)
