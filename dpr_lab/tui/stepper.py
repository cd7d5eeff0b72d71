"""The rows on top: the six steps, which one is shown, which are done, and what comes next."""

from collections.abc import Sequence
from dataclasses import dataclass

from rich.text import Text
from textual.message import Message
from textual.widgets import Static

DONE, HERE, OPEN, BLOCKED = "✔", "▶", "○", "·"
ROOMY = 120
"""Columns from which on every step shows its outcome."""


@dataclass(frozen=True, slots=True)
class Standing:
    """Where one step stands."""

    name: str
    outcome: str
    missing: str
    here: bool

    @property
    def symbol(self) -> str:
        """One character, beside the word."""
        if self.here:
            return HERE
        return DONE if self.outcome else BLOCKED if self.missing else OPEN


class Stepper(Static):
    """Two rows: the steps, and in words where the operator is and what is next."""

    class Chosen(Message):
        """A step was clicked."""

        def __init__(self, number: int) -> None:
            super().__init__()
            self.number = number

    def show(self, standings: Sequence[Standing], next_key: str) -> None:
        """Draw the steps as they stand; `next_key` is the key that leads on."""
        roomy = self.app.size.width >= ROOMY
        row = Text("")
        for number, standing in enumerate(standings, 1):
            row.append(" › " if number > 1 else "", "dim")
            row.append_text(_label(number, standing, roomy))
        self.update(Text("\n").join([row, _words(standings, next_key)]))

    def action_choose(self, number: int) -> None:
        """A click on a step."""
        self.post_message(self.Chosen(number))


def _label(number: int, standing: Standing, roomy: bool) -> Text:
    said = f"{standing.symbol}{number} {standing.name}"
    if roomy and standing.outcome:
        said += f" ({standing.outcome})"
    style = "bold reverse" if standing.here else "dim" if standing.missing else ""
    return Text(said, style).on({"@click": f"choose({number})"})


def _words(standings: Sequence[Standing], next_key: str) -> Text:
    index = next((i for i, standing in enumerate(standings) if standing.here), 0)
    here = standings[index]
    words = here.missing or f"{here.name}: {here.outcome or 'to be done'}"
    if not here.missing and index + 1 < len(standings):
        key = f" ({next_key})" if next_key else ""  # behind a dialog no key leads on
        words += f" · next{key}: {index + 2} {standings[index + 1].name}"
    return Text(words, "italic", no_wrap=True, overflow="ellipsis")
