"""`dpr-lab trials draw|run|open|campaign`: blind trials on plants whose effects are hidden."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dpr_lab.cli.checks import Json, complete_rig
from dpr_lab.cli.console import emit, line, report_table, say, table
from dpr_lab.cli.listing import command_group
from dpr_lab.shown import counted, in_command
from dpr_lab.trials.sealing import DRAWN, ON_ARM, Kind, Level, TrialArm

if TYPE_CHECKING:
    from dpr_lab.trials.protocol import Opened, Trial

HELP = """Blind trials: diagnose simulated plants whose effects are hidden.

The simulated device draws a plant and publishes a salted hash of it, the seal. The plant is recorded through the
protocol and diagnosed. Only then is the truth revealed, compared with the seal, and scored.

\b
Example:
  dpr-lab trials draw --out trial
  dpr-lab trials run trial
  dpr-lab trials open trial
"""

app = command_group(HELP)

HIDDEN = (
    "one effect of the library (single), two (pair), three (triple) or none (clean); one effect of the library"
    " in another form (form); one effect outside the library (outside); faulty encoders, with or without"
    " one effect (dirty); drives with or without a fault (driven, only on request); one effect among several"
    " small effects (background, only on request)"
)

RigName = Annotated[
    str | None,
    typer.Option(
        help=(
            "Rig file or name of a built-in rig, around which random rigs are drawn. Default: paper;"
            " driven_double with --arm."
        ),
        autocompletion=complete_rig,
    ),
]
PlantName = Annotated[
    str | None,
    typer.Option(
        help=(
            "Plant file, around which random plants are drawn. Only the simulated device reads this file."
            " Default: the plant of the default rig."
        )
    ),
]
ArmMode = Annotated[
    TrialArm | None,
    typer.Option(
        help=(
            "Arm that moves freely or is driven by a motor. The hidden effects are effects of joint 0 and"
            " of the drive. Kinds: single, pair, triple, clean, dirty."
        )
    ),
]
Size = Annotated[
    Level,
    typer.Option(
        help=(
            "Size of the gap: at least twice the noise (clear), about equal to the noise (subtle), or 0.1"
            " to 1 times the noise (faint)."
        )
    ),
]
Folder = Annotated[Path, typer.Argument(help="Folder written by `trials draw`.")]


def _centres(rig: str | None, plant: str | None, arm: TrialArm | None) -> tuple[str, str]:
    """Return the names of rig and plant; the default of a missing name depends on the arm."""
    default = "paper" if arm is None else "driven_double"
    return rig or default, plant or default


@app.command()
def draw(
    out: Annotated[Path, typer.Option(help="New folder for the trial.")],
    kind: Annotated[
        Kind, typer.Option(help=f"Hidden effect: {HIDDEN}. With `any`, the kind is hidden too.")
    ] = Kind.ANY,
    level: Size = Level.CLEAR,
    arm: ArmMode = None,
    rig: RigName = None,
    plant: PlantName = None,
    seed: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Seed of the plant, for repeatable trials; default: 128 random bits, so that the plant cannot"
            " be guessed.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Draw, seal and record a plant.

    Example: dpr-lab trials draw --kind pair --out trial
    """
    from dpr_lab.cli.listener import Listener
    from dpr_lab.trials.sealing import PlantRequest
    from dpr_lab.workflows.trial import draw as draw_trial

    with Listener() as listener:
        request = PlantRequest(kind, level, seed, *_centres(rig, plant, arm), arm)
        trial = draw_trial(request, out, listener)
    if as_json:
        emit({"trial": out, "seal": trial.seal, "asked": trial.asked, "runs": trial.runs})
        return
    line(f"seal: {trial.seal}")
    line(f"next: dpr-lab trials run {in_command(out)}")


@app.command()
def run(folder: Folder, as_json: Json = False) -> None:
    """Diagnose a sealed trial.

    Example: dpr-lab trials run trial
    """
    from dpr_lab.cli.diagnose import show
    from dpr_lab.cli.listener import Listener
    from dpr_lab.workflows.trial import diagnose_trial

    with Listener() as listener:
        trial = diagnose_trial(folder, on_event=listener)
    if as_json:
        emit(trial.diagnosis.to_json() | {"files": trial.files})
        return
    show(trial.diagnosis, Path(trial.files["report"]).parent)
    line(f"report: {trial.files['report']}")
    line(f"next: dpr-lab trials open {in_command(folder)}")


@app.command("open")
def open_(folder: Folder, as_json: Json = False) -> None:
    """Reveal the truth of a trial and score its diagnosis.

    The revealed values are compared with the seal.

    Example: dpr-lab trials open trial
    """
    from dpr_lab.trials.protocol import open_trial, read_trial

    trial = read_trial(folder)
    opened = open_trial(trial)
    if as_json:
        emit(opening(opened))
    else:
        show_opened(opened, trial)


def opening(opened: "Opened") -> dict[str, Any]:
    """Convert a revealed trial to a JSON object."""
    truth, outcome = opened.truth, opened.outcome
    return {
        "seal": outcome.seal,
        "drawn": dict(truth.drawn),
        "truth": {"effects": truth.effects, "foreign": truth.foreign, "family": truth.family},
        "diagnosis": {"verdict": outcome.verdict, "named": outcome.named},
        "grade": outcome.grade,
        "score": outcome.to_json(),
    }


def show_opened(opened: "Opened", trial: "Trial") -> None:
    """Print the hidden effects and the diagnosis."""
    from dpr_lab.cli.listener import effects_listed, named_by
    from dpr_lab.trials.comparison import COLUMNS, comparison_rows

    outcome = opened.outcome
    drawn = "{kind}:{level}, seed {seed}".format(**opened.truth.drawn)
    line(f"the seal is valid: {outcome.seal} ({drawn})")
    if rows := comparison_rows(opened, trial.rig):
        table("Truth and diagnosis", COLUMNS, rows)
    if opened.truth.drawn["kind"] == "dirty":
        reported, missed = outcome.sensor_findings, outcome.faults_missed
        line(f"faulty encoders: detected {effects_listed(reported)}, missed {effects_listed(missed)}")
    line(f"hidden: {effects_listed(outcome.truth)}; diagnosis: {named_by(outcome)}; grade: {outcome.grade}")


STRATEGY_COLUMNS = (
    "strategy",
    "trials",
    "median",
    "mean",
    "minutes",
    "decided",
    "correct when stopped",
    "correct or undetectable",
    "forecast error (if exact)",
)
"""Columns of the table that compares the strategies of planning."""

WHEN_STOPPED = ("right_when_stopped", "true_when_stopped")
"""Keys of the shares that refer to the trials that stopped; None if no trial stopped."""


def strategy_rows(strategies: dict[str, dict[str, Any]]) -> list[tuple[str, ...]]:
    """Return the rows of the table that compares the strategies of planning, one per strategy."""
    return [
        (
            name,
            str(summary["trials"]),
            f"{summary['median_releases']:g}",
            f"{summary['mean_releases']:.2f}",
            f"{summary['mean_minutes']:.2f}",
            f"{summary['decided']:.2f}",
            *("–" if (share := summary[name]) is None else f"{share:.2f}" for name in WHEN_STOPPED),
            # The error of an exact forecast with the same number of outcomes is in brackets.
            f"{summary['forecast_calibration_error']:.2f} ({summary['forecast_error_if_exact']:.2f})"
            if summary["forecasts"]
            else "",
        )
        for name, summary in strategies.items()
    ]


@app.command()
def campaign(
    out: Annotated[
        Path, typer.Option(help="Folder for the results. An interrupted campaign in this folder is continued.")
    ],
    n: Annotated[int, typer.Option(min=1, help="Number of trials.")] = 500,
    kind: Annotated[
        list[Kind] | None,
        typer.Option(metavar="<kind>", help=f"Hidden effect: {HIDDEN}. May be repeated. Default: all kinds in turn."),
    ] = None,
    level: Size = Level.CLEAR,
    arm: ArmMode = None,
    rig: RigName = None,
    plant: PlantName = None,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of the first trial; each further trial uses the next number.")
    ] = 1,
    jobs: Annotated[
        int, typer.Option(min=0, help="Number of trials run in parallel on this machine; 0: one per core.")
    ] = 0,
    scheduler: Annotated[
        str | None,
        typer.Option(help="Run the trials on the workers of this dask scheduler, e.g. tcp://127.0.0.1:8786."),
    ] = None,
    plan: Annotated[
        bool,
        typer.Option(
            "--plan",
            help=(
                "Record each plant release by release until its cause is determined, or until only a bench"
                " check can determine it. Four strategies are compared: a plan, a plan that also chooses"
                " durations, a fixed menu of poses, and random poses."
            ),
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """Run many trials and report scores, confusion matrix, calibration, sizes and times.

    Example: dpr-lab trials campaign --n 500 --kind single --kind clean --out out/campaign
    """
    from dpr_lab.cli.listener import Listener
    from dpr_lab.report.trials.html import sentence
    from dpr_lab.report.trials.tables import kind_table, score_table
    from dpr_lab.trials.campaign import Campaign
    from dpr_lab.trials.next_release import STRATEGIES
    from dpr_lab.trials.workers import exposure
    from dpr_lab.workflows.campaign import run_campaign

    if scheduler is not None and (warning := exposure(scheduler)):
        say(warning)
    kinds = tuple(kind or (DRAWN if arm is None else ON_ARM))
    strategies = tuple(STRATEGIES) if plan else ()
    tried_on = Campaign(kinds, level, seed, *_centres(rig, plant, arm), arm, strategies)
    with Listener() as listener:
        done = run_campaign(tried_on, n, out, jobs or os.cpu_count() or 1, scheduler, listener)
    if as_json:
        emit(done.summary | {"failures": [failure.error for failure in done.failures], "files": done.files})
    else:
        report_table("Scores", score_table(done.summary))
        report_table("Scores by kind of plant", kind_table(done.summary))
        if plan:
            table("Releases until decided", STRATEGY_COLUMNS, strategy_rows(done.summary["strategies"]))
        line(sentence(done.summary))
        line(f"page: {done.files['page']}")
    if done.failures:
        say(
            f"{counted(len(done.failures), 'trial')} ended with an error; run the command again to repeat"
            " the failed trials"
        )
        raise typer.Exit(1)
