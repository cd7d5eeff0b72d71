"""What the commands print: one JSON object or readable tables on stdout, everything else on stderr."""

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from shutil import get_terminal_size
from textwrap import fill
from typing import TYPE_CHECKING, Any, Protocol, TextIO

from dpr_lab.errors import printable
from dpr_lab.report.plain import as_json

if TYPE_CHECKING:
    from rich.console import Console

_state = {"json": False}


def json_mode(on: bool) -> bool:
    """Remember that this process was asked for JSON, so that errors are JSON too."""
    _state["json"] = on
    return on


def line(text: object = "") -> None:
    """A line of the result, on stdout."""
    print(folded(printable(str(text)), sys.stdout))


def emit(result: dict[str, Any] | list[dict[str, Any]]) -> None:
    """One JSON object on stdout, or a list of them; numbers that are not finite become null."""
    print(as_json(result))


def complain(message: str, exit_code: int) -> None:
    """An error for the operator: on stderr, and with --json as an object on stdout too."""
    if _state["json"]:
        emit({"error": message, "exit_code": exit_code})
    say(f"dpr-lab: {message}")


def say(message: str) -> None:
    """A line for the operator, on stderr: never mixed with a result."""
    print(folded(printable(message), sys.stderr), file=sys.stderr, flush=True)


def folded(message: str, stream: TextIO, before: int = 0) -> str:
    """A message: on a terminal its lines end between words; so many characters stand before it already."""
    if not stream.isatty():
        return message
    width = get_terminal_size().columns
    words = partial(fill, width=width, break_long_words=False, break_on_hyphens=False)
    return "\n".join(map(words, ("\0" * before + message).split("\n"))).lstrip("\0")


def table(
    title: str, columns: Sequence[str], rows: Sequence[Sequence[object]], *, prose: bool = False, note: str = ""
) -> None:
    """A table on stdout; `prose` for columns of text, which read from the left; a `note` below says how to read it."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    cells = [[printable(str(cell)) for cell in row] for row in rows]
    widest = [max(map(_longest_word, column)) for column in zip(columns, *cells, strict=True)]
    # A pipe or a file has no width to wrap at.
    console = Console(width=None if sys.stdout.isatty() else 160, highlight=False)
    if sum(widest) + 3 * len(widest) + 1 > console.width:
        _list(console, title, columns, cells)
    else:
        made = Table(title=title, title_justify="left", title_style="bold")
        for index, (column, least) in enumerate(zip(columns, widest, strict=True)):
            made.add_column(column, justify="left" if prose or index == 0 else "right", min_width=least)
        for row in cells:
            made.add_row(*map(escape, row))
        console.print(made)
    if note:
        console.print(escape(printable(note)), style="dim")


def _longest_word(text: str) -> int:
    return max(map(len, text.split()), default=1)


def _list(console: "Console", title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A table whose words do not fit side by side: a block for each row."""
    console.print(title, style="bold", markup=False)
    for first, *rest in rows:
        console.print(first, markup=False)
        for column, cell in zip(columns[1:], rest, strict=True):
            console.print(
                fill(f"{column}: {cell}", console.width, initial_indent="  ", subsequent_indent="    "), markup=False
            )


class Bar(Protocol):
    """A progress bar on a terminal, nothing elsewhere."""

    def __call__(self, done: float | None, text: str = "") -> None:
        """Show `done` of the total, None for as much as before, with a text."""
        ...


def no_bar(done: float | None, text: str = "") -> None:
    """Where no bar is."""


@contextmanager
def progress(title: str, total: float | None) -> Iterator[Bar]:
    """A progress bar on stderr when it is a terminal; it moves without end where no `total` is known."""
    if not sys.stderr.isatty():
        yield no_bar
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    told = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[text]}"))
    columns = (SpinnerColumn(), *told, TimeElapsedColumn(), TimeRemainingColumn(elapsed_when_finished=True))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=total, text="")
        yield lambda done, text="": bar.update(task, completed=done, text=text)
