"""`dpr-lab compare`: comparison of measured and simulated curves."""

from pathlib import Path
from typing import Annotated

import typer

from dpr_lab.cli.checks import AnyClock, Json, TorqueKind
from dpr_lab.cli.console import emit, line, table
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
    from dpr_lab.report.moving_arm import COMPARISON_COLUMNS as MOVING_ARM_COLUMNS
    from dpr_lab.report.moving_arm import comparison_rows as moving_arm_rows
    from dpr_lab.report.tables import COMPARISON_COLUMNS, COMPARISON_NOTE, comparison_rows
    from dpr_lab.workflows.compare import CompareRequest
    from dpr_lab.workflows.compare_moving_arm import compare_moving_arm

    with Listener() as listener:
        moving = compare_moving_arm(tuple(runs), model, out, any_clock, listener, torque)
    if moving is not None:
        if as_json:
            emit(moving)
        else:
            table("Measured and simulated angles by segment", MOVING_ARM_COLUMNS, moving_arm_rows(moving))
            line(f"report: {moving['report']}")
            line(f"table: {moving['file']}")
        return
    with Listener() as listener:
        request = CompareRequest(tuple(runs), model, out, torque=torque, any_clock=any_clock)
        compared = compare_runs(request, listener)
    if as_json:
        emit(compared.saved)
        return
    rows = comparison_rows(compared.comparisons)
    table("Measured and simulated angles", COMPARISON_COLUMNS, rows, note=COMPARISON_NOTE)
    line(f"report: {compared.saved['report']}")
