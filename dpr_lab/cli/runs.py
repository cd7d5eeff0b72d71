"""`dpr-lab run info|verify|recover|export`: what is in a run file, and getting it out."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from dpr_lab.cli.console import emit, json_mode, say, table
from dpr_lab.errors import RunError

app = typer.Typer(help="Look at, check, repair and export run files.", no_args_is_help=True, rich_markup_mode=None)

RunFile = Annotated[Path, typer.Argument(help="A run file (.mcap).")]
Json = Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")]


@app.command()
def info(file: RunFile, as_json: Json = False) -> None:
    """What a run file holds: samples, duration, losses by cause, pose, rig, firmware.

    Example: dpr-lab run info runs/20261121T101500Z_X1_1a2b3c4d.mcap
    """
    json_mode(as_json)
    from dpr_lab.storage.inspect import info as inspect_run

    found = asdict(inspect_run(file))
    if as_json:
        emit(found)
    else:
        table(file.name, ("", "value"), [(key, _readable(value)) for key, value in found.items()], prose=True)


@app.command()
def verify(file: RunFile, as_json: Json = False) -> None:
    """Check a run file: its hash, every chunk's CRC, its ticks, its end. Ends with 3 when a check fails.

    Example: dpr-lab run verify runs/20261121T101500Z_X1_1a2b3c4d.mcap
    """
    json_mode(as_json)
    from dpr_lab.storage.inspect import verify as verify_run

    checked = verify_run(file)
    if as_json:
        emit({"file": str(file), **asdict(checked)})
    elif checked.ok:
        print(f"{file}: whole and unchanged")
    for fault in checked.faults:
        say(f"{file}: {fault}")
    if not checked.ok:
        raise typer.Exit(RunError.exit_code)


@app.command()
def recover(
    file: RunFile,
    out: Annotated[Path, typer.Option(help="The whole run to write.")],
    as_json: Json = False,
) -> None:
    """Write a whole run from a broken one: all samples up to the first damage.

    Example: dpr-lab run recover broken.mcap --out whole.mcap
    """
    json_mode(as_json)
    from dpr_lab.storage.inspect import info as inspect_run
    from dpr_lab.storage.inspect import recover as recover_run

    recover_run(file, out)
    kept = asdict(inspect_run(out))
    if as_json:
        emit({"out": str(out), **kept})
    else:
        print(f"{out}: {kept['samples']} samples, {kept['duration_s']:.3f} s kept")


@app.command()
def export(
    file: RunFile,
    out: Annotated[Path, typer.Option(help="File to write; its ending chooses the format: .csv .parquet .h5 .mat")],
    as_json: Json = False,
) -> None:
    """Write a run as CSV, Parquet, HDF5 or MATLAB file; angles in the paper's convention (absolute, upright = 0).

    Example: dpr-lab run export runs/20261121T101500Z_X1_1a2b3c4d.mcap --out run.csv
    """
    json_mode(as_json)
    from dpr_lab.storage.export import export as export_run
    from dpr_lab.storage.reader import load_run

    export_run(load_run(file), out)
    if as_json:
        emit({"out": str(out)})
    else:
        print(out)


def _readable(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_readable(item)}" for key, item in value.items()) or "-"
    if isinstance(value, list | tuple):
        return ", ".join(_readable(item) for item in value) or "-"
    return f"{value:.6g}" if isinstance(value, float) else "-" if value is None else str(value)
