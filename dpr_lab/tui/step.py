"""A step of the bench screen: what all six have in common."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from textual.containers import Vertical
from textual.message import Message

from dpr_lab.tui.guard import Guarded

if TYPE_CHECKING:
    from dpr_lab.tui.bench import Bench
    from dpr_lab.tui.orders import Report


ERROR_S = 15.0
"""How long an error stays; Escape takes it away sooner."""


class Step(Guarded, Vertical, can_focus=True):
    """A page of the stepper.

    It can take the focus itself, so that its keys work while none of its widgets has it.
    """

    NAME: ClassVar[str]
    """One word, for the stepper."""
    HELP: ClassVar[str | None] = ""
    """Markdown: what the step is for and what its keys do."""

    class Done(Message):
        """The step has something new: the stepper is redrawn and the bench saved."""

    @property
    def bench(self) -> Bench:
        """What the operator works on."""
        return self.lab.bench

    def outcome(self) -> str:
        """A few words for the stepper once there is a result; empty before."""
        return ""

    def missing(self) -> str:
        """A sentence naming what must come first, and how; empty when the step can be worked on."""
        return ""

    def enter(self) -> None:
        """Called each time the step is shown."""

    def hear(self, report: Report) -> None:
        """Called with everything that the recorder says."""

    def at_stake(self) -> str:
        """What quitting now would lose, as an object of `lose`; empty when nothing."""
        return ""
