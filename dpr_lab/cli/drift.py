"""`dpr-lab drift`: what changed since yesterday."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from dpr_lab.cli.checks import AnyClock, RigName, TorqueKind
from dpr_lab.cli.console import emit, json_mode, line, table


def drift(
    runs: Annotated[
        list[Path], typer.Argument(help="Run files (.mcap) of two groups or more, the same poses in each.")
    ],
    rig: RigName,
    by: Annotated[
        Literal["day", "session", "label"],
        typer.Option(
            help="What makes a group: the day, a pause of an hour, or the run's note (its folder without one)."
        ),
    ] = "day",
    diagnosis: Annotated[
        Path | None, typer.Option(help="What diagnose --json printed: the sizes of its effects are watched too.")
    ] = None,
    model: Annotated[Path | None, typer.Option(help="The model that `identify` wrote, to start from.")] = None,
    fail_on_drift: Annotated[bool, typer.Option("--fail-on-drift", help="End with 1 when something moved.")] = False,
    out: Annotated[Path | None, typer.Option(help="Folder of control charts and page.")] = None,
    any_clock: AnyClock = False,
    torque: TorqueKind = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")] = False,
) -> None:
    """Say which parameters of a rig moved between groups of runs, by how much and between which groups.

    Example: dpr-lab drift runs/*.mcap --rig paper --by day --fail-on-drift --out drift
    """
    json_mode(as_json)
    from dpr_lab.cli.listener import Listener
    from dpr_lab.workflows.drift import DriftRequest, watch_drift

    with Listener() as listener:
        found = watch_drift(DriftRequest(tuple(runs), rig, by, diagnosis, model, out, any_clock, torque), listener)
    if as_json:
        emit(found.to_json())
    else:
        from dpr_lab.report.drift import COLUMNS, basis_sentence, rows, sentence

        line(sentence(found.drift))
        table("What moved", COLUMNS, rows(found.drift), note=basis_sentence(found.drift, found.torques))
        if "report" in found.files:
            line(f"report: {found.files['report']}")
    if fail_on_drift and found.drift.moved:
        raise typer.Exit(1)
