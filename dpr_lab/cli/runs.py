"""`dpr-lab run info|verify|recover|export|layout`: inspection, verification, export and viewer layouts of run files."""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from dpr_lab.cli.checks import Choices, Json, complete_rig
from dpr_lab.cli.console import emit, line, say, table
from dpr_lab.cli.listing import command_group
from dpr_lab.errors import RunError

app = command_group("Inspect, check, repair and export run files.\n\nExample: dpr-lab run info runs/*.mcap")


VIEWER_NAMES = Choices("viewer", "dpr_lab.storage.viewers:VIEWERS")

RunFile = Annotated[Path, typer.Argument(help="A run file (.mcap).")]
RunFiles = Annotated[list[Path], typer.Argument(help="Run files (.mcap).")]
JsonEach = Annotated[
    bool, typer.Option("--json", help="Print JSON on stdout: an object for one file, a list of objects for several.")
]


@app.command()
def info(files: RunFiles, as_json: JsonEach = False) -> None:
    """Show the contents of run files: samples, duration, losses by cause, pose, rig, firmware.

    The exit code is 3 if a file is not a run.

    Example: dpr-lab run info runs/20261121T101500Z_X1_1a2b3c4d.mcap
    """
    from dpr_lab.cli.run_info import info_rows
    from dpr_lab.storage.inspect import info as inspect_run

    def show(summary: dict[str, Any]) -> None:
        table(Path(summary["file"]).name, ("quantity", "value"), info_rows(summary))

    _each(files, lambda file: asdict(inspect_run(file)), show, as_json)


@app.command()
def verify(files: RunFiles, as_json: JsonEach = False) -> None:
    """Check the integrity of run files.

    The hash, the CRC of every chunk, the ticks and the end of each file are checked. The exit code is 3 if a check
    fails. `dpr-lab run recover` saves the valid part of a damaged file.

    Example: dpr-lab run verify runs/*.mcap
    """
    from dpr_lab.storage.inspect import unchanged
    from dpr_lab.storage.inspect import verify as verify_run

    def check(file: Path) -> dict[str, Any]:
        checked = verify_run(file)
        for fault in checked.faults:
            say(f"{file}: {fault}")
        return {"file": file, **asdict(checked)}

    def show(outcome: dict[str, Any]) -> None:
        if outcome["ok"]:
            line(f"{outcome['file']}: {unchanged(outcome['interrupted'])}")

    _each(files, check, show, as_json)


@app.command()
def recover(
    file: RunFile,
    out: Annotated[Path, typer.Option(help="Run file to write.")],
    rig: Annotated[
        str | None,
        typer.Option(
            help="Corrected rig file to store in the new run. Default: the rig of the run.", autocompletion=complete_rig
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a valid run from a damaged one, or a run with a corrected rig file.

    The new run contains all samples up to the first damage. Channels of other programs are not copied, but named.

    Example: dpr-lab run recover broken.mcap --out whole.mcap

    Example: dpr-lab run recover wrong_mass.mcap --rig corrected.toml --out corrected.mcap
    """
    from dpr_lab.rig import load_rig
    from dpr_lab.storage.inspect import NOT_COPIED
    from dpr_lab.storage.inspect import info as inspect_run
    from dpr_lab.storage.inspect import recover as recover_run

    recover_run(file, out, load_rig(rig) if rig is not None else None)
    summary = asdict(inspect_run(out))
    if as_json:
        emit({"out": out, **summary})
    else:
        line(f"{out}: {summary['samples']} samples, {summary['duration_s']:.3f} s recovered")
        if summary["stopped"]:
            line(f"The recording was {summary['stopped']}")
        for note in summary["notes"]:
            if note.startswith(NOT_COPIED):
                say(note)


@app.command()
def export(
    file: RunFile,
    out: Annotated[
        Path, typer.Option(help="File to write; its suffix is the format: .csv .parquet .h5 .hdf5 .nc .mat .mcap")
    ],
    as_json: Json = False,
) -> None:
    """Write a run as CSV, Parquet, HDF5, NetCDF, MATLAB or JointState (MCAP, ROS 2). Angles are absolute, upright = 0.

    Example: dpr-lab run export runs/20261121T101500Z_X1_1a2b3c4d.mcap --out run.csv
    """
    from dpr_lab.storage.export import export as export_run
    from dpr_lab.storage.reader import load_run

    written = export_run(load_run(file), out)
    if as_json:
        emit({"out": written})
    else:
        line(written)


@app.command()
def layout(
    viewer: Annotated[
        str,
        typer.Argument(
            help="foxglove or plotjuggler.", callback=VIEWER_NAMES.check, autocompletion=VIEWER_NAMES.complete
        ),
    ],
    out: Annotated[
        Path | None, typer.Option(help="File to write; default: dpr-lab.foxglove.json for Foxglove.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a layout for run files in Foxglove or PlotJuggler.

    The layout shows angles, torques and losses.

    Example: dpr-lab run layout foxglove --out dpr-lab.foxglove.json
    """
    from dpr_lab.storage.viewers import VIEWERS
    from dpr_lab.whole_file import write_text

    source = VIEWERS[viewer]
    file = out or Path(source.name)
    if file.exists():
        raise RunError(f"{file}: exists already; choose another name")
    write_text(file, source.read_text(encoding="utf-8"), RunError)
    if as_json:
        emit({"out": file})
    else:
        line(file)


def _each(
    files: Sequence[Path], look: Callable[[Path], dict[str, Any]], show: Callable[[dict[str, Any]], None], json: bool
) -> None:
    """Inspect every file, and exit with code 3 afterwards if any file is damaged."""
    summaries: list[dict[str, Any]] = []
    for file in files:
        try:
            summaries.append(look(file))
        except RunError as error:
            if len(files) == 1:
                raise
            say(str(error))
            summaries.append({"file": file, "error": str(error), "exit_code": error.exit_code})
        else:
            if not json:
                show(summaries[-1])
    if json:
        emit(summaries if len(files) > 1 else summaries[0])
    if not all(summary.get("ok", "error" not in summary) for summary in summaries):
        raise typer.Exit(RunError.exit_code)
