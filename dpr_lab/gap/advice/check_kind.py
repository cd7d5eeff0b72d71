"""Interface of the kinds of checks: proposal, options of the result, and probability of the result."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.gap.advice.expected_recordings import ExpectedRecording
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.result.checks import AdvisedCheck
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.rig import Rig
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class OpenQuestion:
    """An open question of a diagnosis: which of several causes is correct."""

    about: str
    """Name of the effect in question, which is one of the causes."""
    causes: Mapping[str, float]
    """Possible causes with their probabilities: the members of a class, or the effect and one alternative."""
    one_class: bool
    """Whether the causes are the members of one class."""
    chosen: Hypothesis
    """Selected set of the diagnosis."""
    expected: Sequence[ExpectedRecording]
    """Simulated recordings of the possible releases; empty if none can be predicted."""

    def check(self, kind: str, text: str, splits: Iterable[str], bits: float) -> AdvisedCheck:
        """Create a check of a given kind for this question; its identifier is still empty."""
        return AdvisedCheck(id="", kind=kind, text=text, about=self.about, splits=list(splits), expected_bits=bits)


@dataclass(frozen=True, slots=True)
class CheckAnswer:
    """Result of a check as entered by the operator."""

    runs: tuple[Run, ...] = ()
    rig: Rig | None = None
    """Rig of the runs."""
    value: float | str | None = None
    """Measured value: a number in the SI unit of the quantity, or a text with a unit."""
    std: float | str | None = None
    """Standard uncertainty of the value; a text without a unit has the unit of the value."""
    confirmed: bool = False
    """Whether the operator confirms the value. A confirmed value is accepted even if no candidate predicts it."""

    @property
    def entered(self) -> set[str]:
        """Names of the fields that contain the result of the check."""
        names = {field.name for field in fields(self)} - {"rig", "confirmed"}
        return {name for name in names if getattr(self, name) not in ((), None)}


@dataclass(frozen=True, slots=True)
class Result:
    """Result of a check, with its predictive densities."""

    words: str
    log_densities: Mapping[str, float]
    """Natural logarithm of the predictive density of the result, by candidate and for `NONE_OF_THEM`."""
    value: float | None = None
    std: float | None = None
    explained: bool = True
    """Whether at least one candidate predicts the result."""


@dataclass(frozen=True, slots=True)
class CheckKind:
    """One kind of check, with the functions that propose it and evaluate its result."""

    takes: frozenset[str]
    """Fields of a `CheckAnswer` that contain the result."""
    form: Callable[[AdvisedCheck], str]
    """Function that returns the command-line options with which the result is entered."""
    propose: Callable[[OpenQuestion, Sequence[AdvisedCheck]], list[AdvisedCheck]]
    """Function that returns checks for a question, given the proposals of the preceding kinds."""
    result: Callable[[Diagnosis, AdvisedCheck, CheckAnswer, Mapping[str, float]], Result]
    """Function that returns the result from diagnosis, check, answer and probabilities of the candidates."""


def expected_bits(probabilities: Sequence[float], separation: float) -> float:
    """Return the expected information gain of a check between two causes, bits.

    The gain is multiplied by the probability that one of the two causes is correct. The log likelihood ratio has a
    normal distribution of mean +-d^2/2 and variance d^2, where d is the distance between the predictions of the causes
    in standard deviations.

    Args:
        probabilities: (2,) probabilities of the causes; their sum may differ from one
        separation: distance d; infinite for an exact measurement
    """
    either = sum(probabilities)
    if either <= 0 or min(probabilities) <= 0:
        return 0.0
    p = probabilities[0] / either
    before = _entropy(np.array([p]))[0]
    if not np.isfinite(separation):
        return float(either * before)
    z = np.linspace(-6, 6, 241)
    weight = np.exp(-(z**2) / 2) / np.exp(-(z**2) / 2).sum()
    odds = np.log(probabilities[0]) - np.log(probabilities[1])
    entropies = [
        _entropy(1 / (1 + np.exp(-np.clip(odds + sign * separation**2 / 2 + separation * z, -500, 500))))
        for sign in (1, -1)
    ]
    return float(either * max(before - weight @ (p * entropies[0] + (1 - p) * entropies[1]), 0.0))


def log_mean(log_densities: Array, weights: Array) -> float:
    """Return the logarithm of the weighted mean of densities; the mean is unweighted if all weights are zero."""
    weights = weights if weights.any() else np.ones_like(weights)
    with np.errstate(divide="ignore"):
        return float(np.logaddexp.reduce(log_densities + np.log(weights / weights.sum())))


def _entropy(p: Array) -> Array:
    p = np.clip(p, 1e-12, 1 - 1e-12)
    return -(p * np.log2(p) + (1 - p) * np.log2(1 - p))
