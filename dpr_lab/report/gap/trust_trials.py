"""Create sentences and a table on blind trials with plants that resemble this rig.

The module imports no library for figures, so that the command line can use it without a delay.
"""

from collections.abc import Sequence

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.trust import NOTHING, REFUSED, TrustShare, TrustTrial
from dpr_lab.report.digits import three
from dpr_lab.report.pages.page import Rows, page_table
from dpr_lab.report.words import named
from dpr_lab.shown import counted, percent


def trust_words(diagnosis: Diagnosis) -> list[str]:
    """Describe the results of the blind trials and their limits."""
    trust = diagnosis.trust
    if trust is None or not trust.trials:
        if "joint0" in diagnosis.gap.before_rad:
            return ["No blind trials were made on plants like this rig: `--trust` does not support a moving arm."]
        return ["No blind trials were made on plants like this rig. To run them: `dpr-lab diagnose --trust 40`."]
    return [
        f"Blind trials: {len(trust.trials)} plants with the fitted parameters were simulated with the named"
        " effects, with another effect, or with no effect. They were recorded like this rig, each with"
        " different noise, and diagnosed without access to the hidden effects. Exactly the hidden effects were named in"
        f" {_share(trust.right)}. An absent effect was named in {_share(trust.wrong)}. False alarms on plants"
        f" without an effect: {_share(trust.false_alarms)}.{_refused(trust.trials)} Time per trial:"
        f" {trust.seconds_each:.0f} s.",
        (
            "All hidden effects are in the library. A real rig can have effects outside the library, which"
            " makes its diagnosis more difficult."
        ),
    ]


def _share(share: TrustShare) -> str:
    if not share.of:
        return "0 of 0"
    low, high = share.interval90
    return f"{share.held} of {share.of} (90 % interval {percent(low)} to {percent(high)})"


def _refused(trials: Sequence[TrustTrial]) -> str:
    refused = sum(trial.verdict == REFUSED for trial in trials)
    return f" In {counted(refused, 'trial')} the recordings were refused, and no effect was named." if refused else ""


@page_table(
    "trial",
    "kind",
    "hidden effects",
    "named effects",
    "verdict",
    "grade",
    "time (s)",
    style="prose",
    title="All trials",
)
def trust_table(diagnosis: Diagnosis) -> Rows:
    """Return one row for each trial."""
    trials = diagnosis.trust.trials if diagnosis.trust else []
    return [
        (
            str(number),
            trial.kind,
            ", ".join(map(named, trial.truth)) or NOTHING,
            ", ".join(map(named, trial.named)) or NOTHING,
            trial.verdict.replace("_", " "),
            _grade(trial),
            three(trial.seconds),
        )
        for number, trial in enumerate(trials, 1)
    ]


def _grade(trial: TrustTrial) -> str:
    if trial.verdict == REFUSED:
        return REFUSED
    if not trial.truth:
        return "false alarm" if trial.named else "correct"
    if trial.wrong:
        return "incorrect effect"
    return "correct" if set(trial.right) == set(trial.truth) else "missed"
