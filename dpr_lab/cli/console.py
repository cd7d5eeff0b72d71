"""Output of the commands: results on stdout, everything else on stderr.

Results are a JSON object or readable tables.
"""

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
    from dpr_lab.report.pages.page import PageTable


def line(text: object = "") -> None:
    """Print a line of the result on stdout."""
    print(folded(printable(str(text)), sys.stdout))


def text(document: str) -> None:
    """Print a document unchanged on stdout."""
    print(printable(document))


def emit(result: dict[str, Any] | list[dict[str, Any]]) -> None:
    """Print JSON objects on stdout; non-finite numbers become null."""
    print(as_json(result))


def complain(message: str, exit_code: int) -> None:
    """Print an error on stderr; with --json also as an object on stdout."""
    if "--json" in sys.argv:
        emit({"error": message, "exit_code": exit_code})
    say(f"dpr-lab: {message}")


def say(message: str) -> None:
    """Print a line for the operator on stderr, separate from the results."""
    print(folded(printable(message), sys.stderr), file=sys.stderr, flush=True)


def folded(message: str, stream: TextIO, before: int = 0) -> str:
    """Wrap a message at spaces to the width of the terminal; other streams get the unchanged message.

    Args:
        message: the message
        stream: stream on which the message is printed
        before: number of characters that precede the message in its first line
    """
    if not stream.isatty():
        return message
    width = get_terminal_size().columns
    words = partial(fill, width=width, break_long_words=False, break_on_hyphens=False)
    return "\n".join(map(words, ("\0" * before + message).split("\n"))).lstrip("\0")


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[object]], *, note: str = "") -> None:
    """Print a table with a `note` below it on stdout.

    The table is at most as wide as the terminal.
    """
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from dpr_lab.report.digits import NUMERIC

    cells = [[printable(str(cell)) for cell in row] for row in rows]
    down = list(zip(columns, *cells, strict=True))
    # no wrapping in a pipe or file
    console = Console(width=None if sys.stdout.isatty() else 160, highlight=False)
    widths = _widths(down, console.width - 3 * len(columns) - 1)
    if widths is None:
        _list(title, columns, cells, console.width)
    else:
        grid = Table(title=title, title_justify="left", title_style="bold")
        for index, (column, width) in enumerate(zip(down, widths, strict=True)):
            numbers = index > 0 and set("".join(column[1:]).replace(" to ", "")) <= NUMERIC
            grid.add_column(column[0], justify="right" if numbers else "left", width=width)
        for row in cells:
            grid.add_row(*map(escape, row))
        console.print(grid)
    if note:
        console.print(escape(printable(note)), style="dim")


def report_table(title: str, shown: "PageTable", note: str | None = None) -> None:
    """Print a table of the report with its caption, or with another note."""
    table(title, shown.columns, shown.rows, note=shown.caption if note is None else note)


def _widths(columns: Sequence[Sequence[str]], room: int) -> list[int] | None:
    """Return the widths of the columns, in which no word is broken; None if the terminal is too narrow.

    Args:
        columns: header and cells of each column
        room: available width for all columns, characters
    """
    from rich.cells import cell_len

    widths = [max(cell_len(word) for cell in column for word in [*cell.split(), ""]) for column in columns]
    unwrapped = [max(cell_len(part) for cell in column for part in cell.split("\n")) for column in columns]
    spare = room - sum(widths)
    if spare < 0:
        return None
    missing = sorted(range(len(columns)), key=lambda i: unwrapped[i] - widths[i])
    for narrower, i in enumerate(missing):  # narrow columns first; the others share the remaining width
        added = min(unwrapped[i] - widths[i], spare // (len(columns) - narrower))
        widths[i], spare = widths[i] + added, spare - added
    return widths


def _list(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], width: int) -> None:
    """Print a table that is too wide for the terminal.

    Each row becomes a block, or a line if the table has two columns.
    """
    lines = [_hanging(title, width, "")]
    for first, *rest in rows:
        if len(rest) == 1:
            lines.append(_hanging(f"{first}: {rest[0]}", width, ""))
        else:
            lines.append(_hanging(first, width, ""))
            lines += [
                _hanging(f"{column}: {cell}", width, "  ") for column, cell in zip(columns[1:], rest, strict=True)
            ]
    print("\n".join(lines))


def _hanging(text: str, width: int, indent: str) -> str:
    return fill(
        text,
        width,
        initial_indent=indent,
        subsequent_indent=f"{indent}  ",
        break_long_words=False,
        break_on_hyphens=False,
    )


class Bar(Protocol):
    """Progress bar on a terminal; otherwise it prints nothing."""

    def __call__(self, done: float | None, text: str = "") -> None:
        """Move the bar to `done`, in the unit of the total, and show a text.

        If `done` is None, the bar does not move.
        """
        ...


def no_bar(done: float | None, text: str = "") -> None:
    """Ignore the progress, because stderr is not a terminal."""


@contextmanager
def progress(title: str, total: float | None) -> Iterator[Bar]:
    """Show a progress bar on stderr if stderr is a terminal.

    The bar is indeterminate if `total` is None.
    """
    if not sys.stderr.isatty():
        yield no_bar
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    text_columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[text]}"))
    columns = (SpinnerColumn(), *text_columns, TimeElapsedColumn(), TimeRemainingColumn(elapsed_when_finished=True))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=total, text="")
        yield lambda done, text="": bar.update(task, completed=done, text=text)
