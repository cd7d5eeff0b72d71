"""Acceptance thresholds of effects, for `significance` and `imitation`."""

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
    """Maximum residual that counts as noise, in standard deviations."""
    far: float = GAUSS_NEWTON.far
    """chi2 per degree of freedom above which fits may end in local minima."""
    chance: float = 30.0
    """Maximum reduction of chi2 by chance: the largest among about 600 shapes."""
    chance_at_floor: float = 90.0
    """Maximum reduction of chi2 by chance if only noise remains without the effect."""
    promising: float = 0.5
    """Minimum predicted reduction of an effect that is fitted to few readings, as a fraction of the excess."""
    significant_scatter: float = 4.0
    """Minimum significant reduction of chi2 while a residual remains, in standard errors from the segments."""
    chance_scatter: float = NORMAL_Q90
    """Difference of chi2 between two sets that chance exceeds in 5 % of cases, in standard errors from the segments."""
    fewest_segments: int = 10
    """Minimum number of segments from which their scatter can be estimated."""
    integrator: float = 5e-4
    """Uncertainty of the explained chi2 due to the integrator's steps, as a fraction."""
    integrator_at_floor: float = 5e-5
    """Value of `integrator` for a set that leaves only noise, which shows that the steps are small enough."""

    # factors of the excess
    excess_factor: float = 1.3
    """Minimum ratio of the excess without an effect to the excess with it, for an added effect and for a large one."""
    necessary_factor: float = 3.0
    """Minimum factor by which the excess increases without an effect that is kept."""
    necessary_factor_if_small: float = 30.0
    """Minimum factor by which the excess increases without a small effect that is kept."""
    local_minimum_factor: float = 10.0
    """Minimum factor by which a repeated fit reduces chi2 if the first fit was a local minimum."""

    # fractions of the whole gap
    large: float = 0.04
    """Minimum size of a large effect; another form of a named effect explains less."""
    small: float = 0.01
    """Size below which an effect merely compensates for another form while a residual remains."""
    secondary: float = 0.1
    """Size below which an effect may compensate for the form of a larger one even if only noise remains."""
    open_share: float = 0.5
    """Maximum fraction that remains without an effect for the test of `own_share` to apply."""
    explained: float = 0.93
    """Minimum share of the bare model's excess that the explanation of the gap explains.

    In blind trials, correct sets explained at least 0.97, and sets from a library without the cause at most 0.91.
    """

    # similar explanations
    simpler_share: float = 0.9
    """Minimum reduction of the excess by a simpler explanation, relative to that by the richer one."""
    vibration_share: float = 0.5
    """Minimum relative reduction by an explanation that replaces a vibration at a multiple of the swing's frequency."""
    richer_form_share: float = 0.003
    """Minimum fraction of the explained chi2 that a richer form adds while a residual remains."""
    own_share: float = 0.15
    """Minimum fraction of an effect's reduction of chi2 that no other form of the remaining effects explains.

    The limit applies while a residual remains.
    """
    curve_growth: float = 2.0
    """Minimum growth factor of the amplitudes of a curve that replaces a removed effect."""
    likelier: float = 5.0
    """Minimum ratio of the prior probabilities if an effect replaces another one that explains as much."""
    tie: float = 1.5
    """Ratio of the probabilities of two indistinguishable effects up to which a fixed order or the search decides."""
    indistinguishable: float = 0.999
    """Minimum cosine of the signatures of two effects that recordings hardly distinguish."""


THRESHOLDS = Thresholds()
