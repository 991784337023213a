"""Arguments in, exit codes out: 0 done, 2 bad input (one sentence on stderr), 1 a fault of ours."""

import argparse
import json
import math
import os
import sys
import traceback
import warnings
from contextlib import suppress
from typing import Any, NoReturn

from data.errors import BadInput, CatheterError, RecordingCut

REPORTS = (
    *("regression", "hysteresis", "recordings", "damage"),
    *("derivatives", "selection", "identification", "sysid-recordings", "sysid-stability"),
)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise BadInput(self.prog, message, f"see {self.prog} --help")


def parser() -> argparse.ArgumentParser:
    """Return the argument parser of all commands."""
    root = _Parser(
        prog="catheter",
        description="Simulation-and-experiment toolkit for a hydraulic soft catheter robot.",
        epilog="Every command takes --json (for scripts) and --debug (a traceback for what goes wrong).",
    )
    commands = root.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def command(name: str, text: str) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=text, description=text)
        sub.add_argument("--json", action="store_true", help="print one JSON object instead of text")
        sub.add_argument("--debug", action="store_true", help="show a traceback when something goes wrong")
        return sub

    replay = command("replay", "show a recording: signals, hysteresis loops, models against measurement")
    replay.add_argument("recording", nargs="?", help="an MCAP file (default: the shipped, simulated bender recording)")
    replay.add_argument("--response", default="", metavar="TOPIC", help="the signal that models answer, as /force")
    replay.add_argument("--input", default="", metavar="TOPIC", help="the signal they answer to, as /markers:m1_x")
    replay.add_argument("--with", dest="others", action="append", default=[], metavar="TOPIC", help="a further signal")
    replay.add_argument("--split", choices=("half", "steps"), help="how data are held out")
    replay.add_argument("--out", metavar="FILE.rrd", help="where the dashboard goes (default: here, a free name)")
    replay.add_argument("--picture", metavar="FILE.png", help="also save a picture of the dashboard")
    replay.add_argument("--no-view", action="store_true", help="print the results only")
    replay.add_argument("--force", action="store_true", help="overwrite the outputs")

    check = command("check", "read all of a recording and say what is sound, what is lost, and where")
    check.add_argument("recording", help="an MCAP file")
    check.add_argument("--salvage", metavar="OUT.mcap", help="write what can be had to a new, sound recording")
    check.add_argument("--force", action="store_true", help="overwrite the output")

    importer = command("import", "turn a laboratory's text log into a recording")
    importer.add_argument("log", nargs="?", help="the log: comma, tab, semicolon or space separated")
    importer.add_argument("--mapping", metavar="NAME", help="a shipped mapping, or a .toml file")
    importer.add_argument("--out", metavar="FILE.mcap", help="the recording to write")
    importer.add_argument("--force", action="store_true", help="overwrite the output")
    importer.add_argument("--list", action="store_true", help="list the shipped mappings")

    record = command("record", "simulate a scene and record it, marked as simulated")
    record.add_argument("scene", help="a shipped scene (such as bender or chirp), or a .toml file")
    record.add_argument("--out", metavar="FILE.mcap", required=True, help="the recording to write")
    record.add_argument("--pwm", metavar="FILE.csv", help="also write time and PWM for the bench's Arduino")
    record.add_argument("--force", action="store_true", help="overwrite the output")

    fit = command("fit", "identify a model from a recording, with its uncertainty, as a small TOML")
    _fit_arguments(fit)

    report = command("report", "error against run time, as CSV, table and picture")
    report.add_argument("name", choices=REPORTS, help="which report")
    report.add_argument("--recording", metavar="FILE.mcap", help="for hysteresis: judge on this recording")
    report.add_argument("--out", metavar="FOLDER", default="out", help="the folder to write to (default: out)")
    report.add_argument("--force", action="store_true", help="overwrite an earlier report")
    report.add_argument("--quick", action="store_true", help="fewer levels, seconds instead of minutes")

    table = command("table", "print a table of the thesis, with units and source")
    table.add_argument("number", nargs="?", help="such as 3.3 (default: list them)")
    return root


def _fit_arguments(fit: argparse.ArgumentParser) -> None:
    fit.add_argument("recording", help="an MCAP file")
    models = ("bender", "accumulator", "valve", "cracking", "hysteresis")
    fit.add_argument("--model", required=True, choices=models, help="what was recorded")
    fit.add_argument("--out", metavar="FIT.toml", help="write the fit; scenes include it")
    fit.add_argument("--force", action="store_true", help="overwrite the output")
    fit.add_argument("--response", default="", metavar="TOPIC", help="bender, hysteresis: the signal that is modelled")
    fit.add_argument("--input", default="", metavar="TOPIC", help="bender, hysteresis: the signal it answers to")
    fit.add_argument("--rule", choices=("1 %", "AICc", "BIC"), default="1 %", help="bender: what picks the terms")
    fit.add_argument("--signed", action="store_true", help="bender: weights of any sign (default: none negative)")
    fit.add_argument("--resamples", type=int, default=400, help="bender: block-bootstrap resamples (default 400)")
    fit.add_argument("--view", metavar="FILE.rrd", help="bender: also write a dashboard for rerun")
    fit.add_argument("--validate", metavar="FILE.mcap", help="bender: judge the model on this recording too")
    fit.add_argument("--rest-volume", metavar="VOLUME", help="accumulator: such as '20 mL'")
    fit.add_argument("--target", metavar="K", help="valve: the coefficient wanted, '3.05e-7 m^3 Pa^-0.5 s^-1'")


def run(arguments: list[str]) -> int:
    """Run one command and return the exit code; never shows a traceback without --debug."""
    json_wanted, debug = "--json" in arguments, "--debug" in arguments
    try:
        return _run(parser().parse_args(arguments))
    except BrokenPipeError:  # the reader of our output, such as `head`, has left
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (Exception, KeyboardInterrupt) as error:
        text, code = _explain(error)
        with suppress(OSError, ValueError):  # nowhere to say it: the exit code must do
            if debug:
                traceback.print_exc()
            print(f"error: {text}", file=sys.stderr)
            if json_wanted:
                print(json.dumps({"error": text}), flush=True)
        return code


def _explain(error: BaseException) -> tuple[str, int]:
    """Return one sentence for an error, and the exit code it means."""
    match error:
        case CatheterError():
            return "; ".join([str(error), *getattr(error, "__notes__", [])]), 2
        case KeyboardInterrupt():
            return "interrupted", 130
        case MemoryError():
            return "not enough memory for this input", 2
        case OSError():
            return f"{error.filename or 'the operating system'}: {error.strerror or error}", 2
    return f"a fault of this program: {type(error).__name__}: {error}; see it with --debug", 1


def _run(options: argparse.Namespace) -> int:
    from catheter.lab import commands, fit_commands

    module = fit_commands if options.command == "fit" else commands
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RecordingCut)
        outcome = getattr(module, f"{options.command}_")(options)
    if options.json:
        print(json.dumps(_plain(outcome.values), indent=1, allow_nan=False))
    else:
        outcome.show()
    sys.stdout.flush()
    cuts = {str(warning.message) for warning in caught if issubclass(warning.category, RecordingCut)}
    for text in cuts:
        print(f"error: {text}; what came before the cut was used", file=sys.stderr)
    for warning in caught:
        if not issubclass(warning.category, RecordingCut):
            print(f"warning: {warning.message}", file=sys.stderr)
    return 2 if cuts else outcome.code


def _plain(value: Any) -> Any:
    """Return the value as JSON can hold it: a number that is not finite becomes null."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if isinstance(value, str | int | bool | type(None)) else str(value)
