"""Groups of command-line options, declared as dataclasses.

If a parameter of a command has such a dataclass as its type, the command gets one option for each field.
"""

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.cli.checks import AnyClock, HeldOut, Library, MaxEffects, Seed, TorqueKind, Without, names_in

if TYPE_CHECKING:
    from dpr_lab.workflows.diagnose import DiagnoseRequest


def with_groups(command: Callable[..., None]) -> Callable[..., None]:
    """Replace each option group in the signature of a command by one option per field.

    A field of a group is declared as an option: `seed: Annotated[int, typer.Option(...)] = 0`.
    """
    parameters = inspect.signature(command).parameters
    groups = {
        name: parameter.annotation for name, parameter in parameters.items() if is_dataclass(parameter.annotation)
    }

    @wraps(command)
    def run(**values: Any) -> None:
        group: Any
        for name, group in groups.items():
            values[name] = group(**{field.name: values.pop(field.name) for field in fields(group)})
        command(**values)

    options = []
    for name, parameter in parameters.items():
        options += (
            _options(groups[name]) if name in groups else [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY)]
        )
    run.__signature__ = inspect.Signature(options)  # pyright: ignore[reportAttributeAccessIssue]
    return run


def _options(group: Any) -> list[inspect.Parameter]:
    """Return one parameter for each field of a group."""
    return [
        inspect.Parameter(f.name, inspect.Parameter.KEYWORD_ONLY, default=f.default, annotation=f.type)
        for f in fields(group)
    ]


@dataclass(frozen=True, slots=True)
class DiagnosisChoices:
    """Options that influence the result of a diagnosis. A certificate declares them."""

    held_out: HeldOut = None
    library: Library = None
    without: Without = None
    max_effects: MaxEffects = 4
    seed: Seed = 0
    any_clock: AnyClock = False
    torque: TorqueKind = None

    def request(self, runs: Sequence[Path], rig: str, **others: Any) -> "DiagnoseRequest":
        """Create the request for a diagnosis; `others` are further fields of the request."""
        from dpr_lab.workflows.diagnose import DiagnoseRequest

        return DiagnoseRequest(
            tuple(runs),
            rig,
            held_out=tuple(self.held_out or ()),
            library=names_in(self.library),
            without=tuple(self.without or ()),
            max_effects=self.max_effects,
            seed=self.seed,
            any_clock=self.any_clock,
            torque=self.torque,
            **others,
        )
