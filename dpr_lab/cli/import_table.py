"""`dpr-lab import csv`: any logger's table becomes a run."""

from pathlib import Path
from typing import Annotated

import typer

from dpr_lab.cli.console import emit, json_mode, say
from dpr_lab.errors import ConfigError

import_app = typer.Typer(help="Turn foreign recordings into runs.", no_args_is_help=True, rich_markup_mode=None)


@import_app.callback()
def _group() -> None:
    pass


@import_app.command("csv")
def import_csv(
    file: Annotated[Path, typer.Argument(help="The table: one row a sample, a header naming the columns.")],
    rig: Annotated[str, typer.Option(help="Rig file, or the name of a built-in one.")],
    pose: Annotated[str | None, typer.Option(help="The rig's pose that the swing started from.")] = None,
    angles: Annotated[str, typer.Option(help="theta2 is absolute, or relative to the inner rod.")] = "absolute",
    zero: Annotated[str, typer.Option(help="Where the angles are zero: upright or hanging.")] = "upright",
    unit: Annotated[str, typer.Option(help="rad, deg or counts.")] = "rad",
    columns: Annotated[
        str | None, typer.Option(help="Which column is which, e.g. t=time,theta1=q1,theta2=q2; guessed when left out.")
    ] = None,
    start_s: Annotated[float, typer.Option(help="Leave out what comes before this time of the table.")] = 0.0,
    duration_s: Annotated[float | None, typer.Option(help="Keep only so much.")] = None,
    out: Annotated[Path, typer.Option(help="Folder of the run.")] = Path("runs"),
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")] = False,
) -> None:
    """Import a table of angles. Gaps and uneven time stamps are kept; a doubled row is left out and counted.

    Example: dpr-lab import csv swing.csv --rig paper --pose X1 --angles relative --zero hanging --unit deg --out runs
    """
    json_mode(as_json)
    from dpr_lab.rig import load_rig
    from dpr_lab.storage.csv_import import import_csv as import_table

    described = load_rig(rig)
    written = import_table(
        file,
        described,
        pose=pose,
        angles=angles,
        zero=zero,
        unit=unit,
        columns=_mapping(columns) if columns else None,
        start_s=start_s,
        duration_s=duration_s,
        out=out,
    )
    from dpr_lab.storage.inspect import info

    found = info(written).to_json()
    if as_json:
        emit(found)
        return
    for note in found.get("notes", []):
        say(note)
    print(f"{written}: {found['samples']} samples, {found['duration_s']:.3f} s")


def _mapping(text: str) -> dict[str, str]:
    pairs = [pair.split("=", 1) for pair in text.split(",")]
    if any(len(pair) != 2 or not pair[0] or not pair[1] for pair in pairs):
        raise ConfigError(f"--columns {text}: write name=column pairs, e.g. t=time,theta1=q1,theta2=q2")
    return {name.strip(): column.strip() for name, column in pairs}
