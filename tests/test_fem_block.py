"""Blocks with chosen faces, and cavities that are not closed: the tangent is not symmetric, and nobody says it is."""

import numpy as np
import pytest

from data.errors import BadInput
from fem import grid, solver, tube_grid
from fem.block import Block
from fem.continuation import follow
from fem.element import make_body
from fem.equilibrium import System
from fem.material import NeoHooke, Yeoh

SOFT = NeoHooke(c1=2e5)


def cube(law=SOFT, **given) -> Block:
    material = np.full((2, 2, 2), law, dtype=object)
    return Block(**{"sizes": (1e-3, 2e-3, 3e-3), "divisions": (2, 2, 2), "material": material} | given)


@pytest.mark.parametrize("face", ["x1", "y1", "z1"])
@pytest.mark.parametrize("law", [SOFT, Yeoh(c1=2e5, c2=2e4, c3=1e3)], ids=["neo", "yeoh"])
def test_a_sliding_block_under_a_pressed_face_is_in_uniaxial_compression(face: str, law) -> None:
    block = cube(law, pressed=(face,), sliding=("x0", "y0", "z0"))
    run = block.press([50e3, 200e3])
    axis = "xyz".index(face[0])
    stretch = 1 + run.face(face)[:, axis] / block.sizes[axis]
    # Cauchy stress l P(l) of the incompressible law is -p; nu 0.499 leaves sigma / E of 1e-3
    assert stretch * law.uniaxial(stretch) == pytest.approx([-50e3, -200e3], rel=3e-3)
    assert run.system.method == solver.GENERAL


def test_soft_voxels_stand_where_they_are_put() -> None:
    block = cube(pressed=("x1",), held=("x0",), order=2)
    block.material[:, 0, 1] = NeoHooke(c1=2e4)
    run = block.press([20e3])
    nodes = run.system.body.mesh.nodes
    moved = -run.displacement[0, :, 0]
    soft = (nodes[:, 0] == 1e-3) & (nodes[:, 1] < 0.9e-3) & (nodes[:, 2] > 1.6e-3)
    stiff = (nodes[:, 0] == 1e-3) & (nodes[:, 1] > 1.1e-3) & (nodes[:, 2] < 1.4e-3)
    assert moved[soft].min() > moved[stiff].max()


def open_tube() -> System:
    cut = tube_grid.tube_lattice(8e-3, 5e-3, 1e-3, (12, 6, 1), 1)
    fixed = np.repeat(cut.nodes[:, 2:] == 0, 3, axis=1)
    mesh = grid.solid(cut.nodes, cut.hexes, fixed, cut.face("w0"))
    return System(make_body(mesh, [SOFT], np.zeros(len(mesh.hexes), dtype=np.int32)))


def test_an_open_rim_is_not_taken_for_symmetric() -> None:
    system = open_tube()
    assert (system.closed, system.method) == (False, solver.GENERAL)
    point = follow(system, [30e3])[0]
    assert point.residuals[-1] < 1e-4 * point.residuals[-2]  # quadratic: the tangent is the whole one
    with pytest.raises(BadInput, match="no closed cavity"):
        follow(system, [1e-6], "volume")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"pressed": ("x2",)}, "'x2' is unknown; known: x0, x1"),
        ({"sizes": (1.0, 0.0, 1.0)}, "lengths > 0"),
        ({"divisions": (3, 2, 2)}, "divisors"),
    ],
)
def test_bad_blocks_are_refused(given, said) -> None:
    with pytest.raises(BadInput, match=said):
        cube(**given)
