"""The command line: `python -m catheter`, and the `catheter` command."""

import importlib.util
import os
import signal
import sys
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

PACKAGES = ("data", "sysid", "vision", "fem")


def namesakes() -> list[str]:
    """Return a sentence for each of our packages that Python would take from somewhere else.

    Their names are common: a folder in the user's directory, or a package from an index, can hide
    them. Uses the standard library only, because nothing of ours can be imported before.
    """
    home = Path(__file__).resolve().parents[1]
    found = []
    for name in PACKAGES:
        spec = importlib.util.find_spec(name)
        origin = Path(spec.origin).resolve() if spec and spec.origin else None
        if origin != home / name / "__init__.py":
            what = origin or (list(spec.submodule_search_locations or []) if spec else "nothing")
            found.append(f"the package '{name}' must come from {home / name}, but Python finds {what}")
    return found


def _terminated(*_: object) -> NoReturn:
    """End as after an error, so that unfinished outputs are removed."""
    sys.exit(128 + signal.SIGTERM)


def main() -> int:
    """Run the command line and return its exit code."""
    hidden = namesakes()
    if hidden:
        print(f"error: {'; '.join(hidden)}; rename or uninstall that, or run from another folder", file=sys.stderr)
        return 2
    sys.stderr = sys.stderr or Path(os.devnull).open("w")  # noqa: SIM115, as long as we run
    sys.stdout = sys.stdout or Path(os.devnull).open("w")  # noqa: SIM115, as long as we run
    with suppress(ValueError):  # not in the main thread: whoever runs us there answers signals
        signal.signal(signal.SIGTERM, _terminated)
    try:
        from catheter.lab.cli import run

        return run(sys.argv[1:])
    except KeyboardInterrupt:  # while importing, before the command line can answer
        return 130


if __name__ == "__main__":
    sys.exit(main())
