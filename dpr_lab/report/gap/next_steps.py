"""Next steps after a diagnosis: recordings, checks, and advice for an open verdict."""

from dpr_lab.gap.result.causes import PROBABLE
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.screen.pieces import are_pieces
from dpr_lab.planning.stopping import STOPPING, recorded_releases, reservation, undecided
from dpr_lab.report.gap.check_tables import bits
from dpr_lab.report.gap.tables import per_reading
from dpr_lab.report.words import in_words, named

MOST = 3
"""Maximum number of listed checks; the table of checks contains all of them."""


def next_steps(diagnosis: Diagnosis) -> list[str]:
    """Return the most informative checks with their identifiers, and advice for an open verdict."""
    partly = "The remainder has another cause, or the named effect has another form: inspect the rig."
    if diagnosis.only_uncertain:
        partly = "The causes are uncertain: record further releases (dpr-lab plan proposes them)."
    elif per_reading(diagnosis.gap, "after_rad") < per_reading(diagnosis.gap, "floor_rad"):
        partly = "The remainder is smaller than the noise of a reading: inspect the rig only if it matters to you."
    likely = " or ".join(named(rival.name) for rival in diagnosis.rivals if rival.probability >= PROBABLE)
    more = f"The recordings neither confirm nor exclude {likely}: record further releases. If these do not confirm it,"
    alone = "One release does not exclude the effects of the library: record further releases. If the gap remains,"
    one_release = diagnosis.basis == "one release" or are_pieces(diagnosis.gap.closed_held_out.held_out)
    cause = more if likely else alone if one_release else "No effect of the library is the cause:"
    unknown = f"{cause} inspect the rig where the gap is largest, joint by joint."
    if diagnosis.hints:
        unknown = "Check the description of the recordings as the verdict says, then repeat the diagnosis."
    elif diagnosis.only_free_run:
        unknown = "Check the scale of each recorded angle and input, then record a further release."
    unexplained = {
        "partly_explained": partly,
        "unexplained": unknown,
        "inconclusive": "Record further releases as the verdict says (dpr-lab plan proposes them).",
    }
    last = [unexplained[diagnosis.verdict]] if diagnosis.verdict in unexplained else []
    informative = [check for check in diagnosis.checks if check.informative]
    advised = [
        f"{in_words(check.sentences)} [check {check.id}, expected information {bits(check.expected_bits)} bits]"
        for check in informative[:MOST]
    ]
    if advised or last:
        return [*advised, *last]
    if reason := undecided(diagnosis):
        return [f"Record a further release (dpr-lab plan proposes it): {in_words(reason)}."]
    if untested := reservation(diagnosis):
        optional = "Optional: record a further release to test this (dpr-lab plan proposes it)."
        return [f"The causes are decided. {in_words(untested)} {optional}"]
    optional = " Optional: a further release confirms the result under other conditions."
    return [f"No further recording or check is needed.{optional * (recorded_releases(diagnosis) < STOPPING.fewest)}"]
