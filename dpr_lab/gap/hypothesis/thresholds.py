"""Acceptance thresholds of effects."""

from dataclasses import dataclass

from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.gauss_newton import GAUSS_NEWTON


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Acceptance thresholds of effects, set on blind trials of `benchmarks/diagnosis.py` (seeds below 100000).

    The unit of chi2 is the inflation, the chi2 of one independent reading.
    """

    # noise and chance
    noise_floor: float = 4.0
    """Maximum significance of a residual that counts as noise, in standard deviations."""
    far: float = GAUSS_NEWTON.far
    """chi2 per degree of freedom above which fits may end in local minima."""
    chance: float = 30.0
    """Maximum reduction of chi2 by chance: the largest among about 600 shapes."""
    chance_at_floor: float = 90.0
    """Maximum reduction of chi2 by chance if only noise remains without the effect."""
    promising: float = 0.5
    """Predicted reduction of chi2 from which an effect is fitted in any case, as a fraction of the excess."""
    significant_scatter: float = 4.0
    """Minimum significant reduction of chi2 while a residual remains, in standard errors from the segments."""
    chance_scatter: float = NORMAL_Q90
    """Difference of chi2 between two sets that chance exceeds in 5 % of cases, in standard errors from the segments."""
    fewest_segments: int = 10
    """Minimum number of segments from which their scatter can be estimated."""
    integrator: float = 5e-4
    """Uncertainty of the explained chi2 due to the integrator's steps, as a fraction."""
    integrator_at_floor: float = 5e-5
    """Value of `integrator` for a set that leaves only noise: its residual limits the error of the steps."""

    # factors of the excess
    excess_factor: float = 1.3
    """Minimum ratio of the excess without an effect to the excess with it, for an added effect and for a large one."""
    necessary_factor: float = 3.0
    """Minimum factor by which the excess increases if a necessary effect is removed."""
    necessary_factor_if_small: float = 30.0
    """Minimum factor by which the excess increases if a necessary small effect is removed."""
    local_minimum_factor: float = 10.0
    """Factor of chi2 between two fits of the bare model above which the first fit counts as a local minimum."""

    # fractions of the whole gap
    large: float = 0.04
    """Minimum contribution of a large effect; another form of a named effect contributes less."""
    small: float = 0.01
    """Contribution below which an effect counts as a compensation for an inexact form while a residual remains."""
    secondary: float = 0.1
    """Contribution below which an effect may be a compensation even if only noise remains."""
    open_share: float = 0.5
    """Maximum fraction that remains without an effect if the limit `own_share` applies to it."""
    explained: float = 0.93
    """Minimum share of the bare model's excess that a set explains if it counts as the explanation of the gap.

    In blind trials, correct sets explained at least 0.97, and sets from a library without the cause at most 0.91.
    """

    # similar explanations
    simpler_share: float = 0.9
    """Minimum reduction of the excess by a simpler explanation, relative to that by the richer one."""
    vibration_share: float = 0.5
    """Minimum reduction by a set that replaces a vibration at a multiple of the swing frequency, relative to the
    vibration."""
    richer_form_share: float = 0.003
    """Minimum additional chi2 that a richer form explains while a residual remains, as a fraction of the explained
    chi2."""
    own_share: float = 0.15
    """Own share below which an effect may be a compensation, while a residual remains."""
    curve_growth: float = 2.0
    """Minimum growth factor of the amplitudes of a curve that replaces a removed effect."""
    likelier: float = 5.0
    """Minimum ratio of the prior odds of a set that replaces another set although it explains only about as much."""
    tie: float = 1.5
    """Maximum ratio of the probabilities of two indistinguishable effects between which a fixed order or the search
    decides."""
    indistinguishable: float = 0.999
    """Minimum cosine of the signatures of two effects that count as indistinguishable."""


THRESHOLDS = Thresholds()
