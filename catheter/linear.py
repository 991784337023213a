"""The circuit about an operating point: linear state space and frequency response, with `control`."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from catheter.circuit import Circuit
from data.errors import BadInput
from data.signal import Array

if TYPE_CHECKING:
    import control


def linearise(circuit: Circuit, source_pa: float, volume: ArrayLike | None = None) -> "control.StateSpace":
    """Return the linear system of small changes about a state: input source [Pa], outputs V/V_rest (N,).

    volume: V/V_rest (N,) of the operating point, by default at rest under `source_pa`. There every
    drop is 0 and the valves' slope is K/sqrt(d) with d their transition: the result holds for drops
    well below d. Elsewhere, along a filling, it holds as long as the state stays near. Raises
    BadInput for a source or volumes that cannot be.
    """
    import control

    from catheter.circuit_kernel import PER_VOLUME, flow, pressure, slopes

    n = len(circuit.segments)
    point = circuit.volume(source_pa) if volume is None else np.array(volume, dtype=np.float64)
    if point.shape != (n,) or not (point > 0).all() or not np.isfinite([*point, source_pa]).all():
        raise BadInput("operating point", f"is {source_pa:g} Pa, V = {point}", f"expected {n} volume ratios > 0")
    table, x = circuit.table(), point - 1.0
    rate, jacobian = np.empty(n), np.zeros((n, n))
    slopes(table, x, float(source_pa), rate, jacobian)
    push = np.zeros((n, 1))
    push[0, 0] = flow(table, 0, source_pa - pressure(table, 0, x[0])[0])[1] * table[0, PER_VOLUME]
    names = [f"V{k + 1}" for k in range(n)]
    return control.ss(
        jacobian, push, np.eye(n), 0.0, inputs=["u"], outputs=names, states=[f"x{k + 1}" for k in range(n)]
    )


def frequency_response(
    circuit: Circuit, source_pa: float, frequency_hz: ArrayLike, volume: ArrayLike | None = None
) -> Array:
    """Return V/V_rest per Pa of source, complex (N, m), at frequencies (m,); arguments as for `linearise`."""
    system = linearise(circuit, source_pa, volume)
    omega = 2 * np.pi * np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
    return np.asarray(system(1j * omega))[:, 0, :]
