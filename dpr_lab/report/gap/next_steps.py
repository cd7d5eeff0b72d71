"""Compose the next steps after a diagnosis: recordings, checks, and advice if causes are undecided."""

from collections.abc import Iterator

from dpr_lab.checks.update import likeliest
from dpr_lab.gap.result.causes import PROBABLE
from dpr_lab.gap.result.checks import NONE_OF_THEM, AdvisedCheck, camera_checks, recommended
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.planning.stopping import STOPPING, by_prior, recorded_releases, reservation, undecided, untested_forms
from dpr_lab.report.gap.check_tables import bits
from dpr_lab.report.gap.tables import per_reading
from dpr_lab.report.words import in_words, named
from dpr_lab.shown import listed


def next_steps(diagnosis: Diagnosis) -> list[str]:
    """Return the recommended recordings and checks as sentences, the first step first."""
    partly = "The remainder has another cause, or a named effect has another form: inspect the rig."
    if diagnosis.only_uncertain:
        partly = "The causes are uncertain: record further releases (dpr-lab plan proposes them)."
    elif per_reading(diagnosis.gap, "after_rad") < per_reading(diagnosis.gap, "floor_rad"):
        partly = "The remainder is smaller than the noise of a reading: inspect the rig only if you need this accuracy."
    likely = " or ".join(named(rival.name) for rival in diagnosis.rivals if rival.probability >= PROBABLE)
    more = f"The recordings neither confirm nor exclude {likely}: record further releases. If these do not confirm it,"
    alone = "One release does not exclude the effects of the library: record further releases. If the gap remains,"
    one_release = recorded_releases(diagnosis) < STOPPING.fewest
    cause = more if likely else alone if one_release else "No effect of the library is the cause:"
    unknown = f"{cause} inspect the rig where the gap is largest, joint by joint."
    if diagnosis.hints:
        unknown = "Check the description of the recordings as stated in the verdict, then repeat the diagnosis."
    elif diagnosis.only_free_run:
        unknown = "Check the scale of each recorded angle and input, then record a further release."
    unexplained = {
        "partly_explained": partly,
        "unexplained": unknown,
        "inconclusive": "Record further releases as stated in the verdict (dpr-lab plan proposes them).",
    }
    checked, second = list(_after_checks(diagnosis)), list[str]()
    advised = [in_words(text) for text in diagnosis.advice]  # of files without checks
    untested = listed([named(name) for name in untested_forms(diagnosis)])
    if untested and not diagnosis.hints:
        second = [
            f"Record a second release from another angle (dpr-lab plan proposes it) to test the form of {untested}."
        ]
    answered = bool(checked or (second and diagnosis.only_uncertain))
    last = [unexplained[diagnosis.verdict]] if diagnosis.verdict in unexplained and not answered else []
    if diagnosis.checks or diagnosis.checks_done:
        advised = [
            *camera_checks(diagnosis.advice),
            *(_step(diagnosis, check) for check in recommended(diagnosis.checks)),
        ]
    if checked or second or advised or last:
        return [*checked, *second, *advised, *last]
    if reason := undecided(diagnosis):
        return [f"Record a further release (dpr-lab plan proposes it): {in_words(reason)}."]
    of_prior = in_words(by_prior(diagnosis))
    if untested := reservation(diagnosis):
        optional = "Optional: record a further release to test this (dpr-lab plan proposes it)."
        return [" ".join(filter(None, ("The causes are decided.", of_prior, in_words(untested), optional)))]
    if of_prior:
        return [f"No further recording is needed. {of_prior} Optional: a bench check confirms this."]
    optional = " Optional: a further release confirms the result under other conditions."
    return [f"No further recording or check is needed.{optional * (recorded_releases(diagnosis) < STOPPING.fewest)}"]


def _after_checks(diagnosis: Diagnosis) -> Iterator[str]:
    """Yield advice for each named effect whose last check makes another cause more probable."""
    latest = {done.check.about: done for done in diagnosis.checks_done}
    for about, done in latest.items():
        best = likeliest(done.after)
        if best == NONE_OF_THEM:
            yield (
                "None of the candidates explains the result of the check. Repeat the check first. If the result is"
                " correct, diagnose again with all effects of the library, or inspect the rig where the gap is largest."
            )
        elif best != about:
            yield f"Diagnose again with --without {about}: {named(best)} is now more probable."


def _step(diagnosis: Diagnosis, check: AdvisedCheck) -> str:
    """Return a recommended check with its identifier, expected information and alternatives."""
    others = [c.id for c in diagnosis.checks if c.about == check.about and c.informative and c.id != check.id]
    exact = "at most " if check.quantity else ""
    details = f"check {check.id}, expected information {exact}{bits(check.expected_bits)} bits"
    if others:
        details += f"; or instead: check{'s' * (len(others) > 1)} {listed(others)}"
    return f"{in_words(check.sentences)} [{details}]"
