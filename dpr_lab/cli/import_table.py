"""`dpr-lab import table`: import of a table of any logger as a run."""

import inspect
import math
import shlex
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dpr_lab.cli.checks import Elbow, Json, RigName, Rods, complete_pose
from dpr_lab.cli.console import emit, line, say, table
from dpr_lab.cli.listing import command_group
from dpr_lab.cli.plugin_listing import PluginListing
from dpr_lab.storage.tables.options import ImportOptions, TypedOption, parse_recorded_at, typed_options

if TYPE_CHECKING:
    from dpr_lab.storage.tables.understood import Understood

app = command_group(
    "Import recordings of other loggers.\n\nExample: dpr-lab import table swing.csv --rig paper --pose X1 --dry-run"
)


@app.callback()
def _group() -> None:
    pass


def import_table(
    file: Annotated[
        Path,
        typer.Argument(help="A table, .csv.gz, .json, .mat, .npz, .h5, .parquet, .mcap, or the folder of a ROS bag."),
    ],
    rig: RigName,
    rods: Rods = None,
    elbow: Elbow = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show how the table is interpreted, without writing a run.")
    ] = False,
    out: Annotated[Path, typer.Option(help="Folder for the run, or its file name NAME.mcap.")] = Path("runs"),
    as_json: Json = False,
    **typed: Any,
) -> None:
    """Import a table of any logger as a run. Gaps and uneven time stamps are kept; repeated rows are dropped.

    Formats: text tables, JSON, .mat, .npz, Parquet, HDF5, JointState in MCAP or a ROS 2 bag, points of Tracker or
    DeepLabCut.

    Example: dpr-lab import table swing.mat --rig paper --pose X1 --angles relative --zero hanging --dry-run
    """
    from dpr_lab.cli.listener import Listener
    from dpr_lab.workflows.import_table import ImportRequest, import_table, preview_table

    options = _options(typed)
    request = ImportRequest(file, rig, out, options, rods, elbow)
    if dry_run:
        with Listener() as listener:
            understood = preview_table(request, listener)
        _show(understood, as_json)
        return
    with Listener() as listener:
        imported = import_table(request, listener)
    if as_json:
        emit(asdict(imported.info))
        return
    for remark in imported.notes:
        say(remark)
    for question in imported.questions:
        say(f"warning: {question.sentence}")
    line(f"{imported.file}: {imported.samples} samples, {imported.duration_s:.3f} s")


def _with_options(command: Callable[..., None]) -> inspect.Signature:
    """Return the signature of the command, with one option for each field of `ImportOptions`."""
    signature = inspect.signature(command)
    file, rig, *others, _ = signature.parameters.values()
    return signature.replace(parameters=[file, rig, *map(_parameter, typed_options()), *others])


def _parameter(option: TypedOption) -> inspect.Parameter:
    limits: dict[str, Any] = {"min": option.typed.lowest, "max": option.typed.highest}
    limits = {name: limit for name, limit in limits.items() if math.isfinite(limit)}
    kind = list[str] if option.reads_text else option.kind  # a repeated option adds pairs
    if option.default is None:
        kind = kind | None
    flags = (f"--{option.name.replace('_', '-')}",)  # the name is stated, so that a switch gets no --no- form
    completion = complete_pose if option.name == "pose" else None
    annotation = Annotated[kind, typer.Option(*flags, help=option.typed.help, autocompletion=completion, **limits)]
    return inspect.Parameter(
        option.name, inspect.Parameter.POSITIONAL_OR_KEYWORD, default=option.default, annotation=annotation
    )


def _options(typed: Mapping[str, Any]) -> ImportOptions:
    """Create the import options from the values on the command line.

    Raises:
        BadParameter: a value is not valid or outside its limits.
    """
    readers = {option.name: option for option in typed_options() if option.reads_text}
    entered = {name: value for name, value in typed.items() if value or name not in readers}
    try:
        values = {
            name: readers[name].read(",".join(value)) if name in readers else value for name, value in entered.items()
        }
        if values["recorded_at"]:
            values["recorded_at"] = parse_recorded_at(values["recorded_at"])
        return ImportOptions(**values)
    except ValueError as error:
        name, space, message = str(error).partition(" ")
        name = f"--{name.replace('_', '-')}" if name in typed else name
        raise typer.BadParameter(f"{name}{space}{message}") from error


import_table.__signature__ = _with_options(import_table)  # pyright: ignore[reportFunctionMemberAccess]
app.command("table", cls=PluginListing)(import_table)
app.command("csv", help="Alias of `import table`. Example: dpr-lab import csv swing.csv --rig paper")(import_table)


def _show(understood: "Understood", as_json: bool) -> None:
    """Print how a table is interpreted, for `--dry-run`."""
    from dpr_lab.report.text_plot import text_chart
    from dpr_lab.storage.tables.understood import chart_title, names_of

    if as_json:
        emit(understood.to_json())
        return
    title = f"{understood.path.name}: interpretation (no run was written)"
    table(title, ("", "interpretation"), list(understood.facts().items()))
    rows = [[f"{value:.6f}" for value in row] for row in understood.first_rows()]
    table("First rows (rad)", ("t_s", *names_of(understood.joints)), rows)
    for joint in understood.joints:
        line(chart_title(joint))
        for drawn in text_chart(understood.t, understood.theta[:, joint]):
            line(drawn)
    for note in understood.notes:
        say(note)
    for question in understood.questions:
        say(f"warning: {question.sentence}")
    if understood.mend:
        say(f"add to the command: {shlex.join(understood.mend)}")
