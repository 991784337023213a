"""The command line: `python -m catheter`, and the `catheter` command."""

import sys  # the rest is imported where an interruption is already answered without a traceback

PACKAGES = ("data", "sysid", "vision", "fem")


def namesakes() -> list[str]:
    """Return a sentence for each of our packages that Python would take from somewhere else.

    Their names are common: a folder in the user's directory, or a package from an index, can hide
    them. Uses the standard library only, because nothing of ours can be imported before.
    """
    import importlib.util
    from pathlib import Path

    home = Path(__file__).resolve().parents[1]
    found = []
    for name in PACKAGES:
        spec = importlib.util.find_spec(name)
        origin = Path(spec.origin).resolve() if spec and spec.origin else None
        if origin != home / name / "__init__.py":
            what = origin or (list(spec.submodule_search_locations or []) if spec else "nothing")
            found.append(f"the package '{name}' must come from {home / name}, but Python finds {what}")
    return found


def _terminated(number: int, _: object) -> None:
    """End as after an error, so that unfinished outputs are removed; whoever asks twice must not disturb that."""
    import signal

    signal.signal(number, signal.SIG_IGN)  # `timeout` asks twice
    sys.exit(128 + number)


def _swallowed(ignored: "sys.UnraisableHookArgs") -> None:
    """Ask again for an end that came inside a callback, where Python prints an exception and goes on."""
    if not isinstance(ignored.exc_value, KeyboardInterrupt | SystemExit):
        sys.__unraisablehook__(ignored)
        return
    import signal
    import threading
    from contextlib import suppress

    _answer_signals()
    main = threading.main_thread().ident
    number = signal.SIGINT if isinstance(ignored.exc_value, KeyboardInterrupt) else signal.SIGTERM
    again = threading.Timer(0.02, signal.pthread_kill, [main, number])  # not at once: the callback has not returned yet
    again.daemon = True
    with suppress(RuntimeError):  # too late for a thread: we are ending
        again.start()


def _answer_signals() -> None:
    import signal
    from contextlib import suppress

    with suppress(ValueError):  # not in the main thread: whoever runs us there answers signals
        signal.signal(signal.SIGTERM, _terminated)
        if hasattr(signal, "pthread_kill"):  # not on Windows
            sys.unraisablehook = _swallowed


def _run() -> int:
    import os
    from pathlib import Path

    hidden = namesakes()
    if hidden:
        print(f"error: {'; '.join(hidden)}; rename or uninstall that, or run from another folder", file=sys.stderr)
        return 2
    sys.stderr = sys.stderr or Path(os.devnull).open("w")  # noqa: SIM115, as long as we run
    sys.stdout = sys.stdout or Path(os.devnull).open("w")  # noqa: SIM115, as long as we run
    _answer_signals()
    from catheter.lab.cli import run

    return run(sys.argv[1:])


def main() -> int:
    """Run the command line and return its exit code."""
    try:
        return _run()
    except KeyboardInterrupt:  # before the command line can answer
        return 130


if __name__ == "__main__":
    sys.exit(main())
