"""The command palette: every step, and every action with its key."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from textual.app import App, SystemCommand
from textual.binding import Binding
from textual.dom import DOMNode

from dpr_lab.tui.keys import KeyNames
from dpr_lab.tui.steps.step import Step


@dataclass(frozen=True, slots=True)
class Palette:
    """Contents of the command palette."""

    app: App[Any]
    steps: Sequence[Step]
    keys: KeyNames
    go: Callable[[int], None]
    """Function that shows a step, numbered from 1."""

    def commands(self) -> Iterator[SystemCommand]:
        """Yield a command for each step and each action.

        An action of another step first shows that step.
        """
        for number, step in enumerate(self.steps, 1):
            yield SystemCommand(f"{number} {step.NAME}", f"Go to step {number}", partial(self.go, number))
            yield from (self._command(binding, step.NAME, number) for binding in _bindings(step))
        numbers = [str(number) for number in range(1, len(self.steps) + 1)]
        yield from (self._command(b, "dpr-lab", 0) for b in _bindings(self.app) if b.key not in numbers)

    def _command(self, binding: Binding, place: str, number: int) -> SystemCommand:
        words = binding.tooltip or binding.description
        known = binding.id is not None and binding.id in self.keys.keys
        key = self.keys.of(binding.id or "") if known else self.app.get_key_display(binding)

        async def act() -> None:
            if number:
                self.go(number)
            await self.app.run_action(binding.action, self.steps[number - 1] if number else self.app)

        return SystemCommand(f"{place}: {words}", f"key {key}", act)


def _bindings(owner: DOMNode) -> list[Binding]:
    """Return those key bindings of a class that have a description."""
    bindings = owner.__class__.__dict__.get("BINDINGS", ())
    return [binding for binding in bindings if isinstance(binding, Binding) and binding.description]
