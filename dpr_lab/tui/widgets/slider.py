"""Slider that is moved by keys."""

from dataclasses import dataclass

from rich.text import Text
from textual.message import Message
from textual.reactive import reactive
from textual.widget import Widget

from dpr_lab.tui.keys import bindings


class Slider(Widget, can_focus=True):
    """Slider from 0 to a maximum, with a mark where the meaningful range ends."""

    DEFAULT_CSS = """
    Slider { height: 1; }
    Slider:focus { text-style: bold underline; }
    """
    BINDINGS = bindings("slider")
    value: reactive[float] = reactive(0.0)
    maximum: reactive[float] = reactive(1.0)
    mark: reactive[float | None] = reactive(None)

    @dataclass
    class Changed(Message):
        """The operator moved the slider."""

        slider: "Slider"

    def __init__(self, label: str, unit: str, step: float, *, id: str | None = None) -> None:
        super().__init__(id=id)
        self._label, self._unit, self._step = label, unit, step

    def validate_value(self, value: float) -> float:
        """Limit a value to the range, and round it to a step."""
        return min(max(round(value / self._step) * self._step, 0.0), self.maximum)

    def watch_maximum(self) -> None:
        """Change the maximum; the value is reduced if needed."""
        self.value = self.validate_value(self.value)

    def action_move(self, steps: int) -> None:
        """Move by a number of steps."""
        self._move_to(self.value + steps * self._step)

    def action_to(self, share: float) -> None:
        """Move to a fraction of the maximum."""
        self._move_to(share * self.maximum)

    def render(self) -> Text:
        """Return the label, the value, and a bar with the mark."""
        text = f"{self._label} {self.value:.2f} {self._unit} "
        width = max(self.size.width - len(text) - 2, 4)
        track = ["━" if i < self._column(self.value, width) else "─" for i in range(width)]
        if self.mark is not None:
            track[self._column(self.mark, width)] = "┃"
        track[self._column(self.value, width)] = "●"
        return Text(f"{text}├{''.join(track)}┤", no_wrap=True)

    def _column(self, value: float, width: int) -> int:
        return min(max(round(value / max(self.maximum, 1e-9) * (width - 1)), 0), width - 1)

    def _move_to(self, value: float) -> None:
        before = self.value
        self.value = value
        if self.value != before:
            self.post_message(self.Changed(self))
