"""Many inverse problems: the same body with other targets, seeds and noises, here or wherever an executor computes."""

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, fields, replace
from itertools import product
from typing import Any

from catheter.inflatable import Pattern, Shape
from catheter.reconstruction import Case, Cube, Quality, Wanted, cube_case, solved, tube_case
from data.errors import BadInput, CatheterError, nearest
from data.options import read
from fem.inverse import Inversion

MOST = 10_000  # runs


@dataclass(frozen=True, kw_only=True)
class Job:
    """An inverse problem before it is simulated: options alone, so that it travels to another process or machine."""

    body: Shape | Cube
    pattern: Pattern = field(default_factory=Pattern)
    wanted: Wanted
    inversion: Inversion = field(default_factory=Inversion)

    def case(self) -> Case:
        """Return the problem, its data simulated. Raises BadInput, DidNotConverge as `tube_case`."""
        if isinstance(self.body, Cube):
            return cube_case(self.body, self.wanted)
        return tube_case(self.body, self.pattern, self.wanted)


@dataclass(frozen=True, kw_only=True)
class Run:
    """How a job ended: errors of its map beside the truth, iterations and wall time [s], or why there is no map."""

    wanted: Wanted
    quality: Quality
    misfit: float
    iterations: int
    seconds: float
    ended: str
    failed: str = ""


def sought(job: Job) -> Run:
    """Return how a job ends: what an executor maps over jobs. A refusal is a run that failed."""
    nan = float("nan")
    try:
        case = job.case()
        found = solved(case, job.inversion)
    except CatheterError as error:
        none = Quality(nan, nan, nan)
        return Run(
            wanted=job.wanted, quality=none, misfit=nan, iterations=0, seconds=nan, ended="refused", failed=str(error)
        )
    return Run(
        wanted=job.wanted,
        quality=Quality.of(found.moduli, case.truth),
        misfit=found.misfit,
        iterations=found.history[-1].number,
        seconds=found.seconds,
        ended=found.why,
    )


def sweep(jobs: Sequence[Job], executor: Executor | None = None) -> Iterator[Run]:
    """Yield how each job ends, in their order, as they end; all of them are handed over before the first is asked for.

    executor: any of concurrent.futures, such as ProcessPoolExecutor here, or `Client(address).get_executor()` of
    dask.distributed on a cluster; None: one after another, here.
    """
    yield from map(sought, jobs) if executor is None else executor.map(sought, jobs)


def varied(job: Job, axes: Sequence[str]) -> list[Job]:
    """Return a job once for every combination of axes such as "number=0:10", "noise=0.001,0.01", "seen=outer,tip".

    Each is a key of `Wanted` but pressures, and its values, separated by commas, or a range of whole numbers without
    its end. Raises BadInput for another key or value, and for too many runs.
    """
    known = [one.name for one in fields(Wanted) if one.name != "pressures"]
    columns = []
    for axis in axes:
        key, _, text = axis.partition("=")
        if key not in known or not text:
            raise BadInput(f"sweep {axis!r}", f"has no key {key!r}" if text else "has no values", nearest(key, known))
        columns.append([(key, _value(key, value, axis)) for value in _texts(text, axis)])
    count = 1
    for column in columns:
        count *= len(column)
    if not 0 < count <= MOST:
        raise BadInput(f"sweep {', '.join(axes)!r}", f"is {count} runs", f"expected 1 to {MOST:,}")
    return [replace(job, wanted=replace(job.wanted, **dict(chosen))) for chosen in product(*columns)]


def _texts(text: str, axis: str) -> list[str]:
    first, colon, end = text.partition(":")
    if not colon:
        return text.split(",")
    if not (first.isdecimal() and end.isdecimal() and len(first + end) < 20):
        raise BadInput(f"sweep {axis!r}", f"has the range {text!r}", "expected whole numbers, such as 0:10")
    return [str(k) for k in range(int(first), min(int(end), int(first) + MOST + 1))]


def _value(key: str, text: str, axis: str) -> Any:
    """Return a key's value as a scene would read it: a number, a word, or a quantity with its unit."""
    value: Any = text.strip()
    for kind in (int, float):
        try:
            value = kind(text)
            break
        except ValueError:
            continue
    return getattr(read(Wanted, {"pressures": ["1 Pa"], key: value}, f"sweep {axis!r}"), key)
