"""The compiled kernels: material points, element forces and tangents, follower pressure.

Everything compiled of `fem` stands in this one file, because numba's cache does not see a change in
another. Symmetric tensors are vectors (xx, yy, zz, xy, yz, zx); stresses are Kirchhoff's, tangents
those of the Lie derivative, both with the spatial gradients g = F^-T G.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fem.material import HOOKE, MOONEY_RIVLIN, OGDEN, YEOH

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Indices = NDArray[np.int32]

compiled = njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz"})

ROW = np.array([0, 1, 2, 0, 1, 2])
COLUMN = np.array([0, 1, 2, 1, 2, 0])
PLACE = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])  # of a symmetric tensor's component in its vector


@compiled
def _product_tangent(b: Array, factor: float, c: Array) -> None:
    """Add factor (b_ik b_jl + b_il b_jk) / 2 to c."""
    for m in range(6):
        i, j = ROW[m], COLUMN[m]
        for n in range(6):
            k, q = ROW[n], COLUMN[n]
            c[m, n] += factor * 0.5 * (b[i, k] * b[j, q] + b[i, q] * b[j, k])


@compiled
def _isochoric(c: Array, tau: Array, wanted: bool, curved: bool) -> None:
    """Turn the fictitious stress and tangent of F without its volume into those with it (dev, P : c : P, ...).

    tau becomes dev tau; c, if wanted, P:c:P + 2/3 tr(tau) P - 2/3 (dev tau (x) 1 + 1 (x) dev tau); curved: c is not 0.
    """
    trace = tau[0] + tau[1] + tau[2]
    for m in range(3):
        tau[m] -= trace / 3
    if not wanted:
        return
    if curved:
        for n in range(6):
            mean = (c[0, n] + c[1, n] + c[2, n]) / 3
            for m in range(3):
                c[m, n] -= mean
        for m in range(6):
            mean = (c[m, 0] + c[m, 1] + c[m, 2]) / 3
            for n in range(3):
                c[m, n] -= mean
    for m in range(3):
        for n in range(3):
            c[m, n] -= 2 / 9 * trace + 2 / 3 * (tau[m] + tau[n])
        for n in range(3, 6):
            c[m, n] -= 2 / 3 * tau[n]
            c[n, m] -= 2 / 3 * tau[n]
        c[m, m] += 2 / 3 * trace
        c[m + 3, m + 3] += trace / 3


@compiled
def _invariant_law(  # noqa: PLR0917
    law: int, q: Array, b: Array, wanted: bool, tau: Array, c: Array
) -> float:
    """Laws in I1 and I2 of the isochoric b (3, 3): set tau and, if wanted, c; return the energy."""
    i1 = b[0, 0] + b[1, 1] + b[2, 2]
    w1, w11, w2 = q[0], 0.0, 0.0
    x = i1 - 3
    energy = q[0] * x
    if law == YEOH:
        energy = ((q[2] * x + q[1]) * x + q[0]) * x
        w1 = (3 * q[2] * x + 2 * q[1]) * x + q[0]
        w11 = 6 * q[2] * x + 2 * q[1]
    elif law == MOONEY_RIVLIN:
        w2 = q[1]
    for m in range(6):
        tau[m] = 2 * (w1 + i1 * w2) * b[ROW[m], COLUMN[m]]
    if w2 != 0.0:
        squares = 0.0
        for m in range(6):
            i, j = ROW[m], COLUMN[m]
            square = b[i, 0] * b[j, 0] + b[i, 1] * b[j, 1] + b[i, 2] * b[j, 2]
            tau[m] -= 2 * w2 * square
            squares += square if m < 3 else 0.0
        energy += w2 * (0.5 * (i1 * i1 - squares) - 3)
        if wanted:
            _product_tangent(b, -4 * w2, c)
    curved = w2 != 0.0 or w11 != 0.0
    if wanted and curved:
        for m in range(6):
            for n in range(6):
                c[m, n] += 4 * (w11 + w2) * b[ROW[m], COLUMN[m]] * b[ROW[n], COLUMN[n]]
    _isochoric(c, tau, wanted, curved)
    return float(energy)


@compiled
def _ogden(  # noqa: PLR0912, loops are faster written out
    q: Array, b: Array, wanted: bool, tau: Array, c: Array
) -> float:
    """Ogden's law of the isochoric b (3, 3) in principal axes: set tau and, if wanted, c; return the energy."""
    squares, axes = np.linalg.eigh(b)
    log = 0.5 * np.log(squares)
    w, s = np.zeros(3), np.zeros(3)
    energy = 0.0
    for p in range(3):
        for a in range(3):
            power = q[p] * np.exp(q[p + 3] * log[a])
            energy += (power - q[p]) / q[p + 3]
            w[a] += power
            s[a] += power * q[p + 3]
    mean, total = w.sum() / 3, s.sum() / 9
    dyad = np.empty((3, 6))
    for a in range(3):
        for m in range(6):
            dyad[a, m] = axes[ROW[m], a] * axes[COLUMN[m], a]
            tau[m] += (w[a] - mean) * dyad[a, m]
    if not wanted:
        return float(energy)
    for a in range(3):
        for d in range(3):
            slope = total - (s[a] + s[d]) / 3 + (s[a] - 2 * (w[a] - mean) if a == d else 0.0)
            for m in range(6):
                for n in range(6):
                    c[m, n] += slope * dyad[a, m] * dyad[d, n]
    for a in range(3):
        for d in range(a):
            x = log[a] - log[d]  # (tau_a l_d^2 - tau_d l_a^2) / (l_a^2 - l_d^2) without its cancellation
            shear = mean - 0.5 * (w[a] + w[d])
            for p in range(3):
                ratio = 0.5 * q[p + 3] if abs(x) < 1e-8 else np.sinh(0.5 * q[p + 3] * x) / np.tanh(x)
                shear += q[p] * np.exp(0.5 * q[p + 3] * (log[a] + log[d])) * ratio
            for m in range(6):
                left = 0.5 * (axes[ROW[m], a] * axes[COLUMN[m], d] + axes[ROW[m], d] * axes[COLUMN[m], a])
                for n in range(6):
                    right = axes[ROW[n], a] * axes[COLUMN[n], d] + axes[ROW[n], d] * axes[COLUMN[n], a]
                    c[m, n] += 2 * shear * left * right
    return float(energy)


@compiled
def material_point(  # noqa: PLR0917, compiled functions take arrays, not objects
    law: int, q: Array, F: Array, J: float, wanted: bool, b: Array, tau: Array, c: Array
) -> float:
    """Set the shape-changing part's Kirchhoff stress tau (6,) and, if wanted, tangent c (6, 6) [Pa]; return its energy.

    F (3, 3) with determinant J > 0; q the law's numbers; b (3, 3) is room. Bonet and Wood, Nonlinear Continuum
    Mechanics for Finite Element Analysis, chapter 6; Ogden's law in principal axes.
    """
    for i in range(3):
        for j in range(3):
            b[i, j] = F[i, 0] * F[j, 0] + F[i, 1] * F[j, 1] + F[i, 2] * F[j, 2]
    tau[:] = 0.0
    if wanted:
        c[:] = 0.0
    if law == HOOKE:
        energy = 0.0
        for m in range(6):
            i, j = ROW[m], COLUMN[m]
            square = b[i, 0] * b[j, 0] + b[i, 1] * b[j, 1] + b[i, 2] * b[j, 2]
            tau[m] = q[0] * (square - b[i, j])
            energy += 0.25 * q[0] * (square - 2 * b[i, j] + 1) if m < 3 else 0.0
        if wanted:
            _product_tangent(b, 2 * q[0], c)
        return float(energy)
    b *= J ** (-2 / 3)
    return _ogden(q, b, wanted, tau, c) if law == OGDEN else _invariant_law(law, q, b, wanted, tau, c)


@compiled
def _gather(x: Array, hexes: Indices, e: int, out: Array) -> None:
    """Set out (3, a) to the rows of x (n, 3) at the nodes of element e."""
    for a in range(hexes.shape[1]):
        for i in range(3):
            out[i, a] = x[hexes[e, a], i]


@compiled
def deformation(x: Array, G: Array, F: Array) -> float:
    """Set F (3, 3) to x (3, a) times reference gradients G (a, 3); return its determinant."""
    for i in range(3):
        u = v = w = 0.0
        for a in range(len(G)):
            u += x[i, a] * G[a, 0]
            v += x[i, a] * G[a, 1]
            w += x[i, a] * G[a, 2]
        F[i, 0], F[i, 1], F[i, 2] = u, v, w
    return float(
        F[0, 0] * (F[1, 1] * F[2, 2] - F[1, 2] * F[2, 1])
        - F[0, 1] * (F[1, 0] * F[2, 2] - F[1, 2] * F[2, 0])
        + F[0, 2] * (F[1, 0] * F[2, 1] - F[1, 1] * F[2, 0])
    )


@compiled
def _inverse(F: Array, J: float, out: Array) -> None:
    for i in range(3):
        for j in range(3):
            k, m, n, q = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            out[j, i] = (F[k, n] * F[m, q] - F[k, q] * F[m, n]) / J


@compiled
def _measure(law: int, F: Array, J: float) -> float:
    """Return the volumetric measure m."""
    return float(0.5 * ((F * F).sum() - 3)) if law == HOOKE else J - 1


@compiled
def _measure_stress(law: int, F: Array, J: float, out: Array) -> None:
    """Set the Kirchhoff stress of the volumetric measure per unit pressure: J 1, or b for tr E."""
    for m in range(6):
        i, j = ROW[m], COLUMN[m]
        if law == HOOKE:
            out[m] = F[i, 0] * F[j, 0] + F[i, 1] * F[j, 1] + F[i, 2] * F[j, 2]
        else:
            out[m] = J if m < 3 else 0.0


@compiled
def _moved_stress(A: Array, stress: Array, out: Array) -> None:
    """Set out (6,) to A stress A^T, stress (6,) symmetric."""
    out[:] = 0.0
    for j in range(3):
        for k in range(3):
            right = 0.0  # (stress A^T)_kj
            for i in range(3):
                right += stress[PLACE[k, i]] * A[j, i]
            for i in range(3):
                if PLACE[i, j] < 3 or (i, j) == (0, 1) or (i, j) == (1, 2) or (i, j) == (2, 0):
                    out[PLACE[i, j]] += A[i, k] * right


@compiled
def linearised(  # noqa: PLR0917
    x: Array,
    step: Array,
    hexes: Indices,
    G: Array,
    weight: Array,
    law: Indices,
    q: Array,
    kappa: Array,
    mean: bool,
    out: Array,
) -> None:
    """Set out (2, e, g, 7) to stresses at x (n, 3) and their change with a step (n, 3), to first order.

    Six components of the shape-changing second Piola-Kirchhoff stress S, dS = C : dE, and the
    pressure kappa m. With mean, all points of an element get the pressure of the element's mean.
    """
    F, D, points = np.empty((3, 3)), np.empty((3, 3)), weight.shape[1]
    inverse, b, d, change = np.empty((3, 3)), np.empty((3, 3)), np.empty(6), np.empty(6)
    tau, c, unit = np.empty(6), np.empty((6, 6)), np.empty(6)
    here, there = np.empty((3, hexes.shape[1])), np.empty((3, hexes.shape[1]))
    for e in range(len(hexes)):
        _gather(x, hexes, e, here)
        _gather(step, hexes, e, there)
        total = total_change = volume = 0.0
        for g in range(points):
            J = deformation(here, G[e, g], F)
            deformation(there, G[e, g], D)
            _inverse(F, J, inverse)
            for s in range(6):
                i, j = ROW[s], COLUMN[s]
                d[s] = 0.0
                for k in range(3):
                    d[s] += D[i, k] * inverse[k, j] + (D[j, k] * inverse[k, i] if s > 2 else 0.0)
            _measure_stress(law[e], F, J, unit)
            m, dm = _measure(law[e], F, J), (unit * d).sum()
            material_point(law[e], q[e], F, J, True, b, tau, c)
            for s in range(6):
                change[s] = 0.0
                for t in range(6):
                    change[s] += c[s, t] * d[t]
            _moved_stress(inverse, tau, out[0, e, g])
            _moved_stress(inverse, change, out[1, e, g])
            total += weight[e, g] * m
            total_change += weight[e, g] * dm
            volume += weight[e, g]
            out[0, e, g, 6], out[1, e, g, 6] = kappa[e] * m, kappa[e] * dm
        if mean:
            for g in range(points):
                out[0, e, g, 6], out[1, e, g, 6] = kappa[e] * total / volume, kappa[e] * total_change / volume


@compiled
def _add_stiffness(g: Array, tau: Array, c: Array, weight: float, slope: Array, out: Array) -> None:  # noqa: PLR0917
    """Add weight (B^T c B + (g . tau g) 1) to the node pairs b <= a of out (a, 9b + 3i + j).

    slope (3, 9b) is room for d(stress)_ik / dx_bj: a row of out is then one sweep over long vectors.
    """
    nodes = len(g)
    for b in range(nodes):
        x, y, z, at = weight * g[b, 0], weight * g[b, 1], weight * g[b, 2], 9 * b
        for s in range(6):
            d0 = c[s, 0] * x + c[s, 3] * y + c[s, 5] * z
            d1 = c[s, 1] * y + c[s, 3] * x + c[s, 4] * z
            d2 = c[s, 2] * z + c[s, 4] * y + c[s, 5] * x
            i, k = ROW[s], COLUMN[s]
            one, other = at + 3 * i, at + 3 * k
            slope[k, one], slope[k, one + 1], slope[k, one + 2] = d0, d1, d2
            slope[i, other], slope[i, other + 1], slope[i, other + 2] = d0, d1, d2
        t0 = tau[0] * x + tau[3] * y + tau[5] * z
        t1 = tau[3] * x + tau[1] * y + tau[4] * z
        t2 = tau[5] * x + tau[4] * y + tau[2] * z
        for i in range(3):
            slope[0, at + 4 * i] += t0
            slope[1, at + 4 * i] += t1
            slope[2, at + 4 * i] += t2
    for a in range(nodes):
        u, v, w = g[a, 0], g[a, 1], g[a, 2]
        for s in range(9 * a + 9):
            out[a, s] += u * slope[0, s] + v * slope[1, s] + w * slope[2, s]


@compiled
def assemble(  # noqa: PLR0912, PLR0915, PLR0917
    x: Array,
    hexes: Indices,
    G: Array,
    weight: Array,
    law: Indices,
    q: Array,
    kappa: Array,
    mean: bool,
    held: Array,
    slot: Indices,
    force: Array,
    carried: Array,
    stiffness: Array,
) -> tuple[int, float]:
    """Add the elements' forces to force (n, 3) and, if it has entries, their tangents to stiffness (s, 3, 3).

    x (n, 3) current positions; G (e, g, a, 3), weight (e, g); law (e,), q (e, 6), kappa (e,);
    slot (e, a, a) says where a pair of nodes stands in stiffness. The force has the true stresses; the
    geometric part of the tangent has those held (e, g, 7), as `linearised` makes them: Newton's
    method on stresses and displacements together (pressure: Simo, Taylor and Pister, Comput. Meth.
    Appl. Mech. Eng. 51, 1985; all stresses: Magisano, Leonetti and Garcea, ibid. 313, 2017); carried (n, 3)
    are the forces of those, set with the tangent. Returns the first element whose J is not positive
    (or -1: all sound) and the strain energy.
    """
    nodes, points = hexes.shape[1], weight.shape[1]
    F, inverse, tau, c = np.empty((points, 3, 3)), np.empty((3, 3)), np.empty(6), np.empty((6, 6))
    unit, total, J = np.empty(6), np.empty(6), np.empty(points)
    g, k, slope = np.empty((nodes, 3)), np.empty((nodes, 9 * nodes)), np.empty((3, 9 * nodes))
    b, here, f, h = np.empty((3, 3)), np.empty((3, nodes)), np.empty((nodes, 3)), np.empty((nodes, 3))
    wanted, energy = len(stiffness) > 0, 0.0
    for e in range(len(hexes)):
        if wanted:
            k[:] = 0.0
        f[:], h[:] = 0.0, 0.0
        _gather(x, hexes, e, here)
        volume = measure = 0.0
        for p in range(points):
            J[p] = deformation(here, G[e, p], F[p])
            if not J[p] > 0:
                return e, energy
            measure += weight[e, p] * _measure(law[e], F[p], J[p])
            volume += weight[e, p]
        measure /= volume
        for p in range(points):
            w = weight[e, p]
            m = measure if mean else _measure(law[e], F[p], J[p])
            energy += w * (material_point(law[e], q[e], F[p], J[p], wanted, b, tau, c) + 0.5 * kappa[e] * m * m)
            _inverse(F[p], J[p], inverse)
            _measure_stress(law[e], F[p], J[p], unit)
            for a in range(nodes):
                u, v, z = G[e, p, a, 0], G[e, p, a, 1], G[e, p, a, 2]
                for i in range(3):
                    g[a, i] = u * inverse[0, i] + v * inverse[1, i] + z * inverse[2, i]
            for s in range(6):
                total[s] = tau[s] + kappa[e] * m * unit[s]
            for a in range(nodes):
                u, v, z = w * g[a, 0], w * g[a, 1], w * g[a, 2]
                f[a, 0] += total[0] * u + total[3] * v + total[5] * z
                f[a, 1] += total[3] * u + total[1] * v + total[4] * z
                f[a, 2] += total[5] * u + total[4] * v + total[2] * z
                h[a, 0] += unit[0] * u + unit[3] * v + unit[5] * z
                h[a, 1] += unit[3] * u + unit[1] * v + unit[4] * z
                h[a, 2] += unit[5] * u + unit[4] * v + unit[2] * z
            if not wanted:
                continue
            pressure = held[e, p, 6]
            _moved_stress(F[p], held[e, p], total)
            for s in range(6):
                total[s] += pressure * unit[s]
            if law[e] != HOOKE:
                for s in range(3):
                    for t in range(3):
                        c[s, t] += pressure * J[p]
                    c[s, s] -= 2 * pressure * J[p]
                    c[s + 3, s + 3] -= pressure * J[p]
            if not mean:
                for s in range(6):
                    for t in range(6):
                        c[s, t] += kappa[e] * unit[s] * unit[t]
            _add_stiffness(g, total, c, w, slope, k)
            for a in range(nodes):
                node, u, v, z = hexes[e, a], w * g[a, 0], w * g[a, 1], w * g[a, 2]
                carried[node, 0] += total[0] * u + total[3] * v + total[5] * z
                carried[node, 1] += total[3] * u + total[1] * v + total[4] * z
                carried[node, 2] += total[5] * u + total[4] * v + total[2] * z
        for a in range(nodes):
            for i in range(3):
                force[hexes[e, a], i] += f[a, i]
        if not wanted:
            continue
        for a in range(nodes):
            for other_node in range(a + 1):
                one, other = slot[e, a, other_node], slot[e, other_node, a]
                for i in range(3):
                    for j in range(3):
                        value = k[a, 9 * other_node + 3 * i + j]
                        if mean:
                            value += kappa[e] / volume * h[a, i] * h[other_node, j]
                        stiffness[one, i, j] += value
                        if a != other_node:
                            stiffness[other, j, i] += value
    return -1, energy


@compiled
def press(  # noqa: PLR0912, PLR0917
    x: Array,
    quads: Indices,
    shape: Array,
    along: Array,
    weight: Array,
    origin: Array,
    pressure: float,
    slot: Indices,
    area: Array,
    stiffness: Array,
) -> float:
    """Add the area vectors of pressed quads to area (n, 3), and pressure times their slope to stiffness.

    x (n, 3) current positions; quads (q, a) anticlockwise as seen from the fluid; shape (g, a) and
    along (g, a, 2) of the parent square, weight (g,); slot (q, a, a). The fluid pushes with
    -pressure times area; area is -dV/dx of the volume V it fills, which is returned (as seen
    from origin). Exact for these polynomials, so that the sum over a closed surface is symmetric.
    """
    count = quads.shape[1]
    u, v, n, at, block = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.zeros((3, 3))
    wanted, volume = len(stiffness) > 0, 0.0
    for face in range(len(quads)):
        for g in range(len(weight)):
            u[:], v[:], at[:] = 0.0, 0.0, -origin
            for a in range(count):
                for i in range(3):
                    u[i] += along[g, a, 0] * x[quads[face, a], i]
                    v[i] += along[g, a, 1] * x[quads[face, a], i]
                    at[i] += shape[g, a] * x[quads[face, a], i]
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                n[i] = weight[g] * (u[j] * v[k] - u[k] * v[j])
                volume -= n[i] * at[i] / 3
            for a in range(count):
                for i in range(3):
                    area[quads[face, a], i] += shape[g, a] * n[i]
            if not wanted:
                continue
            for b in range(count):
                for i in range(3):  # d(u x v)_i / dx_bj = N_b,1 (e_j x v)_i + N_b,2 (u x e_j)_i
                    j, k = (i + 1) % 3, (i + 2) % 3
                    t = along[g, b, 0] * v[i] - along[g, b, 1] * u[i]
                    block[j, k], block[k, j] = t, -t
                for a in range(count):
                    scale = pressure * weight[g] * shape[g, a]
                    for i in range(3):
                        for j in range(3):
                            stiffness[slot[face, a, b], i, j] += scale * block[i, j]
    return volume


@compiled
def dense_block(  # noqa: PLR0917
    data: Array, column: Indices, start: Indices, first: int, last: int, left: int, out: Array
) -> None:
    """Fill out (last-first, last-left), Fortran order: rows first..last, columns left..last of a symmetric CSR matrix.

    Its rows, columns ascending, are read as columns, so that what is written lies together.
    """
    for row in range(left, last):
        for i in range(last - first):
            out[i, row - left] = 0.0
        for at in range(start[row + 1] - 1, start[row] - 1, -1):
            k = column[at]
            if k < first:
                break
            if k < last:
                out[k - first, row - left] = data[at]
