"""Arguments in, exit codes out: 0 done, 2 bad input (one sentence on stderr), 1 a fault of ours."""

import argparse
import json
import math
import os
import sys
import traceback
import warnings
from contextlib import suppress
from importlib import import_module
from typing import Any, NoReturn

from catheter.lab.outcome import printable
from data.errors import BadInput, CatheterError, RecordingCut

COMMANDS = {  # what each is for, and the module that does it: NAME_options(parser) and NAME_(options)
    "free": ("search the fibre angles of a spiral (default: the thesis's task)", "design"),
    "valve": ("list the conical valves, interpolate one, or choose one", "design"),
    "twist": ("twist from a video, a folder of pictures or a recording's camera", "twist_command"),
    "run": ("run a scene of the robot: events, objective and stroke beside the published values", "circuit_commands"),
    "tune": ("find the best valves: the thesis's map, and the optimum next to its best cell", "circuit_commands"),
    "inflate": ("inflate a printed tube of two materials: twist, extension, bending, stability", "inflate_command"),
    "twin": ("drive a printed tube's model by a recorded pressure: twist beside the measured one", "twin_command"),
    "redesign": ("from a filmed actuator to its materials, a better design and print files", "redesign_command"),
    "shape": ("shape an actuator to a vessel: balloon, bend, twist, spiral, exactly incompressible", "shape_commands"),
    "print": ("write a voxel map for a printer: STL per material, 3MF, slices, each read back", "shape_commands"),
    "invert": ("find a material map from a wanted motion, or constants from a recording", "invert_command"),
    "fmu": ("write the robot's hydraulic circuit as an FMU for other tools, and try it", "fmu_command"),
    "record": ("simulate a scene and record it, marked as simulated", "recording_commands"),
    "import": ("turn a laboratory's text log into a recording", "recording_commands"),
    "check": ("read all of a recording and say what is sound, what is lost, and where", "recording_commands"),
    "replay": ("show a recording: signals, hysteresis loops, models against measurement", "recording_commands"),
    "fit": ("identify a model from a recording, with its uncertainty, as a small TOML", "fit_commands"),
    "report": ("error against run time, as CSV, table and picture", "report_commands"),
    "table": ("print a table of the thesis, with units and source", "report_commands"),
}


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise BadInput(self.prog, message, f"see {self.prog} --help")


def parser(chosen: str = "") -> argparse.ArgumentParser:
    """Return the parser of the command line: every command, but only the chosen one's module and options."""
    root = _Parser(
        prog="catheter",
        description="Simulation-and-experiment toolkit for a hydraulic soft catheter robot.",
        epilog="Every command takes --json (for scripts) and --debug (a traceback for what goes wrong).",
    )
    commands = root.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (text, module_name) in COMMANDS.items():
        sub = commands.add_parser(name, help=text, description=text)
        sub.add_argument("--json", action="store_true", help="print one JSON object instead of text")
        sub.add_argument("--debug", action="store_true", help="show a traceback when something goes wrong")
        if name == chosen:
            module = import_module(f"catheter.lab.{module_name}")
            getattr(module, f"{name}_options")(sub)
            sub.set_defaults(work=getattr(module, f"{name}_"))
    return root


def run(arguments: list[str]) -> int:
    """Run one command and return the exit code; never shows a traceback without --debug."""
    json_wanted, debug = "--json" in arguments, "--debug" in arguments
    try:
        chosen = next((word for word in arguments if word in COMMANDS), "")
        return _run(parser(chosen).parse_args(arguments))
    except BrokenPipeError:  # the reader of our output, such as `head`, has left
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (Exception, KeyboardInterrupt) as error:
        text, code = _explain(error)
        with suppress(OSError, ValueError):  # nowhere to say it: the exit code must do
            if debug:
                traceback.print_exc()
            print(f"error: {printable(text)}", file=sys.stderr)
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
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RecordingCut)
        outcome = options.work(options)
    if options.json:
        print(json.dumps(_plain(outcome.values), indent=1, allow_nan=False))
    else:
        outcome.show()
    sys.stdout.flush()
    cuts = {str(warning.message) for warning in caught if issubclass(warning.category, RecordingCut)}
    for text in cuts:
        print(f"error: {printable(text)}; what came before the cut was used", file=sys.stderr)
    for warning in caught:
        if not issubclass(warning.category, RecordingCut):
            print(f"warning: {printable(str(warning.message))}", file=sys.stderr)
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
