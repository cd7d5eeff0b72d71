"""Dialogs above a step: help, and confirmation before data are discarded."""

from collections.abc import Callable
from typing import Any

from textual.app import App, ComposeResult
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Button, Markdown, Static

from dpr_lab.tui.keys import bindings


class HelpScreen(ModalScreen[None]):
    """Dialog with the purpose of a step and all keys."""

    BINDINGS = bindings("help")

    def __init__(self, text: str) -> None:
        super().__init__()
        self._text = text

    def compose(self) -> ComposeResult:
        """Build one scrolling page."""
        with VerticalScroll(classes="dialog") as page:
            page.border_subtitle = "esc: close · up, down: scroll"
            yield Markdown(self._text)


class Question(ModalScreen[bool]):
    """Dialog that requests a confirmation; every answer except an explicit yes counts as no."""

    BINDINGS = bindings("question")

    def __init__(self, question: str, yes: str, no: str) -> None:
        super().__init__()
        self._question, self._yes, self._no = question, yes, no

    def compose(self) -> ComposeResult:
        """Build the question and its two buttons."""
        with Vertical(classes="dialog small"):
            yield Static(self._question, markup=False)
            with Horizontal(classes="buttons"):
                yield Button(f"{self._no} (n)", id="no")
                yield Button(f"{self._yes} (y)", id="yes", variant="error")

    def on_button_pressed(self, event: Button.Pressed) -> None:
        """Handle a button."""
        self.dismiss(event.button.id == "yes")

    def action_answer(self, answer: bool) -> None:
        """Handle a key."""
        self.dismiss(answer)


def confirm(app: App[Any], question: str, yes: str, no: str, action: Callable[[], Any]) -> None:
    """Ask a question, and run an action if the answer is yes."""
    app.push_screen(Question(question, yes, no), lambda sure: action() if sure else None)
