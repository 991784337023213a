"""The study of calibration: how often a reported interval holds the modulus, over repeated simulated recordings."""

import time
from collections.abc import Callable

import numpy as np

from catheter.calibrate import Calibration, Curve, calibrate, groups, surrogate, twist_curve
from catheter.inflatable import Pattern, Shape
from catheter.lab.report import Progress, Report, Row
from catheter.reconstruction import tube_voxels
from data.signal import Array

HELIX = Pattern(pattern="helix", period=16, width=4)
MOST_PA, REACH = 60e3, 0.3
SAMPLES, OFF = 240, 1.05  # of a recording; the materials over those of the table
CAMERA_RAD, PRESSURE_SHARE = np.radians(0.05), 0.01  # noises
BAND = (182, 198)  # of 200 draws at 95 %: the 99 % binomial band


def calibration(*, quick: bool, progress: Progress) -> Report:
    """Calibrate the twisting tube from 200 simulated recordings by a table of its model, from 5 by the model itself."""
    shape = Shape(length=16e-3, divisions=(16, 16, 1), voxels=(16, 16)) if quick else Shape(divisions=(32, 32, 1))
    levels, kind = np.unique(HELIX.moduli(*shape.voxels).ravel(), return_inverse=True)
    full = twist_curve(groups(tube_voxels(shape), kind), np.linspace(0, 1.1 * MOST_PA, 9)[1:])
    progress(0.05)
    started = time.perf_counter()
    table = surrogate(full, np.log(levels), REACH, 4)
    tabulated, truth = time.perf_counter() - started, levels * OFF
    exact = full(np.log(truth))
    progress(0.4)
    rows, hits, ends = list[Row](), np.zeros(2), list[Calibration]()
    started = time.perf_counter()
    for number in range(200):
        ends.append(_one(table, exact, levels, number))
        hits += (ends[-1].interval[:, 0] <= truth) & (truth <= ends[-1].interval[:, 1])
    each = (time.perf_counter() - started) / 200
    progress(0.6)
    for name, count, column in zip((HELIX.soft, HELIX.stiff), hits, range(2), strict=True):
        spread = float(np.std([np.log(one.moduli[column]) for one in ends]))
        said = float(np.mean([one.covariance[column, column] ** 0.5 for one in ends]))
        level = f"{count:.0f} of 200 intervals hold it; sd of log {spread:.4f}, said {said:.4f}"
        rows.append(Row(method=f"{name}, table", level=level, error=1 - count / 200, seconds=each))
    for number in range(1 if quick else 5):
        started = time.perf_counter()
        there = _one(full, exact, levels, number)
        apart = float(np.abs(np.log(there.moduli / ends[number].moduli)).max())
        seconds = time.perf_counter() - started
        rows.append(Row(method="model beside table", level=f"recording {number}", error=apart, seconds=seconds))
        progress(0.7 + 0.06 * number)
    return Report(
        name="calibration",
        title="Two moduli from simulated recordings, materials 5 % off: do 95 % intervals hold them?",
        level="outcome",
        error="misses, difference in log modulus",
        rows=rows,
        notes=[
            f"{SAMPLES} samples, camera noise 0.05 deg, the first frame's in all of them; pressure noise 1 %.",
            f"99 % band of 200: {BAND[0]} to {BAND[1]}.",
            f"The table of the model on 5 x 5 Chebyshev points took {tabulated:.1f} s.",
        ],
    )


def _one(curve: Callable[[Array], Curve], exact: Curve, seed: Array, number: int) -> Calibration:
    """Return the calibration from one recording's noise."""
    rng = np.random.default_rng(number)
    pressure = MOST_PA * np.arange(1, SAMPLES + 1) / SAMPLES
    noise = CAMERA_RAD * rng.standard_normal(SAMPLES + 1)
    angle = exact.at(pressure)[0] + noise[1:] - noise[0]  # counted from the first frame
    measured = pressure * (1 + PRESSURE_SHARE * rng.standard_normal(SAMPLES))
    return calibrate(curve, measured, angle, angle_sd=CAMERA_RAD, pressure_share=PRESSURE_SHARE, seed=seed)
