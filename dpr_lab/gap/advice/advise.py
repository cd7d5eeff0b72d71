"""Recommended recordings and bench measurements that distinguish the remaining causes.

For each named effect and its alternatives, the predefined releases (`expected_recordings.MENU`) are simulated with
the fitted estimate. In each release, two effects have the distance

    |s| sqrt(1 - cos^2)

in standard deviations of the noise, with the signature s of the first effect and the cosine similarity cos of both
signatures. The release with the largest distance is recommended. For the members of a class, a fit to the simulated
readings must confirm the distance. Effects that no recording distinguishes need a bench measurement. A new kind of
check needs a row of `CHECK_KINDS` and one file.
"""

from collections.abc import Iterator, Sequence

from dpr_lab.errors import RunError
from dpr_lab.gap.advice import bench_measurement, recording
from dpr_lab.gap.advice.check_kind import CheckKind, OpenQuestion
from dpr_lab.gap.advice.expected_recordings import expected_recordings
from dpr_lab.gap.classes.posterior import EffectPosterior
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.result.causes import PROBABLE
from dpr_lab.gap.result.checks import AdvisedCheck
from dpr_lab.gap.screen.recordings import Recordings

CHECK_KINDS: dict[str, CheckKind] = {
    "recording": CheckKind(frozenset({"runs"}), recording.form, recording.propose, recording.result),
    "measurement": CheckKind(
        frozenset({"value", "std"}), bench_measurement.form, bench_measurement.propose, bench_measurement.result
    ),
}
"""Kinds of checks by their names, in the order in which they are proposed."""


def kind_of(check: AdvisedCheck) -> CheckKind:
    """Return the kind of a check.

    Raises:
        RunError: this version has no such kind.
    """
    if check.kind not in CHECK_KINDS:
        raise RunError(
            f"check {check.id} has the kind {check.kind!r}, which this version of dpr-lab does not support;"
            f" available: {', '.join(CHECK_KINDS)}"
        )
    return CHECK_KINDS[check.kind]


def advise(recordings: Recordings, chosen: Hypothesis, posteriors: Sequence[EffectPosterior]) -> list[AdvisedCheck]:
    """Return the checks that distinguish each named effect from its alternatives.

    The identifiers of the checks are still empty. The list is empty if no question is open.
    """
    open_causes = list(_open_causes(posteriors))
    names = list(dict.fromkeys(name for about, causes, _ in open_causes for name in (about, *causes)))
    # a release is predicted for a clamped arm; the motion of a moving arm would depend on its input
    expected = expected_recordings(recordings, chosen, names) if names and not recordings.arm_moves else []
    checks: list[AdvisedCheck] = []
    for open_one in open_causes:
        question, proposed = OpenQuestion(*open_one, chosen, expected), []
        for kind in CHECK_KINDS.values():
            proposed += kind.propose(question, proposed)
        checks += proposed
    return checks


def _open_causes(posteriors: Sequence[EffectPosterior]) -> Iterator[tuple[str, dict[str, float], bool]]:
    """Yield the open questions.

    A question consists of a named effect, the possible causes with their probabilities, and whether these causes form
    one class.
    """
    for effect in posteriors:
        if len(effect.members) > 1:
            shares = zip(effect.members, effect.odds, strict=True)
            yield effect.name, {name: effect.probability * share for name, share in shares}, True
        for other in effect.alternatives:
            if other.probability >= PROBABLE:
                yield effect.name, {effect.name: effect.probability, other.name: other.probability}, False
