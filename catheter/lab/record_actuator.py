"""Simulated recordings of printed actuators: pressure steps, twist seen by a camera above, the camera's frames."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from catheter.calibrate import groups, twist_curve
from catheter.lab.scene import Scene
from catheter.reconstruction import tube_voxels
from data.recorder import Recorder
from data.signal import Array, Signal
from data.topics import standard


@dataclass(frozen=True, eq=False)
class ActuatorRun:
    """Times (n,) [s], pressures as measured [Pa] and twists as seen [rad]; the true twist beside them."""

    time_s: Array
    pressure_pa: Array
    twist_rad: Array
    true_twist_rad: Array


def simulated(scene: Scene) -> ActuatorRun:
    """Return a scene's actuator on its bench: slow steps up to the highest wanted pressure, noise on both channels."""
    shape, pattern, bench = (scene.tables[name] for name in ("tube", "map", "bench"))
    moduli = pattern.moduli(*shape.voxels).ravel()
    levels, kind = np.unique(moduli, return_inverse=True)
    most = max(scene.tables["wanted"].pressures)
    curve = twist_curve(groups(tube_voxels(shape), kind), np.linspace(0, 1.05 * most, 9)[1:])(
        np.log(levels * bench.off)
    )
    rng = np.random.default_rng(bench.number)
    time_s = np.arange(bench.samples) / bench.rate
    pressure = most * np.arange(1, bench.samples + 1) / bench.samples
    truth = curve.at(pressure)[0]
    measured = pressure * (1 + bench.pressure_noise * rng.standard_normal(bench.samples))
    seen = truth + bench.camera_noise * rng.standard_normal(bench.samples)
    return ActuatorRun(time_s, measured, seen, truth)


def record_actuator(scene: Scene, out: Path, origin: dict[str, str], *, overwrite: bool) -> ActuatorRun:
    """Simulate and write a recording: /pressure, /twist, and frames of the marker on the cap in /camera/top.

    Raises BadInput for an impossible scene, CannotWrite for the output.
    """
    run, bench = simulated(scene), scene.tables["bench"]
    truth = {
        f"{name}.{key}": repr(value) for name in ("map", "bench") for key, value in asdict(scene.tables[name]).items()
    }
    with Recorder(out, origin, scene=scene.text, truth=truth, flush_s=None, replace=overwrite) as recorder:
        for name in ("/pressure", "/twist", "/camera/top"):
            recorder.add(replace(standard(name), note="simulated", rate_hz=bench.rate))
        twists = np.stack([run.twist_rad, np.full(bench.samples, bench.camera_noise)], axis=1)
        for at, picture in zip(run.time_s.tolist(), frames(run, bench.number), strict=True):
            recorder.write_picture("/camera/top", at, picture, "png")
        signals = {
            "/pressure": Signal(run.time_s, run.pressure_pa, "Pa", name="/pressure"),
            "/twist": Signal(run.time_s, twists, "rad", components=("angle", "sigma"), name="/twist"),
        }
        recorder.write_signals(signals)
    return run


def frames(run: ActuatorRun, number: int) -> Iterator[bytes]:
    """Yield the camera's pictures, PNG: the marker at the true twist, with the camera's own noise."""
    import cv2

    from vision.render import Shot, render

    rng = np.random.default_rng(number)
    for angle in run.true_twist_rad.tolist():
        yield bytes(cv2.imencode(".png", render(Shot(angle_rad=angle), rng))[1])
