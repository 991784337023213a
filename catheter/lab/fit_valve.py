"""Fits of valves from bench recordings: an orifice's K, a conical valve's cracking pressures, and their dashboards."""

import argparse
from pathlib import Path
from typing import Any

from catheter.lab.fit_bender import Fitted
from catheter.lab.outcome import table
from data.recording import Recording

PSI = 6894.757293168


def _title(recording: Recording) -> str:
    return str(recording.metadata.get("origin", {}).get("title", recording.path.stem))


def valve(recording: Recording, options: argparse.Namespace) -> Fitted:
    """K of an orifice from voltage steps, and what to do with its set screw."""
    from catheter.actuator import AREA_M2
    from data.units import quantity
    from sysid.orifice import fit_settled, settle

    unit = "m^3 Pa^-0.5 s^-1"
    place = recording.signal("/stroke")
    before, after, volts = (recording.signal(t).at(place.time_s) for t in ("/pressure/1", "/pressure/2", "/drive"))
    run = settle(place.time_s, place.value, before - after, volts, area_m2=AREA_M2)
    found = fit_settled(run)
    low, high = found.interval()
    parts: list[Any] = [
        f"K = {found.coefficient:.5g} {unit}, standard error {found.standard_error:.2g}, 95 % interval "
        f"{low:.5g} .. {high:.5g}, from {found.strokes} strokes, {found.samples} samples"
    ]
    values: dict[str, Any] = {"coefficient": found.coefficient, "standard_error": found.standard_error, "low": low,
                              "high": high, "strokes": found.strokes, "each": found.each.tolist()}  # fmt: skip
    if options.target:
        target = quantity(options.target, unit, "--target")
        values |= {"target": target, "deviation": found.deviation(target), "advice": found.advice(target)}
        parts.append(f"{100 * values['deviation']:+.2f} % from the target {target:.4g}: {values['advice']}")
    told = {"standard_error": f"{found.standard_error!r} {unit}", "low": f"{low!r} {unit}", "high": f"{high!r} {unit}"}
    kind, title = recording.kind, _title(recording)

    def dashboard(path: Path) -> None:
        from catheter.lab.views.valve import Bench, save_valve

        save_valve(Bench(title, kind, place.time_s, place.value, before, after, run, found, values.get("target")), path)

    return Fitted(values, parts, {"fit": told, "valve": {"coefficient": f"{found.coefficient!r} {unit}"}}, dashboard)


def cracking(recording: Recording, options: argparse.Namespace) -> Fitted:
    """Cracking pressures of a valve, forward and reverse, as a row for the valve table."""
    from sysid.orifice import fit_cracking

    drop = recording.signal("/pressure")
    flow = recording.signal("/flow").at(drop.time_s)
    found = fit_cracking(drop.value, flow)
    rows = [[one.direction, f"{one.pressure_pa / PSI:.3f}", f"{one.low_pa / PSI:.3f} .. {one.high_pa / PSI:.3f}"]
            for one in found]  # fmt: skip
    parts = [table(["direction", "cracks at [psi]", f"{100 * found[0].level:g} % interval"], rows)]
    told = {f"{one.direction}_{end}": f"{getattr(one, end + '_pa')!r} Pa" for one in found for end in ("low", "high")}
    row = {one.direction: f"{one.pressure_pa!r} Pa" for one in found}
    kind, title, known = recording.kind, _title(recording), _published(recording)

    def dashboard(path: Path) -> None:
        from catheter.lab.views.cracking import Ramps, save_cracking

        save_cracking(Ramps(title, kind, drop.time_s, drop.value, flow, found, known), path)

    return Fitted({"directions": [vars(one) for one in found]}, parts, {"fit": told, "cracking": row}, dashboard)


def _published(recording: Recording) -> dict[str, float]:
    """Return the published cracking pressures [Pa] of the valve that a recording's scene names, if it names one."""
    from catheter.lab.scene import Scene
    from data.table import table as thesis_table

    if not recording.scene:
        return {}
    scene = Scene.parse(recording.scene, f"{recording.path}, scene")
    if scene.heading.kind != "cracking":
        return {}
    named = scene.tables["valve"].valve
    return {direction: thesis_table("3.5").value(named, direction) for direction in ("forward", "reverse")}
