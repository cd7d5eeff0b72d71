"""`dpr-lab import table`: a recording of any logger becomes a run."""

import math
import shlex
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from dpr_lab.cli.checks import Elbow, RigName, Rods, names_in, positive
from dpr_lab.cli.console import emit, json_mode, line, say, table
from dpr_lab.cli.listing import Listing

if TYPE_CHECKING:
    from dpr_lab.storage.tables.preview import Preview

import_app = typer.Typer(
    help="Import recordings of other loggers.", cls=Listing, no_args_is_help=True, rich_markup_mode=None
)

AXES = ("theta0", "theta1", "theta2")


@import_app.callback()
def _group() -> None:
    pass


def import_table(
    file: Annotated[
        Path, typer.Argument(help="A table, .csv.gz, .mat, .npz, .h5, .parquet, .mcap, or a bag's folder.")
    ],
    rig: RigName,
    pose: Annotated[str | None, typer.Option(help="Pose of the rig file from which the swing started.")] = None,
    angles: Annotated[
        Literal["absolute", "relative"], typer.Option(help="theta2 to the vertical, or to the inner rod.")
    ] = "absolute",
    zero: Annotated[Literal["upright", "hanging"], typer.Option(help="Pose in which the angles are zero.")] = "upright",
    unit: Annotated[
        Literal["rad", "deg", "counts"] | None,
        typer.Option(help="Unit of the angles; by default read from the column names."),
    ] = None,
    time_unit: Annotated[
        Literal["s", "ms", "us"] | None, typer.Option(help="Unit of the time; by default read from the column name.")
    ] = None,
    columns: Annotated[
        str | None, typer.Option(help="Names of the columns, e.g. t=time,theta1=q1,theta2=q2; recognised by default.")
    ] = None,
    take: Annotated[
        str | None,
        typer.Option(help="Part of the file: topic of a bag, arrays or groups, or the points PIVOT,ELBOW,TIP."),
    ] = None,
    rate_hz: Annotated[
        float | None, typer.Option(callback=positive, help="Sample rate, for a table without times.")
    ] = None,
    wrap: Annotated[
        float | None,
        typer.Option(callback=positive, help="Period at which the angles wrap, in their unit, e.g. 360 or 4096."),
    ] = None,
    time_wrap: Annotated[
        float | None,
        typer.Option(
            callback=positive, help="Period at which the times wrap, in their unit: 4294967296 for a 32-bit counter."
        ),
    ] = None,
    scale: Annotated[str | None, typer.Option(help="Multiply the angles: -1, or theta1=-1,theta2=0.5.")] = None,
    offset: Annotated[str | None, typer.Option(help="Then add, in their unit: 90, or theta1=90.")] = None,
    torque: Annotated[
        Literal["measured", "commanded", "none"] | None,
        typer.Option(help="Torques to use if the table has both kinds; none: treat it as a free swing."),
    ] = None,
    input_delay_s: Annotated[
        float, typer.Option(min=-1, max=1, help="Delay between the logged and the acting torques, s, if known.")
    ] = 0.0,
    arm: Annotated[
        Literal["clamped", "free", "prescribed", "driven"] | None,
        typer.Option(
            help="The arm was held, was free, moved as its encoder says, or was driven; else as the rig says."
        ),
    ] = None,
    rods: Rods = None,
    elbow: Elbow = None,
    keep_rest: Annotated[
        bool, typer.Option("--keep-rest", help="Keep all rows, also those in which the rods seem to be held.")
    ] = False,
    recorded_at: Annotated[
        str, typer.Option(help="Time of the recording, e.g. 2026-03-01 or 2026-03-01T14:30; local time without a zone.")
    ] = "",
    note: Annotated[str, typer.Option(help="A note stored with the run; `drift --by label` groups by it.")] = "",
    start_s: Annotated[float, typer.Option(min=0, help="Duration to cut from the beginning, s.")] = 0.0,
    duration_s: Annotated[float | None, typer.Option(callback=positive, help="Duration to keep, s.")] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show how the table is interpreted, without writing a run.")
    ] = False,
    out: Annotated[Path, typer.Option(help="Folder of the run.")] = Path("runs"),
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")] = False,
) -> None:
    """Import a table of any logger as a run; gaps and uneven time stamps are kept, repeated rows are dropped.

    Text in any form, .mat, .npz, Parquet, HDF5, JointState in MCAP or a ROS 2 bag, points of Tracker or DeepLabCut.

    Example: dpr-lab import table swing.mat --rig paper --pose X1 --angles relative --zero hanging --dry-run
    """
    json_mode(as_json)
    from dpr_lab.cli.listener import Listener
    from dpr_lab.storage.csv_import import ImportOptions
    from dpr_lab.workflows.import_table import ImportRequest, import_table, preview_table

    options = ImportOptions(
        angles=angles,
        zero=zero,
        unit=unit,
        time_unit=time_unit,
        columns=_mapping(columns, ("t", *AXES, "input")) if columns else {},
        take=names_in(take) or (),
        rate_hz=rate_hz,
        wrap=wrap,
        time_wrap=time_wrap,
        scale=_numbers("scale", scale),
        offset=_numbers("offset", offset),
        start_s=start_s,
        duration_s=duration_s,
        keep_rest=keep_rest,
        recorded_at=_date(recorded_at),
        note=note,
        pose=pose,
        torque=torque,
        input_delay_s=input_delay_s,
        arm=arm,
    )
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


import_app.command("table")(import_table)
import_app.command("csv", help="The same as `import table`. Example: dpr-lab import csv swing.csv --rig paper")(
    import_table
)


def _show(understood: "Preview", as_json: bool) -> None:
    """What was understood of a table; nothing was written."""
    from dpr_lab.report.text_plot import text_chart

    if as_json:
        emit(understood.to_json())
        return
    table(
        f"{understood.file.name}, nothing written yet",
        ("", "understood as"),
        list(understood.facts().items()),
    )
    rows = [[f"{value:.6f}" for value in row] for row in understood.first_rows()]
    table("First rows (rad; 0 upright)", ("t_s", *AXES), rows)
    for axis in (1, 2):
        line(f"{AXES[axis]}, 0 = upright")
        for drawn in text_chart(understood.t, understood.theta[:, axis]):
            line(drawn)
    for note in understood.notes:
        say(note)
    for question in understood.questions:
        say(f"warning: {question.sentence}")
    if understood.mend:
        say(f"add to the command: {shlex.join(understood.mend)}")


def _date(text: str) -> str:
    from dpr_lab.storage.tables.options import parse_recorded_at

    try:
        return parse_recorded_at(text) if text else ""
    except ValueError as error:
        raise typer.BadParameter(str(error).replace("recorded_at", "--recorded-at")) from error


def _numbers(option: str, text: str | None) -> dict[str, float]:
    """A number for both rods, or one for each axis that is named."""
    if not text:
        return {}
    pairs = _mapping(text, AXES) if "=" in text else dict.fromkeys(AXES[1:], text)
    try:
        numbers = {axis: float(number) for axis, number in pairs.items()}
    except ValueError as error:
        raise typer.BadParameter(
            f"--{option} takes numbers, e.g. -1 or theta1=-1,theta2=0.5, not {text[:50]!r}"
        ) from error
    if not all(map(math.isfinite, numbers.values())) or (option == "scale" and 0.0 in numbers.values()):
        raise typer.BadParameter(f"--{option} {text[:50]} is no finite number above or below 0")
    return numbers


def _mapping(text: str, names: tuple[str, ...]) -> dict[str, str]:
    pairs = [[part.strip() for part in pair.split("=", 1)] for pair in text.split(",")]
    if any(len(pair) != 2 or not all(pair) for pair in pairs):
        raise typer.BadParameter(f"write name=column pairs, e.g. t=time,theta1=q1,theta2=q2, not {text!r}")
    mapping = dict(pairs)
    unknown = set(mapping) - set(names)
    if unknown:
        raise typer.BadParameter(f"there are {', '.join(names)}; not {', '.join(sorted(unknown))}")
    return mapping
