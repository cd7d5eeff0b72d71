"""Base class of the app: shows and logs messages, and keeps errors visible until dismissed."""

from typing import Any

from textual.app import App
from textual.notifications import Notification, Notify, SeverityLevel

from dpr_lab.tui.notices.message_log import MessageLog
from dpr_lab.tui.notices.message_screen import MessageScreen
from dpr_lab.tui.texts import NOTICES


class NoticeApp(App[None]):
    """Mixin of the app that shows and logs messages."""

    messages: MessageLog
    error_title: str = "Error"

    @property
    def notices(self) -> list[Notification]:
        """The messages that are currently shown, oldest first."""
        return [*self._notifications]

    def notify(self, message: str, *, severity: SeverityLevel = "information", **options: Any) -> None:
        """Show a plain text.

        An error stays visible until Escape is pressed or another step is shown.
        """
        options["markup"] = False
        if severity == "error":
            options |= {"timeout": NOTICES.stays_s, "title": self.error_title}
        super().notify(message, severity=severity, **options)

    def on_notify(self, event: Notify) -> None:
        """Log and show a message, unless it is shown already.

        If space is short, errors are the last to be removed.
        """
        new, standing = event.notification, self.notices
        if any(notice.message == new.message for notice in standing):
            event.prevent_default()
            return
        standing.sort(key=lambda notice: (notice.severity == "error", notice.raised_at))
        for old in standing[: max(len(standing) + 1 - NOTICES.most, 0)]:
            self._unnotify(old, refresh=False)
        self.messages.add(new.severity, new.message)

    def action_messages(self) -> None:
        """Show all messages of this session."""
        self.push_screen(MessageScreen(self.messages))
