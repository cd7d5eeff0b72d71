"""Tables, lists and sentences for the screen."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from rich import box
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.table import Table
from rich.text import Text

from dpr_lab.report.digits import NUMERIC
from dpr_lab.report.pages.page import PageTable
from dpr_lab.report.run_names import recorded, run_name, run_pose
from dpr_lab.shown import counted

Value = TypeVar("Value")


@dataclass(frozen=True, slots=True)
class NoticeTimes:
    """Number of notices and their durations.

    Escape dismisses notices; the message log keeps all of them.
    """

    stays_s: float = 86400.0
    """Duration of an error, s. In practice it is visible until Escape is pressed or another step is shown."""
    error_title: str = "Error (esc: close · {app.messages}: all messages)"
    """Title of an error; the key of the message log is inserted."""
    error_s: float = 30.0
    """Duration of a warning with an instruction, s."""
    news_s: float = 20.0
    """Duration, s, of a notice on a job that ended while another step was shown, or on a release refused on a slow
    line."""

    hint_s: float = 5.0
    """Duration of a notice that a key has no function, s."""
    most: int = 2
    """Maximum number of notices shown at a time. More would cover the content."""


ABOUT_TERMS = (
    "The glossary (docs/glossary.md) defines the terms. The section Terms of a report defines the terms that it uses."
)

NOTICES = NoticeTimes()


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> RenderableType:
    """Create a table as wide as its cells.

    Text is aligned left. Numbers are aligned right and never wrapped; long headers are wrapped.
    """
    drawn = Table(
        title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0)
    )
    for index, column in enumerate(columns):
        numbers = index > 0 and all(set(row[index].replace(" to ", "")) <= NUMERIC for row in rows)
        least = max((len(row[index]) for row in rows), default=0) if numbers else None
        drawn.add_column(column, justify="right" if numbers else "left", min_width=least, overflow="fold")
    for row in rows:
        drawn.add_row(*(Text(cell) for cell in row))
    return drawn


def report_table(title: str, rows: PageTable) -> RenderableType:
    """Return a table of the report, with a title."""
    return table(title, rows.columns, rows.rows)


def sentences(title: str, lines: Sequence[str], *, mark: str = "•", numbered: bool = False) -> RenderableType:
    """Create a list of sentences below a title, with marks or with numbers from 1.

    The result is empty if there are no sentences.
    """
    if not lines:
        return Text("")
    items = Table.grid(padding=(0, 1))
    for number, line in enumerate(lines, 1):
        items.add_row(f"{number}." if numbered else mark, Text(line))
    return Group(Text(title, "bold"), items, Text(""))


def following(values: Sequence[Value], current: object, by: int = 1) -> Value:
    """Return the value `by` positions after the current one in a cycle of values.

    If the current value is not in the cycle, the first value follows it and the last value precedes it.
    """
    position = next((i for i, value in enumerate(values) if value == current), -1 if by > 0 else 0)
    return values[(position + by) % len(values)]


def shorter(names: Sequence[str], most: int = 6) -> str:
    """Join the first `most` names by commas, and state the number of the remaining names."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")


def named_runs(runs: Sequence[Path]) -> str:
    """Return a text with the number, names and recording period of runs.

    An example is `2 runs: X1, X2 (2026-11-21 11:15 to 11:19 CET)`. If there are no runs, the text is empty.
    """
    names = [run_name(run) for run in runs]
    poses, times = {run_pose(run) for run in runs}, sorted(filter(None, map(recorded, runs)))
    if len(runs) > 1 and len(times) == len(poses) == len(runs) and times[0][:10] == times[-1][:10]:
        first, last = times[0], times[-1]
        names = [run_pose(run) for run in runs]
        when = first if first == last else f"{first[:16]} to {last[11:]}"
        return f"{counted(len(runs), 'run')}: {shorter(names)} ({when})"
    return f"{counted(len(runs), 'run')}: {shorter(names, most=3)}" if runs else ""


@dataclass(frozen=True, slots=True)
class Bars:
    """Horizontal bar chart that adapts to the width.

    A bar has a label, a value, an optional interval and a text.
    """

    rows: Sequence[tuple[str, float, tuple[float, float] | None, str]]
    top: float | None = None
    """Value of a full bar; default: the largest value."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield one line of text for each bar."""
        label = max((len(row[0]) for row in self.rows), default=0)
        text_width = max((len(row[3]) for row in self.rows), default=0)
        width = max(options.max_width - label - text_width - 4, 8)
        top = self.top or max((row[1] for row in self.rows), default=1.0) or 1.0
        for name, value, interval, text in self.rows:
            yield Text(f"{name:<{label}} {self._bar(value, interval, top, width)} {text}", no_wrap=True)

    def _bar(self, value: float, interval: tuple[float, float] | None, top: float, width: int) -> str:
        def column(position: float) -> int:
            return min(max(round(position / top * (width - 1)), 0), width - 1)

        cells = [
            "█" if value > 0 and i <= column(value) and round(value / top * width) > 0 else " " for i in range(width)
        ]
        if interval is not None:
            low, high = column(interval[0]), column(interval[1])
            cells[low : high + 1] = ["├", *"─" * (high - low - 1), "┤"][: high - low + 1] if high > low else ["│"]
        return "".join(cells)
