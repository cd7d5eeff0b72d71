"""`dpr-lab check`: record the result of a recommended check."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dpr_lab.cli.checks import TorqueKind, complete_rig, require_runs
from dpr_lab.cli.console import emit, line, report_table

if TYPE_CHECKING:
    from dpr_lab.gap.result.diagnosis import Diagnosis


def check(
    diagnosis: Annotated[
        Path,
        typer.Argument(
            help="Diagnosis: the folder of `diagnose --out`, or a file with the output of `diagnose --json`."
        ),
    ],
    check_id: Annotated[str, typer.Argument(metavar="ID", help="Identifier of the check, as listed by `diagnose`.")],
    runs: Annotated[list[Path] | None, typer.Argument(help="Run files (.mcap), if the check is a recording.")] = None,
    value: Annotated[
        str | None,
        typer.Option(
            help="Measured value with its unit, if the check is a measurement, such as '6.1 mN m', '0.5 %' or '3 mrad'."
        ),
    ] = None,
    std: Annotated[
        str | None,
        typer.Option(help="Standard uncertainty of the value. A number without a unit has the unit of the value."),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Accept a value that none of the candidate causes predicts.")
    ] = False,
    rig: Annotated[
        str | None,
        typer.Option(help="Rig file. Default: the rig file stored in the runs.", autocompletion=complete_rig),
    ] = None,
    torque: TorqueKind = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the new diagnosis.json and its report.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the new diagnosis as JSON on stdout.")] = False,
) -> None:
    """Record the result of a check and update the diagnosis.

    The probabilities of the causes are updated. The result is a measured value, or one or more runs. A value that none
    of the candidate causes predicts is refused unless --force is given. With --force, the value is evidence for a cause
    outside the candidates.

    Example: dpr-lab check diagnosis/diagnosis.json 1-3fa2 --value '2.1 mN m' --std '0.2 mN m' --out checked
    """
    require_runs(torque, runs)
    from dpr_lab.cli.listener import Listener
    from dpr_lab.workflows.check import take_check

    with Listener() as listener:
        updated = take_check(
            diagnosis,
            check_id,
            runs or (),
            value,
            std,
            rig_name=rig,
            out=out,
            torque=torque,
            confirmed=force,
            on_event=listener,
        )
    if as_json:
        emit(updated.to_json())
    else:
        show(updated, out)


def show(updated: "Diagnosis", out: Path | None) -> None:
    """Print the last check on stdout: its conclusion, and the probabilities before and after."""
    from dpr_lab.gap.result import RECORD
    from dpr_lab.report.gap import check_tables, tables

    done = updated.checks_done[-1]
    line(tables.sentence(updated))
    title = f"Check {done.check.id}: {done.result}"
    report_table(title, check_tables.moved_table(done))
    file = "DIAGNOSIS.json" if out is None else str(out / RECORD)
    if updated.checks and not check_tables.informative(updated.checks):
        remaining = ", ".join(check.id for check in updated.checks)
        line(f"Remaining checks ({remaining}): none of them is expected to add information.")
    elif updated.checks:
        checks = check_tables.check_table(updated)
        report_table("Remaining checks", checks, f"{checks.caption} {check_tables.how_to_record(updated, file)}")
    if out:
        line(f"diagnosis: {out / RECORD}")
