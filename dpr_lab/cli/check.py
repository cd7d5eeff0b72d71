"""`dpr-lab check`: the result of an advised check is taken back."""

from pathlib import Path
from typing import Annotated

import typer

from dpr_lab.cli.checks import TorqueKind, complete_rig, positive
from dpr_lab.cli.console import emit, json_mode, line, table


def check(
    diagnosis: Annotated[Path, typer.Argument(help="What diagnose --json printed.")],
    check_id: Annotated[str, typer.Argument(metavar="ID", help="Id of the check that was done.")],
    runs: Annotated[list[Path] | None, typer.Argument(help="The recording that it asked for (.mcap).")] = None,
    value: Annotated[float | None, typer.Option(help="What was measured, in the unit that the check names.")] = None,
    std: Annotated[float | None, typer.Option(callback=positive, help="Its standard uncertainty.")] = None,
    rig: Annotated[
        str | None,
        typer.Option(help="Rig file; the one stored with the run when left out.", autocompletion=complete_rig),
    ] = None,
    torque: TorqueKind = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the new diagnosis.json and its page.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The new diagnosis as JSON on stdout.")] = False,
) -> None:
    """Take the result of an advised check back: probabilities move, and a new diagnosis names its parent.

    Example: dpr-lab check diagnosis/diagnosis.json 1-3fa2 --value 0.0021 --std 0.0002 --out checked
    """
    json_mode(as_json)
    if (value is None) != (std is None):
        raise typer.BadParameter("--value and --std go together: a measured value needs its standard uncertainty")
    if value is not None and runs:
        raise typer.BadParameter("give runs or a value, not both")
    from dpr_lab.cli.listener import Listener
    from dpr_lab.workflows.check import CheckRequest, take_check

    with Listener() as listener:
        request = CheckRequest(diagnosis, check_id, tuple(runs or ()), value, std, rig, out, torque)
        found = take_check(request, listener)
    if as_json:
        emit(found.to_json())
        return
    from dpr_lab.report.gap import tables
    from dpr_lab.workflows.diagnose import RECORD

    done = found.checks_done[-1]
    line(tables.sentence(found))
    table(f"Check {done.check.id}: {done.result}", tables.MOVED_COLUMNS, tables.moved_rows(done))
    if out:
        line(f"diagnosis: {out / RECORD}")
