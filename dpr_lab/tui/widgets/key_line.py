"""Bottom row with the active keys."""

from typing import ClassVar

from rich.text import Text
from textual.binding import Binding
from textual.screen import Screen
from textual.widget import Widget


class KeyLine(Widget):
    """Row with all active keys, drawn in the same frame as the focused widget.

    The footer of Textual has a widget for each key and replaces these widgets some frames after a change of focus. In
    these frames it shows the keys of the previous step.
    """

    ALLOW_SELECT = False
    COMPONENT_CLASSES: ClassVar[set[str]] = {"key-line--key", "key-line--words"}
    DEFAULT_CSS = """
    KeyLine {
        dock: bottom;
        height: 1;
        color: $footer-foreground;
        background: $footer-background;
        .key-line--key { color: $footer-key-foreground; background: $footer-key-background; text-style: bold; }
        .key-line--words { color: $footer-description-foreground; background: $footer-description-background; }
    }
    """

    def __init__(self) -> None:
        super().__init__()
        self.set_reactive(Widget.auto_links, False)  # links would be drawn in a colour of their own
        self._keys: list[tuple[Binding, bool]] = []

    def on_mount(self) -> None:
        """Redraw the line each time the focus changes."""
        self.screen.bindings_updated_signal.subscribe(self, self._follow)

    def show(self) -> None:
        """Draw the active keys, with the first key of each action."""
        shown: dict[str, tuple[Binding, bool]] = {}
        for active in self.screen.active_bindings.values():
            if active.binding.show:
                shown.setdefault(active.binding.action, (active.binding, active.enabled))
        if self._keys != (keys := [*shown.values()]):
            self._keys = keys
            self.refresh()

    def render(self) -> Text:
        """Return the keys with their descriptions.

        A click on a key triggers its action.
        """
        line = Text(no_wrap=True)
        for binding, enabled in self._keys:
            line.append_text(self._worded(binding, enabled)).append(" ")
        return line

    def _worded(self, binding: Binding, enabled: bool) -> Text:
        key, words = (self.get_component_rich_style(f"key-line--{part}") for part in ("key", "words"))
        text = Text.assemble((self.app.get_key_display(binding), key), (f" {binding.description}", words))
        if not enabled:
            text.stylize("dim")
        return text.on({"@click": f"app.simulate_key({binding.key!r})"})

    def _follow(self, screen: Screen[object]) -> None:
        if screen.app.app_focus and self.is_attached:
            self.show()
