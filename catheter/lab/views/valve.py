"""Dashboard of an orifice on the bench: piston and valve in 3D, flow over pressure drop with the fit, plots, notes."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from catheter.actuator import AREA_M2, STROKE_M
from catheter.circuit import DENSITY_KG_M3, DISCHARGE
from catheter.lab.views.benches import KPA, ML, flow_sheet, label, plotted, scatter, send, sheet_view, text_view
from catheter.lab.views.clocks import TIMELINE, Clocks
from catheter.lab.views.labels import BEST, FRAME, MEASURED, MODELS, Colour, view_name
from catheter.lab.views.output import Output
from data.signal import Array
from sysid.orifice import Settled, ValveFit

MM = 1e3
MOST_FRAMES = 400  # in which the piston is drawn
RADIUS_MM = MM * float(np.sqrt(AREA_M2 / np.pi))
PIPE_MM, PLATE_MM = 20.0, 5.0  # as drawn


@dataclass(frozen=True, eq=False)
class Bench:
    """A recorded run of an orifice, each (n,): piston place [m], pressures before and after [Pa]; what was fitted."""

    title: str
    kind: str
    time_s: Array
    place_m: Array
    before_pa: Array
    after_pa: Array
    run: Settled
    fit: ValveFit
    target: float | None


def save_valve(bench: Bench, path: Path) -> None:
    """Write the dashboard of an orifice's fit to `path`, replaced. Raises CannotWrite."""
    fit, run, kind, clocks = bench.fit, bench.run, bench.kind, Clocks()
    root = np.sign(run.drop_pa) * np.sqrt(np.abs(run.drop_pa))
    flow, model = ML * run.flow_m3_s, np.where(np.isnan(run.flow_m3_s), np.nan, ML * fit.coefficient * root)
    groups: dict[str, list[tuple[str, Array, Colour]]] = {
        "pressure [kPa]": [("before", KPA * bench.before_pa, MODELS[2]), ("after", KPA * bench.after_pa, MEASURED)],
        "settled flow [mL/s]": [(kind, flow, MEASURED), ("K sqrt(drop)", model, BEST)],
        "residual [mL/s]": [("model minus data", model - flow, BEST)],
        "stroke [mm]": [("piston", MM * bench.place_m, MODELS[1])],
    }
    plots = [plotted(title, lines, bench.time_s, kind, clocks) for title, lines in groups.items()]
    with Output("valve", path) as output:
        stream = output.stream
        clocks.send(output, lambda: None)
        view = _over(stream, bench)
        _log_bench(stream, bench)
        eye = rrb.EyeControls3D(position=(36, -105, 45), look_target=(36, 0, 0), eye_up=(0, 0, 1))
        solid = rrb.Spatial3DView(
            name=view_name("piston and valve", "mm", kind), origin="/bench", eye_controls=eye, line_grid=False
        )
        text = text_view(stream, _text(bench), bench.title, kind)
        send(stream, view_name(bench.title, "", kind), [view, solid, text], plots, float(bench.time_s[-1]))


def _over(stream: rr.RecordingStream, bench: Bench) -> rrb.Spatial2DView:
    """Draw the settled samples, flow over drop, and the curves K sqrt|drop| (thesis Fig 3.12)."""
    used = np.concatenate([np.arange(part.start, part.stop) for part in bench.run.parts])
    drop, flow = bench.run.drop_pa[used], bench.run.flow_m3_s[used]
    sheet = flow_sheet(stream, drop, flow)
    points = sheet.points(drop, flow)
    scatter(sheet, points, MEASURED)
    curves = [("fit", bench.fit.coefficient, BEST)]
    if bench.target is not None:
        curves.insert(0, ("target", bench.target, MODELS[1]))
    x = float(np.abs(drop).max()) * np.linspace(-1, 1, 301) * np.abs(np.linspace(-1, 1, 301))
    for number, (name, coefficient, colour) in enumerate(curves):
        line = sheet.points(x, coefficient * np.sign(x) * np.sqrt(np.abs(x)))
        width = rr.Radius.ui_points(3.0 - 1.8 * number)
        strip = rr.LineStrips2D([line], colors=colour, radii=width, draw_order=float(number))
        stream.log(f"{sheet.path}/curve/{name}", strip, static=True)
        label(sheet, (0.75 * sheet.x.length, -0.3 + 0.1 * number), f"{name}: K = {coefficient:.4g}", colour)
    sheet.mark(bench.time_s[used], points)
    return sheet_view(sheet, "settled flow over drop", bench.kind)


def _log_bench(stream: rr.RecordingStream, bench: Bench) -> None:
    """Draw the cylinder with its piston, which moves as recorded, and the fitted orifice as a hole of its area."""
    length, turn = MM * STROKE_M, np.linspace(0, 2 * np.pi, 49)
    circle = np.stack([0 * turn, np.cos(turn), np.sin(turn)], axis=-1)
    valve = np.array([length + PIPE_MM, 0.0, 0.0])
    rims = [RADIUS_MM * circle, RADIUS_MM * circle + np.array([length, 0, 0])]
    sides = [np.array([rims[0][k], rims[1][k]]) for k in range(0, 48, 6)]
    stream.log("/bench/cylinder", rr.LineStrips3D([*rims, *sides], colors=FRAME, radii=0.3), static=True)
    area_m2 = bench.fit.coefficient / (DISCHARGE * np.sqrt(2 / DENSITY_KG_M3))
    hole = MM * float(np.sqrt(area_m2 / np.pi))
    rings = [PLATE_MM * circle + valve, hole * circle + valve]
    stream.log("/bench/valve", rr.LineStrips3D(rings, colors=[FRAME, BEST], radii=0.35), static=True)
    places = [valve - np.array([0, 0, 1.4 * PLATE_MM]), np.array([0.0, 0.0, -1.4 * RADIUS_MM])]
    texts = [f"hole of {2 * hole:.2f} mm", f"bore {2 * RADIUS_MM:.1f} mm"]
    named = rr.Points3D(places, labels=texts, colors=[BEST, FRAME], radii=1e-9, show_labels=True)
    stream.log("/bench/names", named, static=True)
    along = np.array([PIPE_MM, 0.0, 0.0])
    pipe = [np.array([valve - along, valve]), np.array([valve, valve + along])]
    kept = np.unique(np.linspace(0, len(bench.time_s) - 1, MOST_FRAMES).astype(int))
    low, high = float(bench.before_pa[kept].min()), float(bench.before_pa[kept].max())
    for k in kept:
        stream.set_time(TIMELINE, duration=np.timedelta64(round(float(bench.time_s[k]) * 1e9), "ns"))
        x = MM * float(bench.place_m[k] - bench.place_m.min())
        disc = rr.Cylinders3D(
            lengths=[3.0],
            radii=[0.96 * RADIUS_MM],
            centers=[(x, 0, 0)],
            rotation_axis_angles=[rr.RotationAxisAngle(axis=(0, 1, 0), degrees=90)],
            colors=MODELS[1],
            fill_mode="solid",
        )
        stream.log("/bench/piston", disc)
        stream.log("/bench/rod", rr.LineStrips3D([[(x - 25, 0, 0), (x, 0, 0)]], colors=MODELS[1], radii=2.0))
        shares = [(float(one[k]) - low) / ((high - low) or 1.0) for one in (bench.before_pa, bench.after_pa)]
        stream.log("/bench/pipe", rr.LineStrips3D(pipe, colors=[_warm(share) for share in shares], radii=1.2))
    stream.reset_time()


def _warm(share: float) -> Colour:
    """Return a colour from blue (the lowest pressure before the valve) to red (the highest)."""
    mixed = np.array(MEASURED) + min(max(share, 0.0), 1.0) * (np.array(MODELS[2]) - np.array(MEASURED))
    return int(mixed[0]), int(mixed[1]), int(mixed[2])


def _text(bench: Bench) -> list[str]:
    fit = bench.fit
    low, high = fit.interval()
    lines = ["| K, m^3 Pa^-1/2 s^-1 | |", "|---|---:|", f"| fitted | {fit.coefficient:.4g} |"]
    lines += [f"| 95 % interval | {low:.4g} to {high:.4g} |"]
    if bench.target is not None:
        lines += [f"| target | {bench.target:.4g} ({100 * fit.deviation(bench.target):+.2f} %) |"]
        lines += [f"| set screw | {fit.advice(bench.target)} |"]
    lines += [
        "",
        f"- {fit.strokes} strokes, {fit.samples} samples; the first third of each is left out (thesis 3.1.1).",
    ]
    lines += ["- Published (Table 3.4): valve 2 fitted at 3.02e-7 for 3.05e-7, valve 3 at 4.26e-8 for 4.30e-8."]
    lines += ["- Piston as recorded; pipes blue to red by pressure; hole: a sharp one of the fitted K."]
    return lines
