"""The commands around recordings: replay, check, import, record."""

import argparse
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from catheter.lab.dashboard import quiet, take, where
from catheter.lab.loop_stages import LAST, STAGES
from catheter.lab.outcome import Outcome, progress, table
from data.errors import BadInput
from data.files import check_free, check_inputs, fresh, unused
from data.units import UNDOCUMENTED

if TYPE_CHECKING:
    from catheter.lab.replay import LoopFamily, Replay
    from catheter.lab.scene import Scene
    from data.recording import Recording

SHIPPED = Path(__file__).parents[2] / "data" / "recordings" / "bender.mcap"


def replay_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `replay`."""
    parser.add_argument("recording", nargs="?", help="an MCAP file (default: the shipped, simulated bender recording)")
    parser.add_argument("--response", default="", metavar="TOPIC", help="the signal that models answer, as /force")
    parser.add_argument("--input", default="", metavar="TOPIC", help="the signal they answer to, as /markers:m1_x")
    parser.add_argument("--with", dest="others", action="append", default=[], metavar="TOPIC", help="a further signal")
    parser.add_argument("--split", choices=("half", "steps"), help="how data are held out")
    parser.add_argument("--out", metavar="FILE.rrd", help="where the dashboard goes (default: here, a free name)")
    parser.add_argument("--picture", metavar="FILE.png", help="also save a picture of the dashboard")
    parser.add_argument("--no-view", action="store_true", help="print the results only")
    parser.add_argument("--force", action="store_true", help="overwrite the outputs")
    film = parser.add_argument_group("for a filmed, printed actuator (as data/recordings/twist.mcap)")
    film.add_argument("--until", choices=STAGES, default=LAST, help="the stage to stop after (default: the last)")
    film.add_argument("--again", metavar="FILE.mcap", help="the film of the actuator printed from the new design")
    film.add_argument("--print", metavar="DIR", help="map, print files and picture of the new design")
    film.set_defaults(scene=None)


def check_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `check`."""
    parser.add_argument("recording", help="an MCAP file")
    parser.add_argument("--salvage", metavar="OUT.mcap", help="write what can be had to a new, sound recording")
    parser.add_argument("--force", action="store_true", help="overwrite the output")


def import_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `import`."""
    parser.add_argument("log", nargs="?", help="the log: comma, tab, semicolon or space separated")
    parser.add_argument("--mapping", metavar="NAME", help="a shipped mapping, or a .toml file")
    parser.add_argument("--out", metavar="FILE.mcap", help="the recording to write")
    parser.add_argument("--force", action="store_true", help="overwrite the output")
    parser.add_argument("--list", action="store_true", help="list the shipped mappings")


def record_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `record`."""
    parser.add_argument("scene", help="a shipped scene (such as bender or chirp), or a .toml file")
    parser.add_argument("--out", metavar="FILE.mcap", required=True, help="the recording to write")
    parser.add_argument("--pwm", metavar="FILE.csv", help="also write time and PWM for the bench's Arduino")
    parser.add_argument("--map", metavar="MAP.toml", help="of a printed actuator: the voxels, instead of the scene's")
    parser.add_argument("--force", action="store_true", help="overwrite the output")


def replay_(options: argparse.Namespace) -> Outcome:
    """Replay a recording."""
    from catheter.lab.replay import Replay
    from data.recording import Recording

    source = SHIPPED if options.recording is None else Path(options.recording)
    out = Path(options.out) if options.out else unused(Path(f"{source.stem}.rrd"))
    picture = Path(options.picture) if options.picture else None
    if options.no_view and (options.out or picture):
        raise BadInput("--no-view", "given with --out or --picture", "leave one of them out")
    for path in () if options.no_view else filter(None, (out, picture)):
        check_inputs(path, source)
        check_free(path, options.force)
    if picture and picture.absolute() == out.absolute():
        raise BadInput("--picture", f"is {picture}, as --out", "name two files")
    with Recording(source) as recording:
        if _is_film(options, recording):
            from catheter.lab.redesign_command import replayed_film

            return replayed_film(options, source, out, picture)
        replayed = Replay(recording, _ask(options, recording))
        with progress("signals, loops, models") as advance:
            for done, stage in enumerate(("signals", "loops", "models"), start=1):
                getattr(replayed, stage)
                advance(done / 3)
        outcome = Outcome(replay_values(replayed))
        outcome.parts = list(replay_parts(replayed))
        if not options.no_view:
            _save_view(replayed, out, options.force)
            outcome.values |= {"view": str(out), "picture": None}
            outcome.parts.append(where(out))
            if picture:
                take(outcome, out, picture, force=options.force)
    return outcome


def _is_film(options: argparse.Namespace, recording: "Recording") -> bool:
    """Return whether a recording is the film of a printed actuator, and nobody asks for other signals of it.

    Raises BadInput for options that only such a film has an answer to.
    """
    from catheter.lab.scene import Scene
    from catheter.printed_bench import TOPICS

    asked = bool(options.response or options.input or options.others or options.split)
    found = False
    if not asked and set(TOPICS) <= recording.channels.keys() and recording.scene:
        with suppress(BadInput):  # of a scene that cannot be read, the other replay says what is wrong
            found = {"tube", "map"} <= Scene.parse(recording.scene, str(recording.path)).tables.keys()
    if not found and (options.again or options.print or options.until != LAST):
        what = f"{recording.path.name} is replayed as signals"
        raise BadInput("--again, --print, --until", what, "they are for the film of a printed actuator")
    return found


def _ask(options: argparse.Namespace, recording: Any) -> Any:
    """Return the questions on the command line, those of the recording where it names none."""
    from dataclasses import replace

    from catheter.lab.replay import recorded_ask

    given = {"response": options.response, "input": options.input, "others": tuple(options.others)}
    given = {key: value for key, value in (given | {"split": options.split}).items() if value}
    if not given:
        return None
    asked = replace(recorded_ask(recording), **given)
    if options.others:
        return asked
    return replace(asked, others=tuple(name for name in asked.others if name not in (asked.response, asked.input)))


def _save_view(replayed: "Replay", out: Path, force: bool) -> None:
    quiet()
    from catheter.lab.views import replay as view

    with fresh(out, force) as temporary, progress("dashboard") as advance:
        view.save(replayed, temporary, progress=advance)


def replay_values(replayed: "Replay") -> dict[str, Any]:
    """Return what a replay found, for scripts."""
    recording, ask = replayed.recording, replayed.ask
    return {
        "recording": str(recording.path),
        "title": replayed.title,
        "kind": recording.kind,
        "duration_s": recording.duration_s,
        "cut": recording.cut,
        "signals": {
            label: {"unit": s.unit if s.documented else UNDOCUMENTED, "samples": len(s)}
            for label, s in replayed.signals.items()
        },
        "cameras": replayed.cameras,
        "response": ask.response,
        "input": ask.input,
        "others": list(ask.others),
        "loops": [
            {"x": f.x.name, "y": f.y.name, "unit": _area_si(f), "loops": [vars(loop) for loop in f.loops]}
            for f in replayed.loops
        ],
        "models": [
            {
                "name": fit.model.name,
                "parameters": fit.parameters,
                "active": fit.active,
                "fit_percent": fit.fit_percent,
                "rmse": fit.rmse,
                "held_out_fit_percent": fit.held_out_fit_percent,
                "held_out_rmse": fit.held_out_rmse,
                "split": fit.split,
                "extrapolated": fit.extrapolated,
                "condition": fit.condition,
                "seconds": fit.seconds,
                "weights": dict(zip((t.name for t in fit.model.terms), fit.weights.tolist(), strict=True)),
            }
            for fit in replayed.models
        ],
        "left_out": replayed.left_out,
    }


def _area_si(family: "LoopFamily") -> str:
    return family.unit if family.x.documented and family.y.documented else UNDOCUMENTED


def replay_parts(replayed: "Replay") -> Iterator[Any]:
    """Yield what a replay found, for people."""
    from catheter.lab.display import area_unit, shown_unit

    recording = replayed.recording
    yield f"{replayed.title}: {recording.path.name}, {recording.duration_s:.1f} s"
    topics = ", ".join(f"{name} ({len(signal)})" for name, signal in replayed.signals.items())
    yield f"Signals (samples): {topics or 'none'}"
    for family in replayed.loops:
        if family.loops:
            unit, factor = area_unit(family)
            areas = sorted(loop.area * factor for loop in family.loops)
            yield (
                f"Loops of {family.y.name} over {family.x.name}: {len(areas)}, "
                f"area {areas[0]:.4g} to {areas[-1]:.4g} {unit}"
            )
    fits = replayed.models
    if fits:
        signal = replayed.signals[replayed.ask.response]
        unit, factor = shown_unit(signal)
        unit = unit if signal.documented else "an undocumented unit"
        rows = [
            [
                fit.model.name,
                f"{fit.active}/{fit.parameters}",
                f"{fit.fit_percent:.1f}",
                f"{fit.rmse * factor:.4g}",
                f"{fit.held_out_rmse * factor:.4g}",
                f"{1e3 * fit.seconds:.1f}",
            ]
            for fit in fits
        ]
        header = ["model", "weights", "fit %", "RMSE", "RMSE held out", "ms"]
        yield table(header, rows, f"{signal.name} from {replayed.ask.input}, RMSE in {unit}; {fits[0].split}")
        yield "weights: not zero/all. fit % and RMSE: all samples. ms: regressors and both fits."
        far = max(fit.extrapolated for fit in fits)
        if far > 0.1:
            yield f"Up to {100 * far:.0f} % of the held-out samples are unlike the fitted ones: that is extrapolation."
    for text in replayed.left_out:
        yield f"Left out: {text}"


def check_(options: argparse.Namespace) -> Outcome:
    """Read all of a recording; exit code 2 when something is wrong."""
    from data.inspection import inspect
    from data.salvage import salvage

    path = Path(options.recording)
    with progress("reading") as advance:
        if options.salvage:
            found = salvage(path, Path(options.salvage), replace=options.force, progress=advance)
        else:
            found = inspect(path, progress=advance)
    values = {
        "recording": str(path),
        "sound": found.sound,
        "chunks": found.chunks,
        "messages": found.messages,
        "unverified_messages": found.unverified_messages,
        "unverifiable": found.unverifiable,
        "findings": [{"byte": finding.offset, "what": finding.what} for finding in found.findings],
        "salvaged": options.salvage,
    }
    what = "sound" if found.sound else "damaged"
    parts = [f"{path}: {what}", f"{found.chunks} sound chunks, {found.messages} messages, every checksum right"]
    parts += [f"  byte {finding.offset}: {finding.what}" for finding in found.findings]
    if found.unverifiable:
        parts.append(f"Not verifiable: {found.unverifiable}")
    if options.salvage:
        parts.append(f"{options.salvage} written: every message that could be had")
    return Outcome(values, parts, code=0 if found.sound else 2)


def import_(options: argparse.Namespace) -> Outcome:
    """Import a text log."""
    from data.csv_import import import_log
    from data.mapping import load, names

    if options.list:
        rows = [[name, load(name).source.title, load(name).source.licence] for name in names()]
        return Outcome({"mappings": names()}, [table(["mapping", "what", "licence of the log"], rows, words=3)])
    if not (options.log and options.mapping and options.out):
        raise BadInput("import", "needs LOG, --mapping and --out", "list the shipped mappings with --list")
    out = Path(options.out)
    check_inputs(out, Path(options.mapping))
    with progress("importing") as advance:
        repairs = import_log(Path(options.log), load(options.mapping), out, replace=options.force, progress=advance)
    return Outcome(
        {"recording": str(out), "repairs": repairs},
        [f"{out} written (measured)", *(f"  {text}" for text in repairs)],
    )


def record_(options: argparse.Namespace) -> Outcome:
    """Simulate and record a scene."""
    from catheter.lab.record import record, with_map
    from catheter.lab.scene import Scene

    out = Path(options.out)
    check_inputs(out, Path(options.scene))
    scene = Scene.load(options.scene)
    if options.map:
        scene = with_map(scene, options.map)
    parts = [_pwm(scene, Path(options.pwm), options.force)] if options.pwm else []
    run = record(scene, out, overwrite=options.force)
    return Outcome(
        {"recording": str(out), "kind": "simulated", "samples": len(run.time_s), "pwm": options.pwm},
        [f"{out} written (simulated): {len(run.time_s)} samples, {run.time_s[-1]:.1f} s", *parts],
    )


def _pwm(scene: "Scene", path: Path, force: bool) -> str:
    from sysid.excitation import Excitation, write_pwm_csv

    drive = scene.tables.get("drive")
    if not isinstance(drive, Excitation):
        raise BadInput("--pwm", f"a {scene.heading.kind} scene has no voltage signal", "name a chirp, ramp or the like")
    rows = write_pwm_csv(path, drive, rate_hz=scene.tables["sensors"].rate, replace=force)
    return f"{path} written: {rows} rows of time and PWM"
