"""Campaign of many blind trials, with scores and a page of figures."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.errors import ConfigError
from dpr_lab.workflows.checks import check_folder_writable
from dpr_lab.workflows.events import OnEvent, TrialDone, ignore

if TYPE_CHECKING:
    from dpr_lab.trials.campaign import Campaign, CampaignTrials, Failure


@dataclass(frozen=True, slots=True)
class CampaignResult:
    """Results of a campaign."""

    summary: dict[str, Any]
    failures: "tuple[Failure, ...]"
    files: dict[str, str]


def run_campaign(
    campaign: "Campaign",
    n: int,
    out: Path,
    jobs: int,
    scheduler: str | None = None,
    on_event: OnEvent = ignore,
) -> CampaignResult:
    """Run a campaign, score it, and write summary, figures and page.

    Args:
        campaign: the plants
        n: number of trials
        out: folder for the results. An interrupted campaign in this folder is continued.
        jobs: number of trials that run in parallel on this machine
        scheduler: address of a dask scheduler that runs the trials; None: the trials run on this machine
        on_event: receives `TrialDone`, at the start and after each trial

    Raises:
        ConfigError: a kind is not available for a moving arm.
        RunError: the folder contains another campaign, or a running campaign.
        DprError: a file cannot be written, or the workers are lost; finished trials are kept.
    """
    from dpr_lab.trials.campaign import run_campaign as run_trials

    check_folder_writable(out)
    _refuse_other_kinds(campaign)
    trials = run_trials(
        campaign,
        n,
        out,
        jobs=jobs,
        scheduler=scheduler,
        on_trial=lambda done, last: on_event(TrialDone(done, n, last)),
    )
    summary, files = _saved(trials, campaign, n, out)
    return CampaignResult(summary, trials.failures, files)


def _refuse_other_kinds(campaign: "Campaign") -> None:
    """Refuse kinds of plants that a moving arm does not support."""
    from dpr_lab.trials.sealing import ON_ARM

    others = [] if campaign.arm is None else [kind for kind in campaign.kinds if kind not in ON_ARM]
    if others:
        available = f"{', '.join(ON_ARM[:-1])} or {ON_ARM[-1]}"
        raise ConfigError(f"kind {others[0]}: not available for plants whose arm moves; choose {available}")


def _saved(done: "CampaignTrials", campaign: "Campaign", n: int, out: Path) -> tuple[dict[str, Any], dict[str, str]]:
    """Write summary, figures and page of a campaign; return the summary, and the paths by name."""
    from dpr_lab.report.saving import write_json
    from dpr_lab.report.trials.figures import save_trial_figures
    from dpr_lab.report.trials.html import write_trials_report
    from dpr_lab.trials.sequential_summary import read_strategies, sequential_summary
    from dpr_lab.trials.summary import summary, with_nulls

    scores = summary(done.outcomes)
    if campaign.strategies:
        scores |= {"strategies": sequential_summary(read_strategies(out, n))}
    figures = save_trial_figures(scores, out)
    setting = (
        f"Kinds of hidden effects, in turn: {', '.join(campaign.kinds)}; size {campaign.level}; drawn around rig"
        f" “{campaign.rig}” and plant “{campaign.plant}”, seeds from {campaign.seed} on."
    )
    failures = [f"trial {failure.number}: {failure.error}" for failure in done.failures]
    page = write_trials_report(scores, setting, failures, out, figures)
    scores = with_nulls(scores)
    write_json(scores, out / "summary.json")
    return scores, {"page": str(page), "summary": str(out / "summary.json"), "trials": str(out / "trials.jsonl")}
