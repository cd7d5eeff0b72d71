"""Named effects with their sizes and probabilities, their families, and their alternatives."""

from collections.abc import Mapping, Sequence

from pydantic import Field

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.result.saved import Interval, Saved

PROBABLE = 0.05
"""Minimum probability of a listed cause, and of an alternative that a check should exclude."""

UNTESTED = "because one release tests its functional form only weakly"
"""Reason why the probability of an effect with several parameters is limited (decision 123)."""


def nameable(members: Sequence[str], odds: Mapping[str, float], least: float = 1e-4) -> list[str]:
    """Return the first member of a class, and those whose share of the class probability is at least `least`."""
    return [name for name in members if name == members[0] or odds.get(name, 1.0) >= least]


class EffectSize(Interval):
    """Size of a parameter of an effect: value, ratio to b^k, and the intervals of both.

    k is the power of the inertia b in the parameter. `interval90` contains only the uncertainty of the fit. It is
    conditional on the assumed b and on the lengths, gravity and measured values of the rig file.
    """

    ratio: float | None = None
    """Ratio value / b^k, which does not depend on the scale.

    None if the recordings determine b, if the elbow was always clamped, or if k is 0.
    """
    ratio_unit: str = ""
    """Unit of the ratio, SI."""
    ratio_interval90: tuple[float, float] | None = None
    """90 % interval of the ratio."""
    interval90_with_scale: tuple[float, float] | None = None
    """90 % interval of the absolute value, including the uncertainty of b; None in a file of an older version."""


class FittedEffect(Saved):
    """A fitted effect with its class and its sizes."""

    name: str
    """Name of the effect, a key of `dpr_lab.effects.EFFECTS`."""
    members: list[str] = Field(alias="class")
    """The effect and the effects that are indistinguishable from it in these recordings."""
    parameters: dict[str, EffectSize]
    """Size of each parameter, SI, by the name of the parameter."""

    @property
    def insignificant(self) -> set[str]:
        """Amplitudes whose intervals contain zero; empty if this applies to all amplitudes."""
        amplitudes = {p.name for p in EFFECTS[self.name].amplitudes} & set(self.parameters)
        ends = {name: self.parameters[name].interval90 for name in amplitudes}
        unclear = {name for name, (low, high) in ends.items() if low <= 0 <= high}
        return unclear if unclear != amplitudes else set()


class CommonEffect(FittedEffect):
    """One effect in the fit of the common effects alone, which does not confirm it as a cause."""

    share: float
    """Share of the excess chi-square that this effect and the effects before it explain together."""


class NamedEffect(FittedEffect):
    """One effect of the selected set, with its size and probability."""

    odds: dict[str, float] = {}
    """Share of the probability that each member of the class has, from the plausibility of its size."""
    forms: list[str] = []
    """Richer forms of the members that count as the simpler form.

    All their additional amplitudes are excluded at the minimum detectable sizes.
    """
    probability: float
    """Probability that the cause is one of the members."""
    outside: float | None = None
    """Probability that a cause outside the library replaces the effect; None in a file of an older version."""
    untested: bool = False
    """Whether the probability is limited because one release of a single rod tests the form only weakly."""
    share: float
    """Unique contribution: share of the excess chi-square that returns without the effect."""

    @property
    def candidates(self) -> dict[str, float]:
        """Probability, for each member of the class, that this member is the cause.

        In a file of an older version, the probabilities of all members are equal.
        """
        equal = 1 / len(self.members)
        return {name: self.probability * self.odds.get(name, equal) for name in self.members}

    @property
    def only_by_prior(self) -> list[str]:
        """Other members of the class, if all together are improbable because of their sizes or prior odds."""
        others = [name for name in self.members if name != self.name]
        return others if self.odds.get(self.name, 0.0) > 1 - PROBABLE else []


class NamedFamily(Saved):
    """Named effects that together form one component."""

    name: str
    """Name of the family."""
    words: str
    """Description of the component, for readers."""
    effects: list[str]
    """Named effects that belong to the family."""
    probability: float
    """Probability of the component: the largest probability of its specific effects."""
    share: float
    """Share of the excess chi-square that returns if all effects of the family are removed."""


class RivalEffect(Saved):
    """An alternative to a named effect, with its probability."""

    name: str
    """Name of the alternative, a key of `dpr_lab.effects.EFFECTS`."""
    members: list[str] = Field(alias="class")
    """The effect and the effects that are indistinguishable from it in these recordings."""
    probability: float
    """Probability that the alternative is the cause instead."""
    cosine: float
    """Cosine similarity of the signatures of this effect and of the named effect; 1 if they are proportional."""
    instead_of: str = ""
    """Named effect that the alternative could replace; empty if no effect is named."""
