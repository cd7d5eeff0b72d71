"""`dpr-lab accept`: test a rig against limits."""

from pathlib import Path
from typing import Annotated

import typer

from dpr_lab.cli.checks import AnyClock, RigName, TorqueKind
from dpr_lab.cli.console import emit, json_mode, line, table
from dpr_lab.shown import listed

EXIT_CODES = {"pass": 0, "fail": 1, "not decidable": 9}
"""Exit code of each answer."""


def accept(
    runs: Annotated[list[Path], typer.Argument(help="Run files (.mcap); three releases or more decide more limits.")],
    rig: RigName,
    limits: Annotated[Path, typer.Option(help="Limits file (TOML): sizes of effects and ranges of ratios.")],
    any_clock: AnyClock = False,
    torque: TorqueKind = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")] = False,
) -> None:
    """Test whether a rig meets the limits in a file: pass, fail or not decidable, by equivalence tests at 95 %.

    Exit with 1 if a limit fails, with 9 if none fails but one is not decidable with these recordings.

    Example: dpr-lab accept runs/*.mcap --rig paper --limits limits.toml
    """
    json_mode(as_json)
    from dpr_lab.cli.listener import Listener
    from dpr_lab.workflows.accept import accept as accept_runs
    from dpr_lab.workflows.diagnose import DiagnoseRequest

    with Listener() as listener:
        done = accept_runs(DiagnoseRequest(tuple(runs), rig, any_clock=any_clock, torque=torque), limits, listener)
    acceptance = done.acceptance
    if as_json:
        emit(done.to_json())
    else:
        passed = sum(limit.answer == "pass" for limit in acceptance.limits)
        line(f"{acceptance.answer}: {passed} of {len(acceptance.limits)} limits pass")
        line(acceptance.sentence)
        rows = [
            (
                limit.quantity,
                _range(limit.lower, limit.upper),
                _range(*(limit.interval90 or (None, None))),
                limit.unit,
                limit.answer,
                limit.reason,
            )
            for limit in acceptance.limits
        ]
        table("Limits", ("quantity", "limits", "90 % interval", "unit", "answer", "reason"), rows)
        if acceptance.would_decide:
            line(f"These releases are expected to decide {listed(acceptance.would_decide)}:")
            for number, release in enumerate(acceptance.recordings, 1):
                line(f"{number}. {release}")
    raise typer.Exit(EXIT_CODES[acceptance.answer])


def _range(low: float | None, high: float | None) -> str:
    if low is None:
        return "none" if high is None else f"below {high:.4g}"
    return f"above {low:.4g}" if high is None else f"{low:.4g} to {high:.4g}"
