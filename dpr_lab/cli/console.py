"""What the commands print: one JSON object or readable tables on stdout, everything else on stderr."""

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

from dpr_lab.report.plain import as_json

_state = {"json": False}


def json_mode(on: bool) -> bool:
    """Remember that this process was asked for JSON, so that errors are JSON too."""
    _state["json"] = on
    return on


def emit(result: dict[str, Any] | list[dict[str, Any]]) -> None:
    """One JSON object on stdout, or a list of them; numbers that are not finite become null."""
    print(as_json(result))


def complain(message: str, exit_code: int) -> None:
    """An error for the operator: on stderr, and with --json as an object on stdout too."""
    if _state["json"]:
        emit({"error": message, "exit_code": exit_code})
    print(f"dpr-lab: {message}", file=sys.stderr)


def say(message: str) -> None:
    """A line for the operator, on stderr: never mixed with a result."""
    print(message, file=sys.stderr, flush=True)


def table(
    title: str, columns: Sequence[str], rows: Sequence[Sequence[object]], *, prose: bool = False, note: str = ""
) -> None:
    """A table on stdout; `prose` for columns of text, which read from the left; a `note` below says how to read it."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    made = Table(title=title, title_justify="left", title_style="bold")
    for index, column in enumerate(columns):
        made.add_column(column, justify="left" if prose or index == 0 else "right", overflow="fold")
    for row in rows:
        made.add_row(*(escape(str(cell)) for cell in row))
    # A pipe or a file has no width to wrap at.
    console = Console(width=None if sys.stdout.isatty() else 160, highlight=False)
    console.print(made)
    if note:
        console.print(escape(note), style="dim")


class Bar(Protocol):
    """A progress bar on a terminal, nothing elsewhere."""

    def __call__(self, done: float, text: str = "") -> None:
        """Show `done` of the total, with a text."""
        ...


@contextmanager
def progress(title: str, total: float) -> Iterator[Bar]:
    """A progress bar on stderr when it is a terminal."""
    if not sys.stderr.isatty():
        yield lambda done, text="": None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[text]}"), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=total, text="")
        yield lambda done, text="": bar.update(task, completed=done, text=text)
