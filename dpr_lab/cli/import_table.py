"""`dpr-lab import csv`: any logger's table becomes a run."""

from dataclasses import asdict
from itertools import count
from pathlib import Path
from typing import Annotated, Literal

import typer

from dpr_lab.cli.checks import positive
from dpr_lab.cli.console import emit, json_mode, say

import_app = typer.Typer(help="Turn foreign recordings into runs.", no_args_is_help=True, rich_markup_mode=None)


@import_app.callback()
def _group() -> None:
    pass


@import_app.command("csv")
def import_csv(
    file: Annotated[Path, typer.Argument(help="The table: one row a sample, a header naming the columns.")],
    rig: Annotated[str, typer.Option(help="Rig file, or the name of a built-in one.")],
    pose: Annotated[str | None, typer.Option(help="The rig's pose that the swing started from.")] = None,
    angles: Annotated[
        Literal["absolute", "relative"], typer.Option(help="theta2 to the vertical, or to the inner rod.")
    ] = "absolute",
    zero: Annotated[Literal["upright", "hanging"], typer.Option(help="Where the angles are zero.")] = "upright",
    unit: Annotated[Literal["rad", "deg", "counts"], typer.Option(help="What the angles are in.")] = "rad",
    time_unit: Annotated[Literal["s", "ms", "us"], typer.Option(help="What the time is in.")] = "s",
    columns: Annotated[
        str | None, typer.Option(help="Which column is which, e.g. t=time,theta1=q1,theta2=q2; guessed when left out.")
    ] = None,
    start_s: Annotated[float, typer.Option(min=0, help="Leave out so much of the beginning.")] = 0.0,
    duration_s: Annotated[float | None, typer.Option(callback=positive, help="Keep only so much.")] = None,
    out: Annotated[Path, typer.Option(help="Folder of the run.")] = Path("runs"),
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")] = False,
) -> None:
    """Import a table of angles. Gaps and uneven time stamps are kept; a doubled row is left out and counted.

    Example: dpr-lab import csv swing.csv --rig paper --pose X1 --angles relative --zero hanging --unit deg --out runs
    """
    json_mode(as_json)
    from dpr_lab.rig import load_rig
    from dpr_lab.storage.csv_import import ImportOptions
    from dpr_lab.storage.csv_import import import_csv as import_table
    from dpr_lab.storage.inspect import info

    options = ImportOptions(
        angles=angles,
        zero=zero,
        unit=unit,
        time_unit=time_unit,
        columns=_mapping(columns) if columns else {},
        start_s=start_s,
        duration_s=duration_s,
        pose=pose,
    )
    target = _unused(out, file.stem)
    import_table(file, load_rig(rig), options, target)
    found = info(target)
    if as_json:
        emit(asdict(found))
        return
    for note in found.notes:
        say(note)
    print(f"{target}: {found.samples} samples, {found.duration_s:.3f} s")


def _mapping(text: str) -> dict[str, str]:
    pairs = [[part.strip() for part in pair.split("=", 1)] for pair in text.split(",")]
    if any(len(pair) != 2 or not all(pair) for pair in pairs):
        raise typer.BadParameter(f"write name=column pairs, e.g. t=time,theta1=q1,theta2=q2, not {text!r}")
    mapping = dict(pairs)
    unknown = set(mapping) - {"t", "theta0", "theta1", "theta2"}
    if unknown:
        raise typer.BadParameter(f"there are t, theta0, theta1, theta2; not {', '.join(sorted(unknown))}")
    return mapping


def _unused(folder: Path, stem: str) -> Path:
    """A file name not taken yet: an import never overwrites a run."""
    names = (f"{stem}.mcap" if number == 1 else f"{stem}-{number}.mcap" for number in count(1))
    return next(folder / name for name in names if not (folder / name).exists())
