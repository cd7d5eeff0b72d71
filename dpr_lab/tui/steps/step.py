"""Base class of the seven steps of the screen."""

from pathlib import Path
from typing import ClassVar

from textual.containers import Vertical
from textual.message import Message
from textual.visual import VisualType
from textual.widgets import Static

from dpr_lab.tui.guard import Guarded
from dpr_lab.tui.recorder.connection import DeviceConnection
from dpr_lab.tui.recorder.messages import RecorderReport
from dpr_lab.tui.services import Services
from dpr_lab.tui.texts import NOTICES
from dpr_lab.tui.workspace import Workspace


class Step(Guarded, Vertical, can_focus=True):
    """One step of the screen.

    The step itself can have the focus, so that its keys work when none of its widgets has the focus.

    Args:
        services: services of the app
    """

    NAME: ClassVar[str]
    """Name of the step in the list of steps: one word."""
    HELP: ClassVar[str | None] = ""
    """Markdown with the purpose of the step and its keys."""

    class Done(Message):
        """Event: the state of the step has changed.

        The list of steps is redrawn and the workspace saved.
        """

    def __init__(self, services: Services) -> None:
        super().__init__(id=self.NAME.lower())
        self.services = services

    @property
    def workspace(self) -> Workspace:
        """Workspace of the operator."""
        return self.services.workspace

    @property
    def device(self) -> DeviceConnection:
        """Connection to the device."""
        return self.services.device

    def worded(self, text: str) -> str:
        """Replace the placeholders of actions in a text by the operator's keys (`KeyNames.fill`)."""
        return self.services.keys.fill(text)

    def changed(self) -> None:
        """Post the event that the state of the step has changed."""
        self.post_message(self.Done())

    def warn(self, text: str) -> None:
        """Show a warning for some seconds."""
        self.notify(text, severity="warning", timeout=NOTICES.news_s)

    def put(self, name: str, content: VisualType) -> None:
        """Show content in the text field with the id `name`."""
        self.query_one(f"#{name}", Static).update(content)

    @property
    def urgent(self) -> str:
        """Countdown or recording in progress, for the status line; the text is empty if there is none."""
        return ""

    def outcome(self) -> str:
        """Return the short result for the list of steps, empty without a result."""
        return ""

    def stale(self) -> str:
        """Return a sentence that names what changed after the result was computed.

        The sentence also names the key that repeats the computation. The text is empty if the result is current.
        """
        return ""

    @property
    def work(self) -> str:
        """Running job and its elapsed time; the text is empty if no job is running."""
        return ""

    def report(self) -> Path | None:
        """Return the path of the report of the step, or None."""
        return None

    def missing(self) -> str:
        """Return a sentence that names the missing prerequisite and how to provide it.

        The text is empty if nothing is missing.
        """
        return ""

    def enter(self) -> None:
        """Update the step; this method is called each time the step is shown."""

    def hear(self, report: RecorderReport) -> None:
        """Handle a report of the recorder."""

    def at_stake(self) -> str:
        """Return a warning about results that would be lost if the operator quits now.

        The text is empty if nothing would be lost.
        """
        return ""
