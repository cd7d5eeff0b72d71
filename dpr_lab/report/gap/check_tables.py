"""Create the tables of recommended checks and of their results."""

from collections.abc import Sequence

from dpr_lab.checks.update import bayes_factor
from dpr_lab.gap.advice.advise import CHECK_KINDS
from dpr_lab.gap.advice.measurement import excluded_size
from dpr_lab.gap.result.checks import NONE_OF_THEM, AdvisedCheck, CheckDone
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.report.angles import RADIANS
from dpr_lab.report.digits import NONE
from dpr_lab.report.pages.page import Rows, page_table
from dpr_lab.report.words import in_words, named, size_words
from dpr_lab.shown import in_command, listed

MOVED_NOTE = (
    "Bayes factor: ratio by which the result changes the odds of the cause. A factor above 1 supports the cause, and a"
    " factor below 1 contradicts it. Above 20 or below 1/20 the evidence is strong."
)
EXPECTED_NOTE = (
    "Expected result: size with 90 % interval if the measured effect is the cause. If the recordings determine no size,"
    " it is the size above which they exclude the effect, provided that all named effects act. If another effect is the"
    " cause, the expected result is about zero. Expected information: at most the entropy of the probabilities;"
    " measurements are assumed to be exact. If one cause is already far more probable than the others, the information"
    " is nearly zero, even if the predictions differ by many standard deviations. A recommended release is the best of"
    " a short list for this question alone. dpr-lab plan searches all reachable poses for all open questions. The"
    " information that it states can differ, because it adds up several releases and treats each cause separately."
    " A check counts indistinguishable causes as one."
)


def how_to_record(diagnosis: Diagnosis, file: str) -> str:
    """Compose the command that records the result of a check.

    The command contains the options for each kind of recommended check. If measurements have different units, it
    states the options of each measurement.

    Args:
        diagnosis: a diagnosis that recommends checks
        file: file of the diagnosis
    """
    options: list[str] = []
    for kind, kinds in CHECK_KINDS.items():
        forms: dict[str, list[str]] = {}
        for check in (check for check in diagnosis.checks if check.kind == kind):
            forms.setdefault(kinds.form(check), []).append(check.id)
        options += [f"{form} ({f'check {listed(ids)}' if len(forms) > 1 else kind})" for form, ids in forms.items()]
    return f"To record the result: dpr-lab check {in_command(file)} CHECK, followed by {' or '.join(options)}."


@page_table("cause", "probability before", "probability after", "Bayes factor", caption=MOVED_NOTE, style="prose")
def moved_table(done: CheckDone) -> Rows:
    """Return one row for each cause, the most probable cause first."""
    ranked = sorted(done.after, key=lambda name: -done.after[name])
    return [
        (
            "none of these effects" if name == NONE_OF_THEM else named(name),
            f"{done.before[name]:.3f}",
            f"{done.after[name]:.3f}",
            bayes_factor(done, name),
        )
        for name in ranked
    ]


def informative(checks: Sequence[AdvisedCheck]) -> bool:
    """Check whether at least one of the checks is informative."""
    return any(check.informative for check in checks)


def bits(information: float) -> str:
    """Format an expected information with two decimals, for example `0.98` or `< 0.01`."""
    return f"{information:.2f}" if information >= 0.005 else "< 0.01"


@page_table(
    "check",
    "kind",
    "action",
    "expected result",
    "distinguished effects",
    "expected information (bits)",
    caption=EXPECTED_NOTE,
    style="prose",
    title="Possible checks",
)
def check_table(diagnosis: Diagnosis) -> Rows:
    """Return one row for each possible check, also for checks that are not recommended."""
    return [
        (
            check.id,
            check.kind,
            in_words(check.text),
            _expected(diagnosis, check),
            ", ".join(map(named, check.splits)),
            bits(check.expected_bits),
        )
        for check in diagnosis.checks
    ]


def _expected(diagnosis: Diagnosis, check: AdvisedCheck) -> str:
    """Format the expected result of a measurement: size with interval, or upper limit; a dash for other checks."""
    if check.quantity is None:
        return NONE
    name = check.quantity.parameters[0]
    if check.expected:
        return size_words(check.measures, name, RADIANS, check.expected.value, *check.expected.interval90)
    limit = excluded_size(diagnosis, check)
    return f"below {size_words(check.measures, name, RADIANS, limit)}" if limit else NONE
