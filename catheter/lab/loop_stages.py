"""What a design loop says at each of its stages: values for scripts, lines and tables for people."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from catheter.lab.outcome import Outcome, table

if TYPE_CHECKING:
    from catheter.design_loop import DesignLoop, TwistCurve

DEG, MM, KPA, MPA = float(np.degrees(1.0)), 1e3, 1e-3, 1e-6


def clocks(loop: "DesignLoop") -> Outcome:
    """Say how far the cameras' clocks are from the bench's."""
    film = loop.first.film
    found = {camera: film.clock(camera) for camera in ("top", "side")}
    parts = [
        f"Camera {camera}: its clock {1e3 * one.offset_s:+.2f} ms, 95 % from {1e3 * one.low_s:.2f} to "
        f"{1e3 * one.high_s:.2f} ms, by {one.steps} steps of light"
        for camera, one in found.items()
    ]
    return Outcome({"kind": film.kind, "clocks": {camera: vars(one) for camera, one in found.items()}}, parts)


def twist(loop: "DesignLoop") -> Outcome:
    """Say what the frames show."""
    film = loop.first.film
    values = {
        "frames": len(film.twist.time_s),
        "missing": film.missing,
        "most_twist_rad": float(film.twist.value[np.nanargmax(np.abs(film.twist.value))]),
        "twist_sigma_rad": film.seen.sigma,
        "most_extension_m": float(np.nanmax(film.extension.value)),
    }
    text = (
        f"{values['frames']} frames ({film.kind}), {film.missing} without a marker; twist to "
        f"{values['most_twist_rad'] * DEG:.2f} deg (sigma {film.seen.sigma * DEG:.2g}), extension to "
        f"{values['most_extension_m'] * MM:.2f} mm"
    )
    return Outcome(values, [text])


def twin(loop: "DesignLoop") -> Outcome:
    """Say how far the design in the table's materials is from the film."""
    found = loop.twin
    text = (
        f"Model with the table's materials (simulated) minus film: {found.rmse * DEG:.3f} deg rms, mean "
        f"{found.offset * DEG:+.3f} deg; {len(found.response.pressure)} equilibria under the recorded pressure"
    )
    return Outcome({"model_rmse_rad": {"table": found.rmse}}, [text])


def materials(loop: "DesignLoop") -> Outcome:
    """Say what the film makes of both materials, beside the table and, where it was simulated, the truth."""
    first, found = loop.first, loop.calibration
    names, truth = (first.pattern.soft, first.pattern.stiff), first.truth
    rows, values = [], {}
    for k, name in enumerate(names):
        low, high = found.interval[k].tolist()
        numbers = [float(found.moduli[k]), low, high, float(first.levels[k])]
        values[name] = {"c1_pa": numbers[0], "interval_pa": [low, high], "table_pa": numbers[3]}
        if truth is not None:
            numbers.append(float(truth[k]))
            values[name] |= {"truth_pa": numbers[4], "held": bool(low <= truth[k] <= high)}
        rows.append([name, *(f"{MPA * number:.4f}" for number in numbers)])
    head = [
        "material",
        "c1 MPa",
        "95 % from",
        "to",
        "in the table",
        *(["simulated truth"] if truth is not None else []),
    ]
    rmse = {"table": loop.twin.rmse, "calibrated": loop.calibrated.rmse}
    parts = [
        table(head, rows, f"Materials from the film ({first.film.kind}), {found.steps} steps"),
        f"Model with these materials (simulated) minus film: {rmse['calibrated'] * DEG:.3f} deg rms, "
        f"misfit {found.misfit:.2f} of the noises of gauge and camera",
    ]
    return Outcome({"model_rmse_rad": rmse, "materials": values, "misfit": found.misfit}, parts)


def redesign(loop: "DesignLoop") -> Outcome:
    """Say how far from the design the actuator moves, as printed and designed anew."""
    made = loop.redesign
    values, rows = [], []
    for (what, at, one), errors in zip(made.rows, loop.errors, strict=True):
        off = made.errors(one)
        row = {
            "pressure_pa": at,
            "twist_rad": made.twist(one.standings[0]),
            "rms_m": float(np.sqrt((off**2).mean())),
            "largest_m": float(off.max()),
            "largest_strain": float(errors.strain.max()),
        }
        values.append({"what": what, **row})
        numbers = np.array(list(row.values())) * (KPA, DEG, MM, MM, 1.0)
        rows.append([what, *(f"{number:.{n}f}" for number, n in zip(numbers, (2, 3, 4, 4, 4), strict=True))])
    designed = made.twist(made.case.whole[0])
    title = f"Designed: {designed * DEG:.3f} deg at {loop.closing.pressure * KPA:g} kPa (simulated)"
    head = ["", "kPa", "twist deg", "off by, rms mm", "largest mm", "strain"]
    last = loop.errors[-1]
    maps = {
        "modulus_share": last.modulus.tolist(),
        "displacement_m": last.displacement.tolist(),
        "strain": last.strain.tolist(),
    }
    found = {
        "design_twist_rad": designed,
        "redesign": values,
        "voxels_changed": made.changed,
        "error_maps": maps,
        "curves": [_curve(one) for one in loop.curves],
    }
    parts = [table(head, rows, title), f"{made.changed} voxels changed. strain: the largest error in a voxel."]
    return Outcome(found, [*parts, *(_again(loop, found) if loop.again else [])])


def _again(loop: "DesignLoop", values: dict[str, Any]) -> list[str]:
    """Say what a second actuator, printed from a map that came of the loop, does beside what was foretold."""
    again, found = loop.again, loop.anew
    assert again is not None
    film = again.film
    load = film.pressure.at(film.twist.time_s)
    within = np.abs(found.residual) <= loop.scatter(load) + loop.noise(load)
    share = float(within[np.isfinite(found.residual)].mean())
    there = loop.reached
    differ = int((again.stiff != (np.array(loop.redesign.after.chosen).reshape(again.shape.voxels) > 0)).sum())
    values["again"] = {
        "kind": film.kind,
        "rmse_rad": found.rmse,
        "offset_rad": found.offset,
        "within_scatter": share,
        "voxels_unlike_this_redesign": differ,
        "twist_rad": there,
    }
    lines = [
        f"Printed again from that map ({film.kind}): film minus model with the first's materials "
        f"{-found.offset * DEG:+.3f} deg in the mean, {found.rmse * DEG:.3f} deg rms; {100 * share:.0f} % of the "
        "frames within what specimens scatter (assumed)",
        f"It twists by {there * DEG:.2f} deg at {KPA * loop.redesign.pressure_pa:.2f} kPa; designed were "
        f"{values['design_twist_rad'] * DEG:.2f} deg",
    ]
    return [*lines, *([f"Its map differs from this redesign in {differ} voxels"] if differ else [])]


def _curve(one: "TwistCurve") -> dict[str, Any]:
    return {
        "name": one.name,
        "map": one.map,
        "film": one.film,
        "pressure_pa": one.pressure.tolist(),
        "twist_rad": one.twist.tolist(),
    }


STAGES: dict[str, Callable[["DesignLoop"], Outcome]] = {
    "clocks": clocks,
    "twist": twist,
    "twin": twin,
    "materials": materials,
    "redesign": redesign,
}
LAST = "redesign"


def told(loop: "DesignLoop", until: str, advance: Callable[[float], None]) -> Outcome:
    """Return what a loop says up to a stage, which is computed; advance is told the share that is done."""
    names = list(STAGES)
    wanted = names[: names.index(until) + 1]
    if "twin" in wanted:
        _ = loop.twin  # first: it needs the pressure only, and the frames may be read meanwhile
        advance(0.15)
    found = Outcome({})
    for number, name in enumerate(wanted, start=1):
        one = STAGES[name](loop)
        found.values |= one.values
        found.parts += one.parts
        advance(0.15 + 0.75 * number / len(wanted))
    return found
