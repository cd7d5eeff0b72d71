"""`dpr-lab diagnose`: diagnosis of the difference between simulation and rig."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dpr_lab.cli.checks import NO_RIG, REASON_NAMES, Json, complete_rig, names_in
from dpr_lab.cli.console import emit, line, report_table, say, table, text
from dpr_lab.cli.option_groups import DiagnosisChoices, with_groups
from dpr_lab.shown import percent

if TYPE_CHECKING:
    from collections.abc import Mapping

    from dpr_lab.gap.result.diagnosis import Diagnosis
    from dpr_lab.workflows.diagnose_simulator import SimulatorDiagnosis


@with_groups
def diagnose(
    *,
    runs: Annotated[
        list[Path],
        typer.Argument(help="Run files (.mcap). With three or more releases, more effects can be distinguished."),
    ],
    rig: Annotated[
        str,
        typer.Option(
            help="Rig file, or name of a built-in rig; optional with --simulator.",
            autocompletion=complete_rig,
        ),
    ] = "",
    simulator: Annotated[
        Path | None,
        typer.Option(
            help=(
                "Your MJCF, URDF or SDFormat model. The diagnosis starts from the values of the model and lists the"
                " changes that the model needs."
            )
        ),
    ] = None,
    joints: Annotated[
        str | None,
        typer.Option(
            help="With --simulator: names of the joints, separated by commas: inner, outer, then arm if present."
        ),
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(help="Model of `identify`, or folder of a diagnosis: initial values of the fit."),
    ] = None,
    choices: DiagnosisChoices,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the report, figures, corrected model and exports.")
    ] = None,
    fail_on: Annotated[
        str | None,
        typer.Option(
            help="Conditions for exit code 1, separated by commas: gap (simulation and rig differ), unexplained (part"
            " of the gap is unexplained), unsure (a named effect has a probability below 90 %), sensor (a sensor"
            " fault). The code is always 1 if the verdict is inconclusive, or if the description of the recordings"
            " is probably wrong.",
            callback=REASON_NAMES.check,
            autocompletion=REASON_NAMES.complete,
        ),
    ] = None,
    trust: Annotated[
        int,
        typer.Option(
            min=0,
            help="Number of blind trials on simulated plants like this rig, which measure how often the diagnosis is"
            " correct. Each trial takes as long as the diagnosis.",
        ),
    ] = 0,
    explain: Annotated[
        bool,
        typer.Option(
            "--explain",
            help="Print every set of effects that the model search tried, with the decision and its reason.",
        ),
    ] = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", help="Print all tables of the report, not only the main results.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Explain the gap between simulation and rig.

    The result states where the gap acts, its causes with their probabilities, and the gap reduction on held-out data.

    Example: dpr-lab diagnose runs/*.mcap --rig paper --out out/diagnosis

    Example: dpr-lab diagnose runs/*.mcap --simulator robot.xml --out out/diagnosis
    """
    if not rig and simulator is None:
        raise typer.BadParameter(f"give --rig, or --simulator with your own model. {NO_RIG}")
    if joints and simulator is None:
        raise typer.BadParameter("--joints requires --simulator")
    from dpr_lab.cli.listener import Listener
    from dpr_lab.workflows.diagnose import diagnose as diagnose_runs
    from dpr_lab.workflows.diagnose import failures

    request = choices.request(runs, rig, model=model, out=out, trust=trust)
    changed = None
    with Listener() as listener:
        if simulator is not None:
            from dpr_lab.workflows.diagnose_simulator import diagnose_simulator

            changed = diagnose_simulator(request, simulator, names_in(joints) or (), listener)
            diagnosed = changed.result
        else:
            diagnosed = diagnose_runs(request, listener)
    if as_json:
        emit((changed or diagnosed).to_json())
    else:
        show(diagnosed.diagnosis, request.out, verbose=verbose)
        if not verbose:
            line(f"Further tables: --verbose{'' if out is None else ', or the report'}.")
        if explain:
            show_search(diagnosed.diagnosis)
        if changed is not None:
            show_simulator(changed, request.out)
        show_files(diagnosed.files)
    if failed := failures(diagnosed.diagnosis, names_in(fail_on) or ()):
        for sentence in failed:
            say(sentence)
        raise typer.Exit(1)


def show(diagnosis: "Diagnosis", out: Path | None = None, *, verbose: bool = False) -> None:
    """Print the main results of a diagnosis, the verdict first.

    Args:
        diagnosis: the result
        out: folder of the written files; None if no files were written
        verbose: whether all tables of the report are printed
    """
    from dpr_lab.report.gap import findings, tables
    from dpr_lab.report.gap.sizes import scale_note
    from dpr_lab.report.gap.summary import repeatability_sentences, summary_note
    from dpr_lab.report.gap.trust_trials import trust_words
    from dpr_lab.report.words import in_words

    line(tables.sentence(diagnosis))
    if causes := tables.summary_table(diagnosis, brief=not verbose):
        note = f"{summary_note(diagnosis)} {scale_note(diagnosis)}".strip()
        report_table("Causes", causes, note)
    if common := tables.common_table(diagnosis):
        report_table("Fit of the common effects alone", common)
    for text_below in (*diagnosis.notes, *diagnosis.remedies):
        line(in_words(text_below))
    if diagnosis.where and diagnosis.open_gap and not diagnosis.only_uncertain:
        line(in_words(diagnosis.where_sentence))
    if verbose:
        _show_effects(diagnosis)
    elif alternatives := tables.open_table(diagnosis):
        report_table("Probable alternatives", alternatives)
    if diagnosis.effects:
        _show_gap_reduction(diagnosis, verbose=verbose)
    elif diagnosis.where:
        report_table("Residual maps", tables.place_table(diagnosis))
    if verbose:
        _show_repeatability(diagnosis)
    elif sentences := repeatability_sentences(diagnosis):
        line(" ".join(sentences))
    if verbose and diagnosis.sensor_findings:
        report_table("Sensor faults", findings.finding_table(diagnosis))
    elif faults := findings.findings_sentence(diagnosis):
        line(faults)
    for sentence in trust_words(diagnosis) if diagnosis.trust else ():
        line(sentence)
    _show_next(diagnosis, out, verbose=verbose)


def _show_effects(diagnosis: "Diagnosis") -> None:
    """Print the contributions of the effects, the gap budget, and all alternatives."""
    from dpr_lab.report.gap import tables

    if diagnosis.effects:
        report_table("Contributions of the effects", tables.contribution_table(diagnosis))
    if len(diagnosis.effects) > 1:
        report_table("Gap budget", tables.step_table(diagnosis))
    if alternatives := tables.standing_table(diagnosis):
        report_table("Alternatives", alternatives)


def _show_gap_reduction(diagnosis: "Diagnosis", *, verbose: bool, most: int = 6) -> None:
    """Print the gap reduction by run: the `most` smallest values or, with `verbose`, all values."""
    from dpr_lab.report.gap import tables

    closed, title = tables.closed_table(diagnosis), "Gap reduction by run"
    if not verbose and len(closed.rows) > most:
        title = f"{title}: the {most} smallest of {len(closed.rows)}"
        closed = tables.closed_table(diagnosis, most=most)
    report_table(title, closed)


def _show_repeatability(diagnosis: "Diagnosis") -> None:
    """Print the shares of the mean squared residual: explained, varying, reproducible, not reproducible, noise."""
    from dpr_lab.report.gap.summary import repeatability_parts, repeatability_sentences

    if parts := repeatability_parts(diagnosis):
        rows = [(label, percent(share, 1)) for label, share in parts]
        note = " ".join(repeatability_sentences(diagnosis))
        table("Repeatability", ("part", "share of the mean square"), rows, note=note)


def _show_next(diagnosis: "Diagnosis", out: Path | None, *, verbose: bool) -> None:
    """Print the next recordings and checks, and how to record the result of a check."""
    from dpr_lab.gap.result import RECORD
    from dpr_lab.report.gap import check_tables
    from dpr_lab.report.gap.next_steps import next_steps

    line("Next recordings and checks")
    for number, step in enumerate(next_steps(diagnosis), 1):
        line(f"{number}. {step}")
    if not check_tables.informative(diagnosis.checks):
        return
    if verbose:
        report_table("Possible checks", check_tables.check_table(diagnosis))
    line(check_tables.how_to_record(diagnosis, "DIAGNOSIS.json" if out is None else str(out / RECORD)))


def show_files(files: "Mapping[str, str]") -> None:
    """Print the written files on stderr: `files in out: diagnosis.html (report), ...`.

    Each folder has one line.
    """
    folders: dict[Path, dict[str, list[str]]] = {}
    for name, file in files.items():
        path = Path(file)
        folders.setdefault(path.parent, {}).setdefault(path.name, []).append(name)
    for folder, named in folders.items():
        say(f"files in {folder}: " + ", ".join(f"{name} ({', '.join(contents)})" for name, contents in named.items()))


def show_simulator(done: "SimulatorDiagnosis", out: Path | None) -> None:
    """Print the recommended changes of the user's model, the most important cause first."""
    from dpr_lab.cli.export import show_replays
    from dpr_lab.report.words import in_words

    changed = done.simulator
    name = Path(changed.file).name
    line(f"Joints of {name}, those of the rods first: {', '.join(map(repr, changed.joints))}.")
    rows = [
        (c.joint, c.quantity, f"{c.before:.5g}", f"{c.after:.5g}", c.unit, percent(c.share)) for c in changed.causes
    ]
    if rows and done.result.diagnosis.verdict == "no_gap":
        line(f"The verdict concerns missing effects. In addition, numbers in {name} are wrong:")
    if rows:
        columns = ("joint", "quantity", f"in {name}", "identified", "unit", "error without this change")
        table(f"Changes of {name}", columns, rows)
    else:
        line(f"No number of {name} needs a change: all differ by less than 1 % or less than their uncertainty.")
    for effect in changed.unnamed:
        line(f"no attribute of a body or joint can represent this effect: {in_words(effect)}")
    if changed.refused:
        line(f"{name} cannot be changed: {changed.refused}")
    if changed.diff:
        text(changed.diff.rstrip())
    for effect, reason in changed.lost.items():
        line(f"not in {name}: {in_words(effect)}: {reason}")
    for effect in changed.passive:
        line(f"in a separate module of passive forces for MuJoCo: {in_words(effect)}")
    show_replays(name, changed.replays)
    if changed.changes and out is None:
        line(f"With --out FOLDER the changed {name} is written to this folder.")


def show_search(diagnosis: "Diagnosis") -> None:
    """Print all sets of effects that the model search tried, with the decisions."""
    from dpr_lab.report.gap.trials_of_search import trial_table

    report_table("Model search", trial_table(diagnosis))
