"""Plain pictures for reports: axes with units, colours that everyone can tell apart, and where the data are from."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from catheter.error_map import ErrorMap
    from catheter.lab.report import Row
    from data.signal import Array

# Okabe and Ito's colours without yellow, which white paper swallows: apart for colour-blind readers and in grey.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS = "osD^v<>pXh"
DPI = 130


def sheet(title: str, kind: str = "", *, size: tuple[float, float] = (8.0, 5.5)) -> "Figure":
    """Return an empty figure, `size` in inches. kind: "simulated", "measured" ... stands before its title."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    if title:
        figure.suptitle(f"{kind}: {title}" if kind else title, fontsize=11, parse_math=False)
    return figure


def axes(
    figure: "Figure",
    x: tuple[str, str],
    y: tuple[str, str],
    *,
    at: tuple[int, int, int] = (1, 1, 1),
    title: str = "",
    log: str = "",
) -> "Axes":
    """Return axes of a figure. x, y: (name, unit), unit "" for a count or a name and "1" for a plain number.

    at: (rows, columns, number from 1) as matplotlib counts. log: "", "x", "y" or "xy".
    """
    made: Axes = figure.add_subplot(*at)
    made.set_prop_cycle(color=COLOURS)
    made.set_xlabel(label(*x), parse_math=False)
    made.set_ylabel(label(*y), parse_math=False)
    made.set_title(title, fontsize=10, parse_math=False)
    made.grid(visible=True, which="both" if log else "major", alpha=0.3)
    for letter in log:
        getattr(made, f"set_{letter}scale")("log")
    return made


def image(figure: "Figure", plot: "Axes", values: "Array", name: str, *, about_zero: bool = False) -> None:
    """Draw the voxels (around, along) of a tube unwrapped, the base below, with a scale of colours beside.

    about_zero: the scale holds at least 99 % of the voxels; those beyond are black.
    """
    from matplotlib import colormaps

    plot.grid(visible=False)
    if not about_zero:
        figure.colorbar(plot.imshow(values.T, origin="lower", aspect="auto"), ax=plot, label=name)
        return
    sizes = sorted(abs(float(value)) for value in values.ravel())
    reach = min(1.5 * sizes[int(0.99 * (len(sizes) - 1))], sizes[-1]) or sizes[-1] or 1.0
    colours = colormaps["coolwarm"].with_extremes(under="black", over="black")
    drawn = plot.imshow(values.T, origin="lower", aspect="auto", cmap=colours, vmin=-reach, vmax=reach)
    figure.colorbar(drawn, ax=plot, label=name, extend="both" if sizes[-1] > reach else "neither")


def draw_errors(figure: "Figure", errors: "ErrorMap", at: tuple[int, int, int]) -> None:
    """Draw the three maps of thesis Fig. 6.18 side by side; at: (rows, columns, number of the first)."""
    values = (
        ("modulus", "%", 100 * errors.modulus),
        ("displacement", "mm", 1e3 * errors.displacement),
        ("Green-Lagrange strain", "1", errors.strain),
    )
    for number, (name, unit, value) in enumerate(values, start=at[2]):
        most = f"{float(abs(value).max()):.3g}" + (f" {unit}" if unit != "1" else "")
        title = f"error: {name}, {most} at most"
        plot = axes(figure, ("voxel around", ""), ("voxel along", ""), at=(at[0], at[1], number), title=title)
        image(figure, plot, value, label(name, unit), about_zero=name == "modulus")


def label(name: str, unit: str) -> str:
    """Return 'force [N]', or the name alone where there is no unit to name."""
    return f"{name} [{unit}]" if unit else name


def work_precision(figure: "Figure", rows: "Sequence[Row]", *, error: str, title: str = "") -> "Axes":
    """Draw error against seconds, a line for each method, on two logarithmic axes; failed rows have no point."""
    methods = list(dict.fromkeys(row.method for row in rows))
    figure.set_size_inches(8, 5 + 0.12 * len(methods))
    made = axes(figure, ("run time", "s"), (error, ""), title=title, log="xy")
    for index, method in enumerate(methods):
        kept = [row for row in rows if row.method == method and math.isfinite(row.error)]
        made.plot(
            [row.seconds for row in kept],
            [row.error for row in kept],
            label=method,
            marker=MARKERS[index % len(MARKERS)],
            linestyle=("-", "--", ":")[index // len(COLOURS) % 3],
        )
    if any(row.error == 0 for row in rows):  # exact answers have no place on a logarithmic axis
        made.set_yscale("symlog", linthresh=min((row.error for row in rows if row.error > 0), default=1.0))
    figure.legend(loc="outside lower center", ncols=2, fontsize=8)
    return made


def save(figure: "Figure", path: Path) -> None:
    """Write a figure to `path` as PNG, whatever its ending. Raises OSError for the place."""
    figure.savefig(path, format="png", dpi=DPI)
