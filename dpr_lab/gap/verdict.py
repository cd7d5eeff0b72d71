"""The verdict in one word and one sentence; an honest "unexplained" before a wrong name."""

from collections.abc import Sequence
from typing import Literal

from dpr_lab.gap.classes import Standing, share_explained
from dpr_lab.gap.select import Selection
from dpr_lab.gap.worth import closed

Verdict = Literal["no_gap", "named", "partly_explained", "unexplained"]

NAMED_SHARE = 0.93
"""Of the excess: right models explained 0.97 and more, wrong libraries 0.91 at most."""
PARTLY_SHARE = 0.5
SURE = 0.6
"""Probability below which a class is not named."""
NOISE_LEVEL = 6.0
"""Standard deviations of the remainder up to which a named set counts as the whole story."""


def verdict(selection: Selection, standings: Sequence[Standing]) -> Verdict:
    """Which of the four it is."""
    chosen = selection.chosen
    if not chosen.effects:
        return "no_gap" if closed(chosen) else "unexplained"
    share = share_explained(selection)
    sure = max(item.probability for item in standings) >= SURE
    if chosen.remainder.z < NOISE_LEVEL and (share >= NAMED_SHARE or closed(chosen)) and sure:
        return "named"
    return "partly_explained" if share >= PARTLY_SHARE else "unexplained"


def sentence(kind: Verdict, selection: Selection, standings: Sequence[Standing]) -> str:
    """What the operator reads first."""
    share = share_explained(selection)
    left = selection.chosen.remainder
    names = _listed([_class(item) for item in standings])
    if kind == "no_gap":
        return "No gap visible at this noise: the bare model explains the recordings down to the noise floor."
    if kind == "named":
        sure = min(item.probability for item in standings)
        return f"The gap is explained by {names} (probability {sure:.0%}): nothing above the noise floor is left."
    if kind == "partly_explained":
        return (
            f"Partly explained by {names}: {share:.1%} of the excess; a remainder of {left.noise_ratio:.2g} times the"
            " noise has another cause or another form."
        )
    if not standings:
        return f"Unexplained: a gap of {left.noise_ratio:.2g} times the noise, and no effect of the library fits it."
    return f"Unexplained: closest {names}, which would explain only {share:.0%} of the excess."


def _class(item: Standing) -> str:
    return item.name if len(item.members) == 1 else f"({' or '.join(item.members)})"


def _listed(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)
