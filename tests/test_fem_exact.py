"""Known answers of finite elasticity: independent digits, and errors that fall at the element's order."""

import numpy as np
import pytest

from catheter.lab import fem_cases as cases
from fem import exact

TUBE = exact.ThickTube(inner=4.0, outer=5.0, mu=0.4)


def test_closed_tube_in_closed_form() -> None:
    pressure, bore, axial = TUBE.limit()
    assert (1e3 * pressure, bore / 4, axial) == pytest.approx((66.916985, 1.705253, 1.177903), abs=0.6e-6)
    for bore, kpa, stretch in ((4.5, 29.090944, 1.006493), (5, 47.403003, 1.025282), (8, 63.957219, 1.323419)):
        pressure, axial = TUBE.closed(bore)
        assert (1e3 * pressure, axial) == pytest.approx((kpa, stretch), abs=0.6e-6)
    assert 1e3 * TUBE.pressure(5.0) == pytest.approx(46.819304, abs=0.6e-6)
    assert [1e3 * m for m in exact.torsion(5e-3, 80.0, 4e5)] == pytest.approx([31.415927, -1256.637], rel=1e-6)


@pytest.mark.parametrize(
    ("sizes", "kpa", "nu", "radii"),
    [
        ((4, 5), 46.819304, 0.49, (5.0216375, 5.8541716)),
        ((4, 5), 46.819304, 0.499, (5.0021587, 5.8332691)),
        ((4, 5), 46.819304, 0.4999, (5.0002158, 5.8311836)),
        ((2, 4), 171.291364, 0.49, (3.0158448, 4.6004026)),
        ((2, 4), 171.291364, 0.499, (3.0015762, 4.5843508)),
    ],
)
def test_compressible_tube(sizes, kpa, nu, radii) -> None:
    found = exact.compressible_tube(sizes[0] * 1e-3, sizes[1] * 1e-3, 4e5, nu, 1e3 * kpa)
    assert [1e3 * r for r in found] == pytest.approx(radii, abs=0.6e-7)


def test_thick_tube_q1p0() -> None:
    for layers, off in ((1, 0.0087), (2, 0.0060), (4, 0.0054)):
        assert cases.thick_tube(layers, 32, 1).error == pytest.approx(off, abs=0.6e-4)


def test_thick_tube_converges_at_the_element_s_order() -> None:
    first = [cases.thick_tube(n, 16 * n, 1).error for n in (1, 2, 4)]
    order = np.log2(np.array(first[:-1]) / first[1:])
    assert order == pytest.approx([2, 2], abs=0.15)
    second = [cases.thick_tube(n, 8 * n, 2).error for n in (1, 2)]
    assert np.log2(second[0] / second[1]) > 3.5  # displacements of quadratic elements: 3, of a smooth bore 4
    assert cases.thick_tube(2, 32, 2).error < 3e-5


@pytest.mark.parametrize("nu", [0.49, 0.4999])
def test_thick_tube_does_not_lock(nu: float) -> None:
    assert cases.thick_tube(2, 32, 1, nu).error < 0.0062
    assert cases.thick_tube(2, 32, 2, nu).error < 1e-4


def test_closed_tube_slice() -> None:
    """Near the limit, where dp/da is small: 20 nodes to 2e-4, and Q1P0 at its order on finer meshes."""
    assert cases.closed_tube(1, 32, 2).error < 2e-4  # most of it what nu 0.49999 leaves
    coarse, fine = (cases.closed_tube(n, 16 * n, 1).error for n in (1, 2))
    assert np.log2(coarse / fine) == pytest.approx(2, abs=0.3)


def test_rivlin_torsion() -> None:
    torque, axial = cases.rivlin(16, 2)
    assert torque.error < 2e-4
    assert axial.error < 1e-2
    coarse, fine = (cases.rivlin(n, 1)[0].error for n in (16, 32))
    assert np.log2(coarse / fine) > 1.7


def test_cook_to_the_printed_digits() -> None:
    assert cases.cook(16, 1).value * 1e3 == pytest.approx(6.814448, abs=0.6e-6)
    assert cases.cook(32, 1).value * 1e3 == pytest.approx(6.884228, abs=0.6e-6)


def test_cantilever_to_the_printed_digits() -> None:
    for across, printed in ((1, 4.535191), (2, 3.431125)):
        assert cases.cantilever(across, 1).value * 1e3 == pytest.approx(printed, abs=0.6e-6)
