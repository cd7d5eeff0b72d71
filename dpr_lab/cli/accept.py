"""`dpr-lab accept`: test a rig against limits."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dpr_lab.cli.checks import AnyClock, Json, RigName, TorqueKind
from dpr_lab.cli.console import emit, line, report_table
from dpr_lab.cli.diagnose import show_files

if TYPE_CHECKING:
    from dpr_lab.acceptance.judge import Acceptance

EXIT_CODES = {"pass": 0, "fail": 1, "not decidable": 9}
"""Exit code for each result of the test."""


def accept(
    runs: Annotated[
        list[Path],
        typer.Argument(help="Run files (.mcap). With three or more releases, more limits can be decided."),
    ],
    rig: RigName,
    limits: Annotated[
        Path,
        typer.Option(
            help="Limits file (TOML): limits on effects, friction torques, ratios and the error of a free run."
        ),
    ],
    diagnosis: Annotated[
        Path | None,
        typer.Option(help="Diagnosis of these runs: its JSON file or folder. Default: the runs are diagnosed first."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for accept.json and for the diagnosis report, which includes the limits."),
    ] = None,
    any_clock: AnyClock = False,
    torque: TorqueKind = None,
    as_json: Json = False,
) -> None:
    """Test whether a rig meets the limits in a file.

    The result is pass, fail or not decidable, by equivalence tests at 95 %.

    Exit code: 0 all limits pass; 1 a limit fails; 9 no limit fails, but at least one is not decidable with these
    recordings. Without a result: 2 or 3 wrong options, input or output; 8 wrong description of the readings; 70 bug;
    130 interrupted.

    Example: dpr-lab accept runs/*.mcap --rig paper --limits limits.toml --out out/acceptance
    """
    from dpr_lab.cli.listener import Listener
    from dpr_lab.workflows.accept import accept as accept_runs
    from dpr_lab.workflows.diagnose import DiagnoseRequest

    with Listener() as listener:
        request = DiagnoseRequest(tuple(runs), rig, out=out, any_clock=any_clock, torque=torque)
        accepted = accept_runs(request, limits, listener, diagnosis)
    acceptance = accepted.acceptance
    if as_json:
        emit(accepted.to_json())
    else:
        show(acceptance)
        show_files(accepted.files)
    raise typer.Exit(EXIT_CODES[acceptance.answer])


def show(acceptance: "Acceptance") -> None:
    """Print the result of each limit."""
    from dpr_lab.report.gap.acceptance import answer_sentence, deciding_sentence, limit_note, limit_table
    from dpr_lab.report.words import in_words

    line(answer_sentence(acceptance))
    line(in_words(acceptance.sentence))
    report_table("Limits", limit_table(acceptance), limit_note(acceptance))
    if sentence := deciding_sentence(acceptance):
        line(sentence)
        for number, release in enumerate(acceptance.recordings, 1):
            line(f"{number}. {release}")
