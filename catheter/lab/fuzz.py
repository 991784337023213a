"""How commands stand hostile inputs: thousands, in watched processes. No traceback, no hang, nothing astray."""

import contextlib
import io
import itertools
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, Queue
from typing import Any

import numpy as np

from catheter.lab.fuzz_inputs import FUZZED
from catheter.lab.report import Progress, Report, Row

MOST_S = 30.0  # of work for one input: longer is a hang, however busy the machine is
WAIT_S = 300.0  # for an answer: longer is a hang that waits instead of working
AT_ONCE = 300  # inputs for one process: rerun keeps two threads for each blueprint that it ever sent
MOST_BYTES = 6 << 30  # of address space, where the operating system can limit it
WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
MAKES = ("os.rename", "os.link", "os.symlink", "os.mkdir", "os.remove", "os.rmdir")
_WORKER = "import sys; from catheter.lab.fuzz import work; work(*sys.argv[1:])"


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One input that did what no input may: its kind and number, which make it again, and what it did."""

    kind: str
    number: int
    what: str


Ended = tuple[int, float, Finding | None]  # exit code, seconds, what was wrong


def fuzz(*, quick: bool, progress: Progress) -> Report:
    """Give commands seeded hostile inputs: 450, or 13,500."""
    count = (450 if quick else 13_500) // len(FUZZED)
    rows, notes = [], []
    ended = _answers(count, progress)
    for kind, answers in ended.items():
        codes = Counter(code for code, _, _ in answers)
        found = [finding for _, _, finding in answers if finding]
        seconds = [seconds for _, seconds, _ in answers]
        rows.append(Row(method=kind, level=f"{len(answers)}", error=float(len(found)), seconds=sum(seconds)))
        ends = ", ".join(f"{number} with {code}" for code, number in sorted(codes.items()))
        notes.append(f"{kind}: exit codes {ends}; slowest {max(seconds):.2f} s.")
        notes += [f"{kind} {one.number}: {one.what}" for one in found[:20]]
    return Report(
        name="fuzz",
        title="Hostile inputs: tracebacks, hangs, and files outside the output folder",
        level="inputs",
        error="findings",
        rows=rows,
        notes=notes,
    )


def _answers(count: int, progress: Progress) -> dict[str, list[Ended]]:
    """Return what became of `count` inputs of each kind; as many processes at once as there are cores."""
    parts = [(kind, first, min(AT_ONCE, count - first)) for kind in FUZZED for first in range(0, count, AT_ONCE)]
    stopped, done = threading.Event(), itertools.count(1)

    def answered(kind: str, first: int, many: int) -> list[Ended]:
        found = []
        for one in run_kind(kind, many, first):
            if stopped.is_set():
                break
            found.append(one)
            progress(next(done) / (count * len(FUZZED)))
        return found

    ended: dict[str, list[Ended]] = {kind: [] for kind in FUZZED}
    pool = ThreadPoolExecutor(os.cpu_count() or 1)
    try:
        pending = {pool.submit(answered, *part): part[0] for part in parts}
        for part in as_completed(pending):
            ended[pending[part]] += part.result()
    finally:
        stopped.set()
        pool.shutdown(cancel_futures=True)
    return ended


def run_kind(kind: str, count: int, first: int = 0) -> Iterator[Ended]:
    """Give inputs first .. first + count - 1 of a kind to a watched process; yield exit code, seconds, finding of each.

    A process that dies or does not answer is a finding, and another one goes on behind it.
    """
    at, end = first, first + count
    while at < end:
        stop = min(end, at + AT_ONCE)
        with _worker(kind, at, stop) as answers:
            while at < stop:
                try:
                    line = answers.get(timeout=WAIT_S)
                except Empty:
                    yield -1, WAIT_S, Finding(kind=kind, number=at, what=f"no answer within {WAIT_S:g} s")
                    at += 1
                    break
                if line is None:
                    yield -1, MOST_S, Finding(kind=kind, number=at, what=f"died, or worked for {MOST_S:g} s")
                    at += 1
                    break
                told = json.loads(line)
                what = told["what"]
                yield told["code"], told["seconds"], Finding(kind=kind, number=at, what=what) if what else None
                at += 1


@contextlib.contextmanager
def _worker(kind: str, first: int, end: int) -> Iterator["Queue[str | None]"]:
    """Run a worker; yields its answers, None after the last."""
    answers: Queue[str | None] = Queue()
    with tempfile.TemporaryDirectory(prefix="catheter-fuzz-") as folder:
        command = [sys.executable, "-c", _WORKER, folder, kind, str(first), str(end)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
            assert process.stdout is not None
            lines = process.stdout

            def listen() -> None:
                for line in lines:
                    answers.put(line)
                answers.put(None)

            listener = threading.Thread(target=listen, daemon=True)
            listener.start()
            try:
                yield answers
            finally:
                process.kill()
                listener.join()


def work(folder: str, kind: str, first: str, end: str) -> None:
    """Answer for inputs first .. end - 1, a line of JSON each: exit code, seconds, and what was wrong or ""."""
    _limit()
    place = Path(folder).resolve()
    astray = _watch(place)
    answer = os.fdopen(os.dup(1), "w")
    for number in range(int(first), int(end)):
        home = place / "home"
        os.chdir(place)
        shutil.rmtree(home, ignore_errors=True)
        for name in ("in", "out", "here"):
            (home / name).mkdir(parents=True)
        draw = np.random.default_rng([list(FUZZED).index(kind), number])
        arguments = FUZZED[kind](draw, home)
        os.chdir(home / "here")
        before = _listing(home)
        astray.clear()
        _alarm(MOST_S)
        started = time.perf_counter()
        code, what = _run(arguments)
        seconds = time.perf_counter() - started
        wrong = [what] if what else []
        wrong += [f"touched {path}" for path in astray]
        wrong += [f"left {path}" for path in sorted(_listing(home) - before)]
        print(json.dumps({"code": code, "seconds": seconds, "what": "; ".join(wrong)[:400]}), file=answer, flush=True)


def _run(arguments: list[str]) -> tuple[int, str]:
    """Run one command; return its exit code and what is wrong with how it ended."""
    from catheter.lab import cli

    told, said = io.StringIO(), io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(told):
            code = cli.run(arguments)
    except BaseException as error:  # nothing may pass the command line: not even an exit
        return -1, f"{arguments[0]}: {type(error).__name__}: {error}"
    text = told.getvalue()
    if code not in (0, 2):
        return code, f"{arguments[0]}: exit code {code}: {text.strip()[-200:]}"
    if "Traceback" in text or any(ord(one) < 32 and one != "\n" for one in text + said.getvalue()):
        return code, f"{arguments[0]}: printed a traceback or control characters: {text[-200:]!r}"
    if code == 2 and not (text + said.getvalue()).strip():
        return code, f"{arguments[0]}: exit code 2 without a word"
    return code, ""


def _listing(home: Path) -> set[str]:
    """Return what is there outside the output folder."""
    return {str(path.relative_to(home)) for path in home.rglob("*") if home / "out" not in path.parents}


def _watch(place: Path) -> list[str]:
    """Return a list to which Python adds every path that is opened for writing, made or removed outside `place`."""
    astray: list[str] = []
    allowed = (str(place), "/dev/", "/proc/self")

    def hook(event: str, given: tuple[Any, ...]) -> None:
        if event == "open":
            path, _, flags = given
            if isinstance(path, str | bytes) and flags & WRITES:
                note(path)
        elif event in MAKES:
            for path in given:
                if isinstance(path, str | bytes | os.PathLike):
                    note(path)

    def note(path: "str | bytes | os.PathLike[Any]") -> None:
        full = os.path.realpath(os.fsdecode(path))
        if (
            not full.startswith(allowed) and "__pycache__" not in full
        ):  # compiled code is Python's and numba's own cache
            astray.append(full)

    sys.addaudithook(hook)
    return astray


def _alarm(seconds: float) -> None:
    """End this process when it has worked for so long, where the operating system counts that."""
    import signal

    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_PROF, seconds)


def _limit() -> None:
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
