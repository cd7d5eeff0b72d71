"""`dpr-lab drift`: changes of parameters between groups of runs."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from dpr_lab.cli.checks import AnyClock, Json, RigName, TorqueKind
from dpr_lab.cli.console import emit, line, report_table


def drift(
    runs: Annotated[
        list[Path], typer.Argument(help="Run files (.mcap) of at least two groups. Each group needs the same poses.")
    ],
    rig: RigName,
    by: Annotated[
        Literal["day", "session", "label"],
        typer.Option(
            help="Grouping of the runs: by day, by session (sessions are separated by pauses of one hour), or"
            " by label (the note of the run, or the folder of a run without a note)."
        ),
    ] = "day",
    diagnosis: Annotated[
        Path | None,
        typer.Option(help="Diagnosis: its JSON file or folder. The sizes of its effects are also compared."),
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(help="Model of `identify`, or folder of a diagnosis: initial values of the fit."),
    ] = None,
    fail_on_drift: Annotated[
        bool, typer.Option("--fail-on-drift", help="Exit with code 1 if a parameter changed.")
    ] = False,
    out: Annotated[Path | None, typer.Option(help="Folder for the control charts and the report.")] = None,
    any_clock: AnyClock = False,
    torque: TorqueKind = None,
    as_json: Json = False,
) -> None:
    """Find parameters that changed between groups of runs.

    The size of each change is stated.

    Example: dpr-lab drift runs/*.mcap --rig paper --by day --fail-on-drift --out drift
    """
    from dpr_lab.cli.listener import Listener
    from dpr_lab.workflows.drift import watch_drift

    with Listener() as listener:
        result = watch_drift(
            runs,
            rig,
            by,
            diagnosis=diagnosis,
            model=model,
            out=out,
            any_clock=any_clock,
            torque=torque,
            on_event=listener,
        )
    if as_json:
        emit(result.to_json())
    else:
        from dpr_lab.report.drift import basis_sentence, change_table, sentence

        line(sentence(result.drift))
        report_table("Changes of parameters", change_table(result.drift), basis_sentence(result.drift, result.torques))
        if "report" in result.files:
            line(f"report: {result.files['report']}")
    if fail_on_drift and result.drift.moved:
        raise typer.Exit(1)
