"""The command palette: every step, and every action with its key."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

from textual.app import App, SystemCommand
from textual.binding import Binding
from textual.dom import DOMNode

from dpr_lab.tui.keys import KeyNames
from dpr_lab.tui.steps.step import Step


def commands(
    app: App[Any], steps: Sequence[Step], keys: KeyNames, go: Callable[[int], None]
) -> Iterator[SystemCommand]:
    """Yield a command for each step and each action.

    An action of a step that is not displayed first calls `go` with the number of this step, which begins at 1.
    """
    for number, step in enumerate(steps, 1):
        yield SystemCommand(f"{number} {step.NAME}", f"Go to step {number}", partial(go, number))
        yield from _actions(step, step.NAME, keys, partial(go, number))
    yield from _actions(app, "dpr-lab", keys, lambda: None)


def _actions(owner: DOMNode, place: str, keys: KeyNames, show: Callable[[], None]) -> Iterator[SystemCommand]:
    """Yield a command for each key binding of a class that has a description."""
    for binding in owner.__class__.__dict__.get("BINDINGS", ()):
        if isinstance(binding, Binding) and binding.description:
            key = (
                keys.key_for(binding.id)
                if binding.id and binding.id in keys.keys
                else owner.app.get_key_display(binding)
            )
            run = partial(_run, owner, binding.action, show)
            yield SystemCommand(f"{place}: {binding.tooltip or binding.description}", f"key {key}", run)


async def _run(owner: DOMNode, action: str, show: Callable[[], None]) -> None:
    show()
    await owner.app.run_action(action, owner)
