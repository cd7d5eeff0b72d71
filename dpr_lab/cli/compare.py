"""`dpr-lab compare`: comparison of measured and simulated curves."""

from pathlib import Path
from typing import Annotated

import typer

from dpr_lab.cli.checks import AnyClock, Json, TorqueKind
from dpr_lab.cli.console import emit, line, report_table
from dpr_lab.workflows.compare import compare as compare_runs


def compare(
    runs: Annotated[
        list[Path],
        typer.Argument(help="Run files (.mcap). Runs that were not used to fit the model are held-out runs."),
    ],
    model: Annotated[Path, typer.Option(help="Model written by `identify` or `diagnose`, or folder of a diagnosis.")],
    out: Annotated[Path, typer.Option(help="Folder for the figures and the report.")] = Path("report"),
    any_clock: AnyClock = False,
    torque: TorqueKind = None,
    as_json: Json = False,
) -> None:
    """Compare recorded and simulated swings: figures, residuals and a one-file HTML report.

    Example: dpr-lab compare runs/*.mcap --model model.json --out report
    """
    from dpr_lab.cli.listener import Listener
    from dpr_lab.report import moving_arm, tables
    from dpr_lab.report.figures import by_kind
    from dpr_lab.workflows.compare import CompareRequest

    with Listener() as listener:
        request = CompareRequest(tuple(runs), model, out, torque=torque, any_clock=any_clock)
        compared = compare_runs(request, listener)
    saved, title = compared.saved, "Measured and simulated angles"
    if as_json:
        emit(saved)
        return
    of_arms, of_rods = by_kind(compared.comparisons)
    if of_arms:
        report_table(f"{title} by segment", moving_arm.comparison_table(saved))
    else:
        report_table(title, tables.comparison_table(of_rods))
    line(f"report: {saved['report']}")
    if of_arms:
        line(f"table: {saved['file']}")
