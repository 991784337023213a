"""Fit a bender's force model to one recording, and see how it does on another.

    python tests/examples/fit_bender.py CHIRP.mcap [OTHER.mcap]

Recordings need /volume [m^3] and /force [N]. `python -m catheter record chirp --out CHIRP.mcap`
writes a simulated one.
"""

import sys

import numpy as np

from data.recording import Recording
from data.signal import Array
from sysid.estimate import Bootstrap
from sysid.identify import Identify, columns_of, identify
from sysid.motion import motion

ML = 1e-6  # the published models count volume in millilitres


def signals(path: str) -> tuple[Array, Array, Array, str]:
    """Return time [s], volume [mL] and force [N] on the force's clock, and whether they were measured."""
    with Recording(path) as recording:
        force = recording.signal("/force")
        return force.time_s, recording.signal("/volume").at(force.time_s) / ML, force.value, recording.kind


def main(path: str, other: str | None = None) -> None:
    """Fit, print the chosen terms with their intervals, and judge on the other recording."""
    time_s, volume_ml, force_n, kind = signals(path)
    found = identify(time_s, volume_ml, force_n, Identify(rule="1 %"), Bootstrap(resamples=200))
    chosen = found.chosen
    print(f"{path} ({kind}): {chosen.samples} samples, noise of the volume {found.motion.noise:.2g} mL")
    for name, value, low, high in zip(chosen.names, chosen.values, chosen.low, chosen.high, strict=True):
        print(f"  {name:6s} {value: .4e}   95 % {low: .4e} to {high: .4e}")
    print(f"  RMSE {chosen.rmse:.4g} N; on the second half, fitted to the first, {found.second_half:.4g} N")
    if other:
        time_s, volume_ml, force_n, kind = signals(other)
        moved = motion(time_s, volume_ml)
        weights, constant = found.selection.weights[found.mask], found.selection.constants[found.mask]
        residual = (constant + columns_of(moved) @ weights - force_n)[moved.known]
        print(f"{other} ({kind}): RMSE {np.sqrt(np.nanmean(residual**2)):.4g} N")


if __name__ == "__main__":
    main(*sys.argv[1:])
