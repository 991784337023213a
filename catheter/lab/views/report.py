"""A report as a dashboard: its rows as text, its pictures on pages."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from catheter.lab.views.labels import literal
from catheter.lab.views.output import Output

ON_A_PAGE = 4
FOLDED = (rrb.BlueprintPanel(state="collapsed"), rrb.SelectionPanel(state="collapsed"))


def save(
    path: Path,
    title: str,
    *,
    header: Sequence[str],
    rows: Sequence[Sequence[str]],
    notes: Sequence[str] = (),
    pictures: Mapping[str, Path],
) -> None:
    """Write a report's dashboard to `path`, replaced: rows as a table, notes, and pictures (name -> PNG file).

    Raises CannotWrite for the place.
    """
    with Output("report", path) as output:
        stream = output.stream
        stream.log("/text", rr.TextDocument(_text(title, header, rows, notes), media_type="text/markdown"), static=True)
        views = []
        for number, (name, picture) in enumerate(pictures.items()):
            entity = f"/pictures/{number}"
            stream.log(entity, rr.EncodedImage(path=picture), static=True)
            output.settle(picture.stat().st_size)
            views.append(rrb.Spatial2DView(name=name, origin=entity))
        text = rrb.TextDocumentView(name=title[:60], origin="/text")
        groups = [views[first : first + ON_A_PAGE] for first in range(0, len(views), ON_A_PAGE)]
        pages = [rrb.Grid(*group, grid_columns=2, name=_span(group)) for group in groups]
        stream.send_recording_name(title)
        stream.send_blueprint(
            rrb.Blueprint(rrb.Tabs(text, *pages, active_tab=0), *FOLDED, rrb.TimePanel(state="hidden"))
        )


def _span(views: Sequence[rrb.View]) -> str:
    """Return 'first to last' of the names of a page's views."""
    names = [str(view.name) for view in views]
    return names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"


def _text(title: str, header: Sequence[str], rows: Sequence[Sequence[str]], notes: Sequence[str]) -> str:
    lines = [f"# {literal(title)}", "", _line(header), _line(["---"] * len(header)), *map(_line, rows), ""]
    return "\n".join([*lines, *(f"- {literal(note, 1000)}" for note in notes)])


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(literal(cell, 400) if cell != '---' else cell for cell in cells)} |"
