"""While a map is sought: each iteration on the terminal, in the map's file and in the dashboard; and taken up again."""

import argparse
import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from catheter.lab.dashboard import quiet
from data.errors import BadInput
from data.files import check_free
from data.signal import Array

if TYPE_CHECKING:
    from catheter.lab.views.inverse import InverseView
    from fem.inverse import Iteration

Tell = Callable[["Iteration"], None]


@dataclass(frozen=True, eq=False)
class Sought:
    """What an inversion is of: its title, the voxels' grid, what is wanted (k, 3) [m] at the highest pressure.

    kind: of the data, "simulated" or "measured"; truth (v,): the moduli [Pa] that made them, empty: not known.
    """

    title: str
    kind: str
    grid: tuple[int, ...]
    wanted: Array
    truth: Array


def outputs(options: argparse.Namespace) -> tuple[Path | None, Path | None]:
    """Return where map and dashboard go; the dashboard's place must be free, or --force given. Raises CannotWrite."""
    out, view = (Path(name) if name else None for name in (options.out, options.view))
    if view:
        check_free(view, options.force)
    return out, view


@contextmanager
def live(sought: Sought, out: Path | None, view: Path | None) -> "Iterator[tuple[Tell, InverseView | None]]":
    """Yield what takes each iteration of a search, and the dashboard if one is written."""
    from rich.console import Console

    with ExitStack() as stack:
        status = stack.enter_context(Console(stderr=True).status(sought.title))
        shown = None
        if view:
            quiet()
            from catheter.lab.views.inverse import InverseView

            shown = stack.enter_context(InverseView(view, sought))

        def tell(one: "Iteration") -> None:
            status.update(f"{sought.title}: iteration {one.number}, misfit {one.misfit:.2e}, {one.seconds:.1f} s")
            if out:
                keep(
                    out, moduli_pa=np.exp(one.log), grid=np.array(sought.grid), iteration=one.number,
                    misfit=one.misfit, seconds=one.seconds, origin=sought.kind,
                )  # fmt: skip
            if shown:
                shown.show(one)

        yield tell, shown


def keep(out: Path, **values: Any) -> None:
    """Write arrays as .npz, in one step."""
    part = out.with_name(out.name + ".partial")
    with part.open("wb") as file:
        np.savez(file, **values)
    os.replace(part, out)  # noqa: PTH105, Path.replace does the same


def resumed(out: Path | None, grid: tuple[int, ...], force: bool) -> Array | None:
    """Return the moduli (v,) [Pa] of an interrupted run, or None. Raises BadInput for a file that is no such map."""
    kept = kept_in(out, force)
    if out is None or kept is None:
        return None
    if "moduli_pa" not in kept or tuple(kept.get("grid", ())) != grid or kept["moduli_pa"].size != np.prod(grid):
        found = tuple(np.asarray(kept.get("grid", ())).tolist())
        raise BadInput(out, f"has {found} voxels", f"expected {grid}; name another file, or --force")
    return np.asarray(kept["moduli_pa"], dtype=np.float64).ravel()


def kept_in(out: Path | None, force: bool) -> dict[str, Any] | None:
    """Return the arrays of an interrupted run's file, or None. Raises BadInput for a file that holds none."""
    if out is None:
        return None
    if force or not out.exists():
        check_free(out, force)
        return None
    try:
        with np.load(out, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except (OSError, ValueError, AttributeError) as error:
        raise BadInput(out, f"is no map: {error}", "name another file, or begin anew with --force") from error
