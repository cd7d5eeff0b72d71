"""`dpr-lab trials draw|run|open|campaign`: the diagnosis tried on plants whose effects are withheld."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dpr_lab.cli.console import Bar, emit, json_mode, progress, say, table
from dpr_lab.trials.sealing import DRAWN, Kind, Level

if TYPE_CHECKING:
    from collections.abc import Callable

    from dpr_lab.gap.diagnosis import Diagnosis
    from dpr_lab.trials.campaign import Campaign, Failure, Tried
    from dpr_lab.trials.protocol import Opened, Trial
    from dpr_lab.trials.score import Outcome

HELP = """Try the diagnosis on plants whose effects are withheld.

The simulated device draws a plant and gives away a salted hash of it, the seal. The plant is recorded through the
protocol and diagnosed; only then is it opened, held against the seal, and scored.

\b
Example:
  dpr-lab trials draw --out trial
  dpr-lab trials run trial
  dpr-lab trials open trial
"""

app = typer.Typer(help=HELP, no_args_is_help=True, rich_markup_mode=None)

HIDDEN = (
    "one effect of the library, two (pair) or three (triple); none (clean); one of the library in another form; one"
    " outside the library; none or one, with faulty encoders (dirty)"
)

RigName = Annotated[str, typer.Option(help="Rig file, or the name of a built-in one, that the rig is drawn around.")]
PlantName = Annotated[str, typer.Option(help="Plant file that the plant is drawn around; never read here.")]
Size = Annotated[Level, typer.Option(help="How visible: a gap of at least twice the noise, or of about it.")]
Folder = Annotated[Path, typer.Argument(help="Folder that `trials draw` wrote.")]
Json = Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")]


@app.command()
def draw(
    out: Annotated[Path, typer.Option(help="Folder of the trial, new.")],
    kind: Annotated[Kind, typer.Option(help=f"What is hidden: {HIDDEN}. Any: that is withheld too.")] = Kind.ANY,
    level: Size = Level.CLEAR,
    rig: RigName = "paper",
    plant: PlantName = "paper",
    seed: Annotated[
        int | None, typer.Option(min=0, help="Draws the same plant again; fresh chance when left out.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Have a plant drawn, sealed and recorded.

    Example: dpr-lab trials draw --kind pair --out trial
    """
    json_mode(as_json)
    from dpr_lab.trials.protocol import draw as draw_trial
    from dpr_lab.trials.sealing import Wanted

    trial = draw_trial(Wanted(kind, level, seed, rig, plant), out, say)
    if as_json:
        emit({"trial": str(out), "seal": trial.seal, "asked": trial.asked, "runs": [str(run) for run in trial.runs]})
        return
    print(f"seal: {trial.seal}")
    print(f"next: dpr-lab trials run {out}")


@app.command()
def run(folder: Folder, as_json: Json = False) -> None:
    """Diagnose a sealed trial.

    Example: dpr-lab trials run trial
    """
    json_mode(as_json)
    from dpr_lab.cli.diagnose import show
    from dpr_lab.trials.protocol import read_trial

    trial = read_trial(folder)
    found, files = diagnosed(trial)
    if as_json:
        emit(found.to_json() | {"files": files})
        return
    show(found)
    print(f"report: {files['report']}")
    print(f"next: dpr-lab trials open {folder}")


def diagnosed(trial: "Trial", **chosen: Any) -> "tuple[Diagnosis, dict[str, str]]":
    """Diagnose a trial and write the diagnosis down; also the paths of its files by name."""
    from dpr_lab.cli.diagnose import diagnose_with_progress
    from dpr_lab.report.saving import save_diagnosis
    from dpr_lab.trials.protocol import keep_diagnosis, recordings, refuse_opened

    refuse_opened(trial)
    runs, rig = recordings(trial), trial.rig
    found = diagnose_with_progress(runs, rig, **chosen)
    files = save_diagnosis(found, runs, rig, trial.folder / "diagnosis")
    keep_diagnosis(trial, found.to_json())
    return found, files | {"diagnosis": str(trial.diagnosis)}


@app.command("open")
def open_(folder: Folder, as_json: Json = False) -> None:
    """Open a diagnosed trial: check the seal, show truth and diagnosis side by side, score.

    Example: dpr-lab trials open trial
    """
    json_mode(as_json)
    from dpr_lab.trials.protocol import open_trial, read_trial

    trial = read_trial(folder)
    opened = open_trial(trial)
    if as_json:
        emit(opening(opened))
    else:
        show_opened(opened, trial)


def opening(opened: "Opened") -> dict[str, Any]:
    """An opened trial as JSON."""
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
    """The truth beside the diagnosis, on stdout."""
    from dpr_lab.trials.beside import COLUMNS, beside

    outcome = opened.outcome
    drawn = "{kind}:{level}, seed {seed}".format(**opened.truth.drawn)
    print(f"the seal holds: {outcome.seal} ({drawn})")
    if rows := beside(opened, trial.rig):
        table("Truth and diagnosis", COLUMNS, rows, prose=True)
    if opened.truth.drawn["kind"] == "dirty":
        found, missed = outcome.sensor_findings, outcome.faults_missed
        print(f"the encoders were faulty: found {_listed(found)}, missed {_listed(missed)}")
    print(f"there was {_listed(outcome.truth)}; the diagnosis said {_said(outcome)}: {outcome.grade}")


def _said(outcome: "Outcome") -> str:
    verdict = outcome.verdict.replace("_", " ")
    return f"{_listed(outcome.named)} ({verdict})" if outcome.named else verdict


def _listed(names: tuple[str, ...]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names) or "nothing"


@app.command()
def campaign(
    out: Annotated[Path, typer.Option(help="Folder of results; a campaign that it holds goes on where it was.")],
    n: Annotated[int, typer.Option(min=1, help="How many trials.")] = 500,
    kind: Annotated[
        list[Kind] | None,
        typer.Option(help=f"What is hidden, may be given again: {HIDDEN}. All these in turn when left out."),
    ] = None,
    level: Size = Level.CLEAR,
    rig: RigName = "paper",
    plant: PlantName = "paper",
    seed: Annotated[int, typer.Option(min=0, help="Of the first trial; the next takes the next number.")] = 1,
    jobs: Annotated[int, typer.Option(min=0, help="Trials side by side on this machine; 0: one on each core.")] = 0,
    scheduler: Annotated[
        str | None, typer.Option(help="Run on the workers of this dask scheduler instead, e.g. tcp://127.0.0.1:8786.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Many trials, recorded without link and waiting; scores, confusion, calibration, sizes and time on one page.

    Example: dpr-lab trials campaign --n 500 --kind single --kind clean --out out/campaign
    """
    json_mode(as_json)
    import os

    from dpr_lab.report.trials_html import sentence
    from dpr_lab.report.trials_tables import KIND_COLUMNS, SCORE_COLUMNS, kind_rows, score_rows
    from dpr_lab.trials.campaign import Campaign, run_campaign

    tried_on = Campaign(tuple(kind or DRAWN), level, seed, rig, plant)
    with progress("trials", n) as bar:
        tried = run_campaign(
            tried_on, n, out, jobs=jobs or os.cpu_count() or 1, scheduler=scheduler, on_trial=_teller(bar, n)
        )
    counted, files = _saved(tried, tried_on, out)
    if as_json:
        emit(counted | {"failures": [failure.error for failure in tried.failures], "files": files})
    else:
        table("Scores", SCORE_COLUMNS, score_rows(counted))
        table("By what was hidden", KIND_COLUMNS, kind_rows(counted))
        print(sentence(counted))
        print(f"page: {files['page']}")
    if tried.failures:
        say(f"{len(tried.failures)} trials ended in an error; run it again to repeat them")
        raise typer.Exit(1)


def _teller(bar: Bar, n: int) -> "Callable[[int, Outcome | Failure | None], None]":
    """Progress: a bar on a terminal, a line for each trial elsewhere; what failed is told on both."""

    def on_trial(done: int, last: "Outcome | Failure | None") -> None:
        from dpr_lab.trials.campaign import Failure

        bar(done, f"{done} of {n}")
        if isinstance(last, Failure):
            say(f"trial {last.number}: {last.error}")
        elif sys.stderr.isatty():
            return
        elif last is not None:
            say(f"{done} of {n}: there was {_listed(last.truth)}; said {_said(last)}: {last.grade}")
        elif done:
            say(f"{done} of {n} trials are there already")

    return on_trial


def _saved(tried: "Tried", campaign: "Campaign", out: Path) -> tuple[dict[str, Any], dict[str, str]]:
    """Write summary, figures and page; the summary, and the paths by name."""
    from dpr_lab.report.saving import write_json
    from dpr_lab.report.trials_figures import save_trial_figures
    from dpr_lab.report.trials_html import write_trials_report
    from dpr_lab.trials.summary import summary

    counted = summary(tried.outcomes)
    figures = save_trial_figures(counted, out)
    setting = (
        f"Hidden in turn: {', '.join(campaign.kinds)}; size {campaign.level}; drawn around rig “{campaign.rig}” and"
        f" plant “{campaign.plant}”, seeds from {campaign.seed} on."
    )
    failures = [f"trial {failure.number}: {failure.error}" for failure in tried.failures]
    page = write_trials_report(counted, setting, failures, out, figures)
    write_json(counted, out / "summary.json")
    return counted, {"page": str(page), "summary": str(out / "summary.json"), "trials": str(out / "trials.jsonl")}
