"""What a command hands back, and how it is shown: values for scripts, text and tables for people."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

WIDTH = 100


@dataclass
class Outcome:
    """A command's result: values for --json, and lines and tables for people."""

    values: dict[str, Any]
    parts: list[Any] = field(default_factory=list)
    code: int = 0

    def show(self) -> None:
        """Print the result, at most 100 columns wide."""
        from rich.console import Console

        class Pipe(Console):
            def on_broken_pipe(self) -> None:
                raise BrokenPipeError  # the reader has left: the command line knows what to do

        console = Pipe(width=WIDTH, highlight=False, soft_wrap=False)
        for part in self.parts:
            console.print(printable(part), markup=False) if isinstance(part, str) else console.print(part)


def table(header: Sequence[str], rows: Sequence[Sequence[str]], title: str = "", words: int = 1) -> Any:
    """Return a printable table: the first `words` columns left, the others right."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    made = Table(title=Text(printable(title)) if title else None, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for index, name in enumerate(header):
        made.add_column(Text(name), justify="left" if index < words else "right", overflow="fold")
    for row in rows:
        made.add_row(*(Text(printable(cell)) for cell in row))
    return made


def printable(text: str) -> str:
    """Return text from a file as a terminal may see it: control characters replaced."""
    return "".join(character if character.isprintable() or character == "\n" else "\ufffd" for character in text)


@contextmanager
def progress(text: str) -> Iterator[Callable[[float], None]]:
    """Show a bar on a terminal while a command works; yields what takes the share done."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(text, total=1.0)
        yield lambda share: bar.update(task, completed=share)
