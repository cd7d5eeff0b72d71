"""Shared command-line options, and checks of their values before a command starts."""

import math
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from glob import escape, glob
from pathlib import Path
from pkgutil import resolve_name
from typing import Annotated, Literal

import typer

from dpr_lab.cli.console import folded
from dpr_lab.errors import known_name, unknown_name


def positive(value: float | None) -> float | None:
    """Check that the value of an option is None, or finite and positive.

    Raises:
        BadParameter: any other value.
    """
    if value is not None and not 0 < value < math.inf:
        raise typer.BadParameter(f"must be above 0 and finite, not {value:g}")
    return value


def require_runs(torque: str | None, runs: Iterable[Path] | None) -> None:
    """Refuse the option --torque if no runs are given, because it selects the torques of runs.

    Raises:
        BadParameter: --torque is given without runs.
    """
    if torque is not None and not runs:
        raise typer.BadParameter("--torque requires runs")


@dataclass(frozen=True, slots=True)
class Choices:
    """Names that an option accepts: one name, or several separated by commas.

    The table of the names is imported when it is first used. Locations are written as `module:name`.
    """

    what: str
    """Noun for one of the names in error messages, for example `effect`."""
    table: str
    """Location of the table of the names."""
    words: str = "builtins:str"
    """Location of the function that converts a name to its description, which may end with the identifier in
    brackets."""

    @property
    def names(self) -> Iterable[str]:
        """All names of the table."""
        return resolve_name(self.table)

    @property
    def worded(self) -> Callable[[str], str]:
        """Function that converts a name to its description."""
        return resolve_name(self.words)

    def complete(self, incomplete: str) -> list[tuple[str, str]]:
        """Return the completions of the last name: pairs of completed text and description.

        Names are separated by commas; a name that is already in the list is not completed again.
        """
        before, comma, prefix = incomplete.rpartition(",")
        matching = (name for name in self.names if name.startswith(prefix) and name not in before.split(","))
        return [(f"{before}{comma}{name}", self.worded(name).removesuffix(f" [{name}]")) for name in matching]

    def check(self, value: str | None) -> str | None:
        """Convert a comma-separated list of identifiers or descriptions to a comma-separated list of identifiers.

        Raises:
            BadParameter: an unknown name.
        """
        return None if value is None else ",".join(map(self._known, self._split(value)))

    def check_each(self, value: list[str] | None) -> list[str] | None:
        """Convert a repeated option to a list of identifiers.

        Each value may be a comma-separated list.

        Raises:
            BadParameter: an unknown name.
        """
        return None if value is None else [self._known(name) for text in value for name in self._split(text)]

    def _split(self, value: str) -> list[str]:
        """Split a list at commas, but not in descriptions such as 'Coulomb friction, joint 1'."""
        parts: list[str] = []
        for part in value.split(","):
            whole = f"{parts[-1]},{part}" if parts else ""
            if whole and known_name(whole, self.names, self.worded):
                parts[-1] = whole
            else:
                parts.append(part)
        return parts

    def _known(self, text: str) -> str:
        name = known_name(text, self.names, self.worded)
        if name is None:
            message = unknown_name(f"no {self.what} named {text.strip() or repr(text)}", text, self.names, self.worded)
            raise typer.BadParameter(folded(message, sys.stderr, len("Error: Invalid value for '--objective': ")))
        return name


def names_in(text: str | None) -> tuple[str, ...] | None:
    """Split a text at its commas and return the names; return None for None."""
    return None if text is None else tuple(name.strip() for name in text.split(",") if name.strip())


def complete_rig(incomplete: str) -> list[str]:
    """Return the completions of a rig option: built-in rigs, rig files and folders.

    A shell appends a blank if there is only one completion. A single folder is therefore returned together with the
    completions of its content.
    """
    from dpr_lab.configs import built_in

    paths = sorted(glob(f"{escape(incomplete)}*"))
    folders = [f"{path}/" for path in paths if Path(path).is_dir()]
    files = [path for path in paths if path.endswith(".toml")]
    matching = [*(name for name in built_in("rigs") if name.startswith(incomplete)), *files, *folders]
    if len(matching) > 1 or not folders:
        return matching
    inner = complete_rig(folders[0])
    return [*folders, *inner] if inner else []


def complete_pose(ctx: typer.Context, incomplete: str) -> list[str]:
    """Return the names of poses that start with a text.

    The poses are those of the option --rig if it precedes the text on the command line. Otherwise they are those of the
    built-in rig `paper`, because `rig new` writes poses with the same names.
    """
    from dpr_lab.errors import ConfigError
    from dpr_lab.rig import load_rig

    try:
        return [name for name in load_rig(ctx.params.get("rig") or "paper").poses if name.startswith(incomplete)]
    except ConfigError:
        return []


SEARCHES = Choices("search", "dpr_lab.search:ALGORITHMS", "dpr_lab.search:search_words")
OBJECTIVE_NAMES = Choices(
    "objective", "dpr_lab.identification.objectives:OBJECTIVES", "dpr_lab.identification.objectives:objective_words"
)
EFFECT_NAMES = Choices("effect", "dpr_lab.effects:EFFECTS", "dpr_lab.report.words:named")
EXPORT_NAMES = Choices("format", "dpr_lab.exports:FORMATS", "dpr_lab.exports:format_words")
REASON_NAMES = Choices("reason", "dpr_lab.workflows.diagnose:REASONS")

NO_RIG = (
    "A rig file contains lengths and masses of the rig. `dpr-lab rig new` writes a rig file; for a single rod, add"
    " --rods inner --l1 0.3 --m1 0.1. `dpr-lab rig list` lists the built-in rigs"
)
"""Advice that is printed if a command lacks --rig."""

RigName = Annotated[str, typer.Option(help="Rig file, or name of a built-in rig.", autocompletion=complete_rig)]
Library = Annotated[
    str | None,
    typer.Option(
        help="Candidate effects as identifiers or names, separated by commas. Default: all effects in"
        " docs/effects.md. The Tab key completes names.",
        callback=EFFECT_NAMES.check,
        autocompletion=EFFECT_NAMES.complete,
    ),
]
Without = Annotated[
    list[str] | None,
    typer.Option(
        help="Effects to exclude, as identifiers or names, separated by commas; may be repeated.",
        callback=EFFECT_NAMES.check_each,
        autocompletion=EFFECT_NAMES.complete,
    ),
]
MaxEffects = Annotated[int, typer.Option(min=1, max=8, help="Maximum number of effects in the model.")]
HeldOut = Annotated[
    list[Path] | None, typer.Option(help="Held-out run: used to validate the diagnosis, not fitted; may be repeated.")
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]
AnyJson = Annotated[bool, typer.Option("--json", help="Print JSON on stdout.")]
Seed = Annotated[int, typer.Option(min=0, help="Seed of the random numbers; the same seed gives the same result.")]
AnyClock = Annotated[
    bool,
    typer.Option(
        "--any-clock",
        help="Accept runs of a device whose clock rate error is larger than that of a crystal oscillator.",
    ),
]
TorqueKind = Annotated[
    Literal["measured", "commanded"] | None,
    typer.Option(
        "--torque", help="Torques to use if runs contain both measured and commanded torques. Default: measured."
    ),
]
Rods = Annotated[
    Literal["both", "inner", "outer"] | None,
    typer.Option(
        help="Rods that are mounted. A single rod is always mounted on joint 1. Default: the value in the rig file."
    ),
]
ArmMode = Annotated[
    Literal["clamped", "free", "prescribed", "driven"] | None,
    typer.Option("--arm", help="Mode of the arm (joint 0) in these runs. Default: the value in the rig file."),
]
InnerMode = Annotated[
    Literal["free", "prescribed"] | None,
    typer.Option(
        "--inner",
        help=(
            "Mode of joint 1: free, or moved by a stiff drive and prescribed by its encoder. Default: the value in"
            " the rig file."
        ),
    ),
]
Elbow = Annotated[
    Literal["free", "clamped"] | None,
    typer.Option(help="Whether joint 2 can turn. Default: the value in the rig file."),
]
