"""When a fall of the cost means something: beside noise, beside chance, beside what another form could make up for."""

from dpr_lab.gap.hypothesis import Hypothesis

CLOSED = 4.0  # standard deviations of the remainder that count as noise
FAR = 20.0  # chi2 per degree of freedom above which fits may end in local minima
GAIN = 30.0
"""Fall of chi2, in units of independent evidence, below which an effect is chance: the best of some 600 shapes."""
EXTRA = 90.0  # the same for one effect more where nothing but noise is left
IN_DOUBT = 5e-4  # share of what is explained that the integrator's steps leave in doubt
IN_DOUBT_CLOSED = 5e-5  # the same where a set leaves only noise, and so vouches for the steps
SLOW = 1.3  # factor by which one effect more must at least shrink the excess, unless it is large
KEEPS = 3.0  # factor by which the remainder must grow without an effect, for the effect to stay
KEEPS_IF_LARGE = 1.3  # the same for an effect that explains at least `LARGE` of the whole gap
LARGE = 0.04  # above what another form of an effect named already could make up for
SMALL = 0.01  # share of the gap below which an effect only makes up for another's form, while something is left
DECISIVE = 30.0  # unless the remainder grows by this factor without it


def excess(item: Hypothesis) -> float:
    """chi2 above the noise, not below what noise alone may leave."""
    return max(item.remainder.excess, CLOSED * item.remainder.uncertainty)


def closed(item: Hypothesis) -> bool:
    """Whether nothing but noise is left."""
    return item.remainder.z < CLOSED


def far(item: Hypothesis) -> bool:
    """Whether so much is left that a linear score is only a hint."""
    return item.remainder.chi2 > FAR * item.remainder.dof


def doubt(base: Hypothesis, at: Hypothesis, *, independent: float = GAIN, share: float = IN_DOUBT) -> float:
    """Difference of cost between a set and another that tells neither apart: chance, or the integrator's steps."""
    return max(independent * at.remainder.inflation, share * (base.remainder.chi2 - at.remainder.chi2))


def chance(base: Hypothesis, before: Hypothesis, after: Hypothesis) -> float:
    """Fall of cost from one set to a larger one that means nothing."""
    if not before.effects:
        return GAIN * after.remainder.inflation
    if closed(after) and not closed(before):
        return doubt(base, after, share=IN_DOUBT_CLOSED)
    return doubt(base, after, independent=EXTRA if closed(before) else GAIN)


def worth(base: Hypothesis, before: Hypothesis, after: Hypothesis) -> bool:
    """Whether one effect more explains more than chance, and more than a form that is not quite right leaves open."""
    if before.cost - after.cost < chance(base, before, after):
        return False
    fall = excess(before) - excess(after)
    return closed(before) or excess(before) > SLOW * excess(after) or fall > LARGE * excess(base)


def need(base: Hypothesis, at: Hypothesis, less: Hypothesis) -> float:
    """How much a set needs the effect that `less` lacks; 1 is enough to keep it."""
    if closed(at):
        return (less.cost - at.cost) / (GAIN * at.remainder.inflation)
    growth, factor = less.remainder.excess - excess(at), less.remainder.excess / excess(at)
    if growth < SMALL * excess(base) and factor < DECISIVE:
        return 0.0
    return factor / (KEEPS_IF_LARGE if growth > LARGE * excess(base) else KEEPS)
