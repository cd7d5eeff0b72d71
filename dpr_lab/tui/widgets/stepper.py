"""Rows at the top of the screen: the seven steps with their states."""

from collections.abc import Sequence
from dataclasses import dataclass

from rich.text import Text
from textual.message import Message
from textual.widgets import Static

DONE, HERE, OPEN, BLOCKED, STALE = "✔", "▶", "○", "·", "≠"


@dataclass(frozen=True, slots=True)
class StepStatus:
    """Status of one step."""

    name: str
    outcome: str
    missing: str
    here: bool
    stale: str = ""
    """Changes since the result was computed; empty if it is current. An outdated result remains visible."""
    working: bool = False
    """Whether the job of the step is running."""

    @property
    def symbol(self) -> str:
        """Character that shows the state of the step next to its name."""
        if self.here:
            return HERE
        if self.outcome and self.stale:
            return STALE
        return DONE if self.outcome else BLOCKED if self.missing else OPEN


class Stepper(Static):
    """Two rows: the steps, and a sentence on the current and the next step."""

    @dataclass
    class Chosen(Message):
        """Event: a step was clicked."""

        number: int

    def show(self, steps: Sequence[StepStatus], next_key: str, report_key: str = "") -> None:
        """Draw the steps, with as many results as fit.

        Args:
            steps: all steps in order
            next_key: key of the next step
            report_key: key that opens the report of the step; empty if there is none
        """
        shown, width = len(steps), max(self.app.size.width - 2, 1)
        while (row := _row(steps, shown)).cell_len > width and shown > 0:
            shown -= 1
        if row.cell_len > width:
            row = _row(steps, 0, " ")
        self.update(Text("\n", no_wrap=True, overflow="ellipsis").join([row, _words(steps, next_key, report_key)]))

    def action_choose(self, number: int) -> None:
        """Handle a click on a step."""
        self.post_message(self.Chosen(number))


def _row(steps: Sequence[StepStatus], shown: int, between: str = " › ") -> Text:
    """Return all steps in one row; only the first `shown` results are included."""
    row, left = Text(no_wrap=True, overflow="ellipsis"), shown
    for number, step in enumerate(steps, 1):
        outcome = f" ({step.outcome})" if step.outcome and left > 0 else ""
        left -= bool(step.outcome)
        style = "bold reverse" if step.here else "dim" if step.missing else ""
        row.append(between if number > 1 else "", "dim")
        row.append_text(Text(f"{step.symbol}{number} {step.name}{outcome}", style).on({"@click": f"choose({number})"}))
    return row


def _words(steps: Sequence[StepStatus], next_key: str, report_key: str) -> Text:
    index = next((i for i, step in enumerate(steps) if step.here), 0)
    current = steps[index]
    words = current.missing or f"{current.name}: {current.outcome or ('running' if current.working else 'to be done')}"
    if current.outcome and report_key:
        words += f" · {report_key}: report"
    if current.outcome and current.stale:
        return Text(f"{words} · {current.stale}", "bold italic", no_wrap=True, overflow="ellipsis")
    if not current.missing and index + 1 < len(steps):
        key = f" ({next_key})" if next_key else ""  # while a dialog is open, no key shows the next step
        words += f" · next{key}: {index + 2} {steps[index + 1].name}"
    return Text(words, "italic", no_wrap=True, overflow="ellipsis")
