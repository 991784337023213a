"""`python -m catheter fit`: a recording in, a certified model out, printed and as a small TOML."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from catheter.lab.dashboard import check_view, save_view, view_options
from catheter.lab.fit_bender import Fitted, bender, replayed
from catheter.lab.fit_material import check_material, fit_tests, material_options
from catheter.lab.fit_valve import cracking, valve
from catheter.lab.outcome import Outcome, progress, table
from data.errors import BadInput
from data.files import check_free, check_inputs, fresh
from data.options import to_toml
from data.recording import UNSTATED, Recording


def fit_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `fit`."""
    parser.add_argument("recording", metavar="FILE", help="an MCAP file; for a material a table (.csv)")
    models = ("bender", "accumulator", "valve", "cracking", "hysteresis", "material")
    parser.add_argument("--model", required=True, choices=models, help="what was recorded")
    parser.add_argument("--out", metavar="FIT.toml", help="write the fit; scenes include it")
    parser.add_argument("--force", action="store_true", help="overwrite the output")
    parser.add_argument(
        "--response", default="", metavar="TOPIC", help="bender, hysteresis: the signal that is modelled"
    )
    parser.add_argument("--input", default="", metavar="TOPIC", help="bender, hysteresis: the signal it answers to")
    parser.add_argument("--rule", choices=("1 %", "AICc", "BIC"), default="1 %", help="bender: what picks the terms")
    parser.add_argument("--signed", action="store_true", help="bender: weights of any sign (default: none negative)")
    parser.add_argument("--resamples", type=int, default=400, help="bender, material: resamples (default 400)")
    view_options(parser, "bender, valve, cracking")
    parser.add_argument("--validate", metavar="FILE.mcap", help="bender: judge the model on this recording too")
    parser.add_argument("--rest-volume", metavar="VOLUME", help="accumulator: such as '20 mL'")
    parser.add_argument("--target", metavar="K", help="valve: the coefficient wanted, '3.05e-7 m^3 Pa^-0.5 s^-1'")
    material_options(parser)


def fit_(options: argparse.Namespace) -> Outcome:
    """Fit a model to a recording."""
    source = Path(options.recording)
    out = Path(options.out) if options.out else None
    if out:
        check_inputs(out, source)
        check_free(out, options.force)
    drawn = check_view(options, source)
    check_material(options)
    if drawn and options.model not in DRAWN:
        raise BadInput(
            f"a {options.model} model", "has no dashboard", f"replay the recording, or fit {' or '.join(DRAWN)}"
        )
    if options.model == "material":
        kind = options.origin or UNSTATED
        fitted = fit_tests(source, kind, options)
    else:
        with Recording(source) as recording, progress("fitting"):
            fitted, kind = MODELS[options.model](recording, options), recording.kind
    origin = {"model": options.model, "recording": source.name, "kind": kind}
    tables = {"fit": origin | fitted.tables.pop("fit", {}), **fitted.tables}
    parts = [f"{options.model} model of {source} ({origin['kind']})", *fitted.parts]
    if out:
        with fresh(out, options.force) as temporary:
            temporary.write_text(to_toml(tables), encoding="utf-8")
        how = f'a tube scene names it: soft = "{out}"' if options.model == "material" else f'include = ["{out.name}"]'
        parts.append(f"{out} written; a scene reads it with: {how}")
    outcome = Outcome({**origin, "out": str(out) if out else None, **fitted.values, "toml": tables}, parts)
    if drawn and options.model != "material":
        if fitted.dashboard is None:
            raise BadInput(source, "is too long for a dashboard", "fit a window of it, or leave --view out")
        save_view(outcome, options, fitted.dashboard)
    return outcome


def accumulator(recording: Recording, options: argparse.Namespace) -> Fitted:
    """Pressure over the volume ratio; --rest-volume makes the ratio where the recording has none."""
    from data.units import quantity
    from sysid.accumulator import fit_accumulator

    pressure = recording.signal("/pressure")
    if "ratio" in recording.channels["/volume"].topic.components:
        ratio = recording.signal("/volume", "ratio").at(pressure.time_s)
    elif options.rest_volume:
        rest = quantity(options.rest_volume, "m^3", "--rest-volume")
        ratio = 1 + recording.signal("/volume", "volume").at(pressure.time_s) / rest
    else:
        raise BadInput(recording.path, "has no volume ratio", "give --rest-volume '20 mL'")
    sound = np.isfinite(ratio) & np.isfinite(pressure.value)
    found = fit_accumulator(ratio[sound], pressure.value[sound])
    pairs = zip(found.coefficients, found.standard_errors, strict=True)
    rows = [[f"c{n}", f"{c / 1e5:.5g}", f"{e / 1e5:.2g}"] for n, (c, e) in enumerate(pairs, start=1)]
    parts = [
        f"P = sum c_n (V - 1)^n, order {found.order} by the 2.5 % rule",
        table(["coefficient", "bar", "std. error"], rows),
        f"RMSE {found.rmse_pa:.4g} Pa over V = {found.range[0]:.3f} .. {found.range[1]:.3f}; "
        f"dP/dV > 0 for V = {found.rising[0]:.4f} .. {found.rising[1]:.4f}",
    ]  # fmt: skip
    values = {
        "order": found.order, "coefficients_pa": found.coefficients.tolist(), "rmse_pa": found.rmse_pa,
        "standard_errors_pa": found.standard_errors.tolist(), "rising": found.rising, "range": found.range,
        "residuals_pa": found.residuals.tolist(), "conditions": found.conditions.tolist(),
    }  # fmt: skip
    told = {"rmse": f"{found.rmse_pa!r} Pa", "rising": list(found.rising), "range": list(found.range),
            "standard_errors": [f"{e!r} Pa" for e in found.standard_errors.tolist()]}  # fmt: skip
    coefficients = [f"{c!r} Pa" for c in found.coefficients.tolist()]
    return Fitted(values, parts, {"fit": told, "accumulator": {"coefficients": coefficients}})


def hysteresis(recording: Recording, options: argparse.Namespace) -> Fitted:
    """Loops, relaxation, and models with and without memory, on the same data."""
    from catheter.lab.recording_commands import replay_parts, replay_values
    from sysid.fit import SPLITS, TWO_BRANCHES, compare
    from sysid.relaxation import dwells

    replay = replayed(recording, options)
    best = replay.best
    if best is None:
        raise BadInput(recording.path, "; ".join(replay.left_out) or "has no response and input", "name other signals")
    values, parts = replay_values(replay), list(replay_parts(replay))
    experiment = replay.experiment
    assert experiment is not None
    apart = compare([TWO_BRANCHES], experiment, SPLITS[replay.ask.split](experiment))[0]
    values["two_branches"] = {
        "rmse": apart.rmse,
        "held_out_rmse": apart.held_out_rmse,
        "fit_percent": apart.fit_percent,
    }
    parts.append(
        f"Separate inflating and deflating cubics: fit {apart.fit_percent:.1f} %, RMSE {apart.rmse:.4g}, held out "
        f"{apart.held_out_rmse:.4g} (SI)"
    )
    found = dwells(experiment.time_s, experiment.input, experiment.response)
    values["relaxation"] = [vars(one) for one in found]
    if found:
        middle = np.median([one.time_constant_s for one in found])
        parts.append(f"Relaxation at constant {experiment.input_name}: {len(found)} dwells, median {middle:.3g} s")
    weights = dict(zip((term.name for term in best.model.terms), best.weights.tolist(), strict=True))
    told: dict[str, Any] = {"best": best.model.name, "held_out_rmse": best.held_out_rmse, "split": best.split}
    return Fitted(values, parts, {"fit": told, "weights": {f'"{k}"': v for k, v in weights.items()}})


MODELS = {
    "bender": bender,
    "accumulator": accumulator,
    "valve": valve,
    "cracking": cracking,
    "hysteresis": hysteresis,
}
DRAWN = ("bender", "valve", "cracking", "material")
