"""Elements and materials: tangents are derivatives, rigid motions cost nothing, linear fields are exact."""

import numpy as np
import pytest
from scipy.sparse import bsr_array

from data.errors import BadInput
from fem import grid, tube_grid
from fem.continuation import follow
from fem.element import make_body
from fem.equilibrium import System
from fem.material import Hooke, Law, MooneyRivlin, NeoHooke, Ogden, Yeoh, printable, scaled
from fem.rigid import rotation

LAWS: list[Law] = [
    NeoHooke(c1=2e5),
    MooneyRivlin(c1=1e5, c2=5e4),
    Yeoh(c1=1e5, c2=1e4, c3=1e3),
    Ogden(mu=(1e5, 2e4, -3e3), alpha=(1.3, 5.0, -2.0)),
    Hooke(young=6e5),
]


def small_tube(order: int, cap: float = 2e-3) -> grid.Mesh:
    return tube_grid.tube(0.032, 5e-3, 1e-3, (8, 3, 2), voxels=(8, 3), cap=cap, order=order)


def body_of(mesh: grid.Mesh, law: Law):
    return make_body(mesh, [law], np.zeros(len(mesh.hexes), dtype=np.int32))


def matrix(body, blocks):
    return bsr_array((blocks, body.pattern.column, body.pattern.start)).tocsr()


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_forces_and_tangent_are_derivatives(law: Law, order: int) -> None:
    mesh = small_tube(order)
    body, draw, h = body_of(mesh, law), np.random.default_rng(4), 1e-4
    x = mesh.nodes * [1.1, 1.05, 0.9] + draw.normal(size=mesh.nodes.shape) * 5e-5
    step = draw.normal(size=x.shape) * 1e-4
    state = body.forces(x, body.linearised(x, 0 * x))
    after, before = body.forces(x + h * step), body.forces(x - h * step)
    work = (state.force * step).sum()
    assert (after.energy - before.energy) / (2 * h) == pytest.approx(work, rel=1e-7)
    slope = ((after.force - before.force) / (2 * h)).ravel()
    K = matrix(body, state.stiffness)
    assert np.abs(K @ step.ravel() - slope).max() < 1e-7 * np.abs(slope).max()
    assert abs(K - K.T).max() < 1e-13 * abs(K).max()  # rounding


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_held_stresses_are_first_order_in_the_step(law: Law) -> None:
    mesh = small_tube(1)
    body, draw = body_of(mesh, law), np.random.default_rng(5)
    x = mesh.nodes * [1.1, 1.05, 0.95]
    step = draw.normal(size=x.shape) * 1e-5

    def off(scale: float) -> np.ndarray:
        there = x + scale * step
        left_out = np.abs(body.linearised(x, scale * step) - body.linearised(there, 0 * x))
        return np.array([left_out[..., :6].max(), left_out[..., 6].max()])

    assert off(1.0) / off(0.1) == pytest.approx([100, 100], rel=0.1)  # second order is what is left out


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_a_rigid_motion_makes_no_force(law: Law, order: int) -> None:
    mesh = small_tube(order)
    body = body_of(mesh, law)
    state = body.forces(mesh.nodes @ rotation(np.array([0.3, -2.0, 0.7])).T + [0.1, 0.2, -0.3])
    # rounding: positions of 0.3 m to 1e-16 over elements of 1 mm, times kappa
    assert np.abs(state.force).max() < 1e-13 * 0.3 / 1e-3 * law.kappa * 1e-6 * 100
    assert state.energy < 1e-15


@pytest.mark.parametrize("order", [1, 2])
def test_patch(order: int) -> None:
    """Whatever the inner nodes' places, affine motion of the border is affine inside."""
    block = grid.block((1.0, 1.0, 1.0), (3, 3, 3), order=order)
    border = ((block.nodes < 1e-9) | (block.nodes > 1 - 1e-9)).any(axis=1)
    nodes = block.nodes.copy()
    if order == 1:
        nodes[~border] += np.random.default_rng(6).uniform(-0.08, 0.08, (int((~border).sum()), 3))
    motion = np.array([[1.2, 0.1, 0.0], [0.05, 0.9, 0.2], [0.0, -0.1, 0.95]])
    mesh = grid.solid(nodes, block.hexes, np.repeat(border[:, None], 3, axis=1))
    system = System(
        body_of(mesh, NeoHooke(c1=2e5)), place=lambda load: nodes @ (np.eye(3) + load * (motion - np.eye(3))).T
    )
    found = follow(system, [1.0])[0]
    assert np.abs(found.x - nodes @ motion.T).max() < 1e-10
    assert found.negative == 0


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_a_stretched_block_carries_the_uniaxial_stress(law: Law) -> None:
    block = grid.block((1e-3, 1e-3, 1e-3), (1, 2, 1))
    x, y, z = block.nodes.T
    fixed = np.stack([(x == 0) | (x == 1e-3), y == 0, z == 0], axis=1)
    mesh = grid.solid(block.nodes, block.hexes, fixed)
    system = System(body_of(mesh, law), place=lambda load: block.nodes * [1 + load, 1, 1])
    for point, stretch in zip(follow(system, [0.2, 0.5]), (1.2, 1.5), strict=True):
        stress = point.reaction[x == 1e-3, 0].sum() / 1e-6
        # nu 0.499, not 0.5: the stress differs by about sigma / kappa, 3e-3
        assert stress == pytest.approx(float(law.uniaxial(stretch)), rel=1e-9 if isinstance(law, Hooke) else 3e-3)


def test_the_follower_pressure_of_a_closed_cavity_has_a_potential() -> None:
    for cap in (2e-3, 0.0):
        for order in (1, 2):
            mesh = small_tube(order, cap)
            body, draw, h = body_of(mesh, LAWS[0]), np.random.default_rng(7), 1e-4
            x = mesh.nodes + draw.normal(size=mesh.nodes.shape) * 1e-4 * ~mesh.fixed
            step = draw.normal(size=x.shape) * 1e-4 * ~mesh.fixed
            area, volume = body.fluid(x)
            assert volume > 0
            change = (body.fluid(x + h * step)[1] - body.fluid(x - h * step)[1]) / (2 * h)
            assert change == pytest.approx(-(area * step).sum(), rel=1e-7)
            blocks = np.zeros((len(body.pattern.column), 3, 3))
            body.fluid(x, 1.0, blocks)
            K = matrix(body, blocks)
            slope = ((body.fluid(x + h * step)[0] - body.fluid(x - h * step)[0]) / (2 * h)).ravel()
            assert np.abs(K @ step.ravel() - slope).max() < 1e-8 * np.abs(slope).max()
            free = np.flatnonzero(~mesh.fixed)
            inner = K[free][:, free]
            assert abs(inner - inner.T).max() < 1e-13 * abs(K).max()
            assert System(body).closed


def test_the_reference_mesh_is_ours(reference) -> None:
    mesh = tube_grid.tube(0.032, 5e-3, 1e-3, (32, 32, 1), cap=2e-3)
    from scipy.spatial import cKDTree

    off, same = cKDTree(mesh.nodes).query(reference["nodes_mm"] * 1e-3)
    assert off.max() < 1e-15

    def sets(elements):
        return {tuple(sorted(e)) for e in elements.tolist()}

    assert sets(mesh.hexes) == sets(same[reference["hexes"]])
    assert sets(mesh.pressed) == sets(same[reference["pressure_quads"]])


def test_printable_materials_by_name() -> None:
    agilus = printable("Agilus30")
    assert (agilus.c1, agilus.shear, agilus.elongation) == (pytest.approx(2e5), pytest.approx(4e5), pytest.approx(2.2))
    assert scaled(agilus, 2.0).c1 == 2 * agilus.c1
    with pytest.raises(BadInput, match="no fit is given"):
        printable("Dragon Skin 10")
    with pytest.raises(BadInput, match="nearest is 'FLX9785'"):
        printable("FLX9786")


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: NeoHooke(c1=-1.0), "shear modulus of -2 Pa"),
        (lambda: NeoHooke(c1=1e5, nu=0.5), "not including, 0.5"),
        (lambda: Ogden(mu=(1.0,), alpha=(0.0,)), "no alpha 0"),
        (lambda: tube_grid.tube(0.03, 5e-3, 6e-3, (32, 32, 1)), "wall < outer radius"),
        (lambda: tube_grid.tube(0.03, 5e-3, 1e-3, (48, 32, 1)), "multiples of the"),
        (lambda: tube_grid.tube(0.03, 5e-3, 1e-3, (4, 4, 1), voxels=(4, 4), cap=1e-3), "multiple of 8"),
    ],
)
def test_what_makes_no_solid_is_refused(make, said) -> None:
    with pytest.raises(BadInput, match=said):
        make()


def test_a_turned_element_is_refused() -> None:
    block = grid.block((1.0, 1.0, 1.0), (1, 1, 1))
    mesh = grid.solid(block.nodes, block.hexes[..., [1, 0, 3, 2, 5, 4, 7, 6]], np.zeros((8, 3), bool))
    with pytest.raises(BadInput, match="Jacobian of -"):
        body_of(mesh, LAWS[0])
