"""The rows on top: the six steps, which one is shown, which are done, and what comes next."""

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
    """What changed since the outcome was made; it stays readable."""
    working: bool = False
    """Whether its work is under way."""

    @property
    def symbol(self) -> str:
        """One character, shown with the word."""
        if self.here:
            return HERE
        if self.outcome and self.stale:
            return STALE
        return DONE if self.outcome else BLOCKED if self.missing else OPEN


class Stepper(Static):
    """Two rows: the steps, and in words where the operator is and what is next."""

    class Chosen(Message):
        """A step was clicked."""

        def __init__(self, number: int) -> None:
            super().__init__()
            self.number = number

    def show(self, steps: Sequence[StepStatus], next_key: str, report_key: str = "") -> None:
        """Draw the steps as they stand, with as many of their outcomes as there is room for.

        Args:
            steps: all, in their order
            next_key: the key that leads on
            report_key: the key that opens the page that the step wrote; empty where there is none
        """
        shown = len(steps)
        while (row := _row(steps, shown)).cell_len > max(self.app.size.width - 2, 1) and shown > 0:
            shown -= 1
        self.update(Text("\n", no_wrap=True, overflow="ellipsis").join([row, _words(steps, next_key, report_key)]))

    def action_choose(self, number: int) -> None:
        """A click on a step."""
        self.post_message(self.Chosen(number))


def _row(steps: Sequence[StepStatus], shown: int) -> Text:
    """The steps side by side; the first of those with an outcome tell it."""
    row, left = Text(no_wrap=True, overflow="ellipsis"), shown
    for number, step in enumerate(steps, 1):
        outcome = f" ({step.outcome})" if step.outcome and left > 0 else ""
        left -= bool(step.outcome)
        style = "bold reverse" if step.here else "dim" if step.missing else ""
        row.append(" › " if number > 1 else "", "dim")
        row.append_text(Text(f"{step.symbol}{number} {step.name}{outcome}", style).on({"@click": f"choose({number})"}))
    return row


def _words(steps: Sequence[StepStatus], next_key: str, report_key: str) -> Text:
    index = next((i for i, step in enumerate(steps) if step.here), 0)
    here = steps[index]
    words = here.missing or f"{here.name}: {here.outcome or ('under way' if here.working else 'to be done')}"
    if here.outcome and report_key:
        words += f" · {report_key}: report"
    if here.outcome and here.stale:
        return Text(f"{words} · {here.stale}", "bold italic", no_wrap=True, overflow="ellipsis")
    if not here.missing and index + 1 < len(steps):
        key = f" ({next_key})" if next_key else ""  # behind a dialog no key leads on
        words += f" · next{key}: {index + 2} {steps[index + 1].name}"
    return Text(words, "italic", no_wrap=True, overflow="ellipsis")
