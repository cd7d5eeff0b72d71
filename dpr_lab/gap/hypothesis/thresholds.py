"""Acceptance thresholds of effects, for `significance` and `imitation`."""

from dataclasses import dataclass

from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.gauss_newton import GAUSS_NEWTON


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Acceptance thresholds of effects.

    They were set on blind trials with seeds below 100000 of `benchmarks/diagnosis.py` and tested on other seeds. The
    unit of chi2 is `ResidualStatistics.inflation`, the chi2 of one independent reading.
    """

    # noise and chance
    noise_floor: float = 4.0
    """Maximum residual that counts as noise, in standard deviations."""
    far: float = GAUSS_NEWTON.far
    """chi2 per degree of freedom above which fits may end in local minima."""
    chance: float = 30.0
    """Maximum reduction of chi2 that is attributed to chance: the largest reduction among about 600 shapes."""
    chance_at_floor: float = 90.0
    """Maximum reduction of chi2 by an additional effect that is attributed to chance if only noise remains."""
    promising: float = 0.5
    """Minimum predicted reduction, as a fraction of the excess, for an effect that is fitted to few readings."""
    consistent: float = 4.0
    """Minimum reduction of chi2 that counts as significant while a residual remains.

    The unit is the standard error estimated from the scatter of segments.
    """
    beyond_chance: float = NORMAL_Q90
    """Difference between two given sets that chance exceeds in 5 % of cases.

    The unit is the standard error from the scatter of segments.
    """
    fewest_segments: int = 10
    """Minimum number of segments from which their scatter can be estimated."""
    integrator: float = 5e-4
    """Fraction of the explained chi2 that is uncertain because of the steps of the integrator."""
    integrator_at_floor: float = 5e-5
    """Fraction like `integrator` for a set that leaves only noise, which confirms that the steps are small enough."""

    # factors of the excess
    excess_factor: float = 1.3
    """Minimum factor by which an additional effect must reduce the excess, unless it is large.

    Without a large effect, the excess must increase by this factor for the effect to be kept.
    """
    necessary_factor: float = 3.0
    """Minimum factor by which the excess must increase without an effect for the effect to be kept."""
    necessary_factor_if_small: float = 30.0
    """Minimum factor by which the excess must increase without a small effect for the effect to be kept."""
    local_minimum_factor: float = 10.0
    """Minimum factor by which a repeated fit reduces chi2 for the first fit to count as a local minimum."""

    # fractions of the gap
    large: float = 0.04
    """Minimum size of a large effect, as a fraction of the whole gap.

    Another form of a named effect can explain at most this fraction.
    """
    small: float = 0.01
    """Size of an effect, as a fraction of the gap, below which it merely compensates for another form.

    The limit applies while a residual remains.
    """
    secondary: float = 0.1
    """Size of an effect, as a fraction of the gap, below which it may compensate for the form of a larger effect.

    The limit applies even if only noise remains.
    """
    open_share: float = 0.5
    """Maximum fraction of the gap that may remain without an effect for the test of `own_share` to apply."""
    explained: float = 0.93
    """Minimum share of the excess of the bare model that a set must explain to be the explanation of the gap.

    In blind trials, correct sets explained at least 0.97 of the excess, and sets from a library without the cause at
    most 0.91.
    """

    # similar explanations
    nearly_all: float = 0.9
    """Minimum reduction of the excess by simple effects that replace a curve, relative to the reduction by the curve.

    The rule applies if only a small residual remains.
    """
    most_of_it: float = 0.5
    """Minimum reduction of the excess by other effects that replace a vibration at a multiple of the swing's frequency.

    It is relative to the reduction by the vibration.
    """
    richer_form_share: float = 0.003
    """Minimum fraction of the explained chi2 that a richer form of an effect must add while a residual remains."""
    own_share: float = 0.15
    """Minimum own share of an effect while a residual remains.

    The own share is the fraction of an effect's reduction of chi2 that other functional forms of the remaining effects
    cannot explain.
    """
    curve_growth: float = 2.0
    """Minimum growth factor of the amplitudes of a curve that replaces a removed effect."""
    likelier: float = 10.0
    """Minimum ratio of the prior probabilities of two sizes for an indistinguishable effect to replace a named one."""
    indistinguishable: float = 0.999
    """Minimum cosine of the signatures of two effects that recordings hardly distinguish."""


THRESHOLDS = Thresholds()
