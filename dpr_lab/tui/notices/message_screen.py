"""Page with all messages of the session, newest first."""

from textual.app import ComposeResult
from textual.containers import VerticalScroll
from textual.content import Content
from textual.screen import ModalScreen
from textual.widgets import Static

from dpr_lab.tui.keys import bindings
from dpr_lab.tui.notices.message_log import LoggedMessage, MessageLog

TONES = {"error": "bold $error", "warning": "$warning"}


class MessageScreen(ModalScreen[None]):
    """Page with a scrollable list of messages.

    Args:
        log: the displayed messages
    """

    BINDINGS = bindings("messages")

    def __init__(self, log: MessageLog) -> None:
        super().__init__()
        self._log = log

    def compose(self) -> ComposeResult:
        """Build the list: one message per line with its time."""
        with VerticalScroll(classes="dialog") as page:
            page.border_title = "Messages, newest first"
            page.border_subtitle = "esc: close · up, down: scroll"
            lines = [_line(message) for message in reversed(self._log.messages)]
            yield Static(Content("\n").join(lines or [Content("no messages yet")]), markup=False)
            yield Static(f"\nstored in {self._log.file}", markup=False)


def _line(message: LoggedMessage) -> Content:
    when = f"{message.when.astimezone():%H:%M:%S}"
    return Content.assemble(
        (f"{when} ", "dim"), (f"{message.severity}: {message.text}", TONES.get(message.severity, ""))
    )
