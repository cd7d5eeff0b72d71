"""When a reduction of the cost is significant: against noise, chance, and the error of an inexact form."""

from dataclasses import dataclass

from dpr_lab.gap.hypothesis.hypothesis import Hypothesis


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Acceptance thresholds, set on blind trials below seed 100000 of `benchmarks/diagnosis.py` and tested on others.

    chi2 counts in units of independent evidence, `ResidualStatistics.inflation`.
    """

    noise_floor: float = 4.0
    """Standard deviations of the residual that count as noise."""
    far: float = 20.0
    """chi2 per degree of freedom above which fits may end in local minima."""
    chance: float = 30.0
    """Fall of chi2 below which an effect is chance: the best of some 600 shapes."""
    chance_at_floor: float = 90.0
    """The same for one effect more where nothing but noise is left."""
    integrator: float = 5e-4
    """Share of what is explained that the integrator's steps leave in doubt."""
    integrator_at_floor: float = 5e-5
    """The same where a set leaves only noise, and so vouches for the steps."""
    slow: float = 1.3
    """Factor by which one effect more must at least shrink the excess, unless it is large."""
    keeps: float = 3.0
    """Factor by which the excess must grow without an effect, for the effect to stay."""
    keeps_if_large: float = 1.3
    """The same for a large one."""
    large: float = 0.04
    """Share of the whole gap above what another form of an effect named already could make up for."""
    small: float = 0.01
    """Share of the gap below which an effect only makes up for another's form, while something is left."""
    keeps_if_small: float = 30.0
    """Factor by which the excess must grow without a small one, for it to stay nevertheless."""
    contained: float = 0.003
    """Share of what is explained that a richer form of an effect must add while something is left."""
    own_share: float = 0.15
    """Share of what an effect explains that no other form of the rest explains, while something is left."""
    still_open: float = 0.5
    """Share of the gap that the rest must not leave open for that to be asked."""
    escaped: float = 10.0
    """Factor by which chi2 of the bare model falls that was held at a local minimum."""
    likelier: float = 10.0
    """Odds by the prior of its size from which an indistinguishable effect is named in the place of another."""
    indistinguishable: float = 0.999
    """Cosine of the signatures of two effects above which a recording hardly tells them apart."""


THRESHOLDS = Thresholds()


def excess(model: Hypothesis) -> float:
    """chi2 above the noise, not below what noise alone may leave."""
    return max(model.residuals.excess, THRESHOLDS.noise_floor * model.residuals.uncertainty)


def at_noise_floor(model: Hypothesis) -> bool:
    """Whether the residual is consistent with noise."""
    return model.residuals.z < THRESHOLDS.noise_floor


def far_from_noise(model: Hypothesis) -> bool:
    """Whether so much is left that a linear score is only a hint."""
    return model.residuals.chi2 > THRESHOLDS.far * model.residuals.dof


def indifference(
    base: Hypothesis, at: Hypothesis, *, independent: float = THRESHOLDS.chance, share: float = THRESHOLDS.integrator
) -> float:
    """Difference of cost between a set and another that tells neither apart: chance, or the integrator's steps."""
    return max(independent * at.residuals.inflation, share * (base.residuals.chi2 - at.residuals.chi2))


def significance(base: Hypothesis, before: Hypothesis, after: Hypothesis) -> float:
    """Fall of cost from one set to a larger one that means nothing."""
    if not before.effects:
        return THRESHOLDS.chance * after.residuals.inflation
    if at_noise_floor(after) and not at_noise_floor(before):
        return indifference(base, after, share=THRESHOLDS.integrator_at_floor)
    chance = THRESHOLDS.chance_at_floor if at_noise_floor(before) else THRESHOLDS.chance
    return indifference(base, after, independent=chance)


def accepted(base: Hypothesis, before: Hypothesis, after: Hypothesis) -> bool:
    """Whether one more effect explains more than chance, and more than an inexact functional form leaves."""
    if before.cost - after.cost < significance(base, before, after):
        return False
    if at_noise_floor(before) or excess(before) > THRESHOLDS.slow * excess(after):
        return True
    return excess(before) - excess(after) > THRESHOLDS.large * excess(base)


def need(base: Hypothesis, at: Hypothesis, less: Hypothesis) -> float:
    """Evidence for the effect that `less` lacks, relative to the threshold; 1 is enough to keep it."""
    if at_noise_floor(at):
        return (less.cost - at.cost) / (THRESHOLDS.chance * at.residuals.inflation)
    growth, factor = less.residuals.excess - excess(at), less.residuals.excess / excess(at)
    if growth < THRESHOLDS.small * excess(base) and factor < THRESHOLDS.keeps_if_small:
        return 0.0
    large = growth > THRESHOLDS.large * excess(base)
    return factor / (THRESHOLDS.keeps_if_large if large else THRESHOLDS.keeps)
