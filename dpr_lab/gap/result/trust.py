"""Reliability of a diagnosis, from blind trials on simulated plants that resemble the rig."""

from typing import Literal

from dpr_lab.gap.result.saved import Saved

NOTHING = "nothing"
"""Entry of the confusion matrix for a plant without a further effect, or for a diagnosis that names no further
effect."""


REFUSED = "refused"
"""Verdict for a plant whose recordings could not be diagnosed."""


class TrustTrial(Saved):
    """One simulated plant near the fitted estimate, with the diagnosis of its recordings.

    The recordings are simulated with the sensors of the rig.
    """

    kind: Literal["as found", "another", "clean"]
    """Kind of effects of the plant: the named effects, one effect drawn from the library, or no effect."""
    truth: dict[str, dict[str, float]]
    """Effects of the plant with all parameters, SI."""
    named: list[str]
    verdict: str
    """Verdict of the diagnosis, or `REFUSED` if the diagnosis failed."""
    right: list[str]
    """Effects of the plant that were named, alone or in a class of indistinguishable effects."""
    wrong: list[str]
    """Named effects that the plant does not have."""
    seconds: float


class ConfusionCell(Saved):
    """Number of trials with a given hidden effect and a given named effect."""

    true: str
    named: str
    trials: int


class TrustShare(Saved):
    """Frequency of an outcome in the blind trials: `held` out of `of` trials."""

    held: int
    of: int
    interval90: tuple[float, float]
    """90 % Wilson score interval of the share."""


class Trust(Saved):
    """Blind trials of a diagnosis, with their summary."""

    seed: int
    seconds_each: float
    """Median computing time of a trial, s."""
    trials: list[TrustTrial]
    confusion: list[ConfusionCell]
    right: TrustShare
    """Trials with effects in which exactly the effects of the plant were named."""
    wrong: TrustShare
    """Trials with effects in which a wrong effect was named."""
    false_alarms: TrustShare
    """Clean trials in which an effect was named."""
