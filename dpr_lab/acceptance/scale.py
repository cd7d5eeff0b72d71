"""Intervals of absolute sizes with an uncertain scale b, and the remedy for this uncertainty."""

from dpr_lab.acceptance.reason import Reason
from dpr_lab.identification.scaling.scale import Interval90, Scale
from dpr_lab.shown import percent


def with_scale(scale: Scale | None, interval: Interval90, power: int) -> Interval90:
    """Add the uncertainty of the scale b to the interval of a quantity that is proportional to b^power.

    The given interval is conditional on the assumed b. The result covers the conditional intervals at both ends of the
    90 % interval of b.
    """
    factors = [1.0, *(() if scale is None else scale.factors90(power))]
    return min(interval[0] * factor for factor in factors), max(interval[1] * factor for factor in factors)


def open_by_scale(scale: Scale) -> Reason:
    """Return the reason why only the uncertainty of b leaves a limit undecided, with the remedy."""
    low, high = scale.interval90_of_sizes
    uncertain = f"{scale.inertia} ({low:.3g} to {high:.3g} kg m^2)"
    if scale.sizes90:
        shares = f"{percent(low / scale.b)} to {percent(high / scale.b)}"
        uncertain = f"the inertia of the whole body ({shares} of the value in use)"
    remedy = "masses, lengths and inertias in the rig file, or record a release with an added mass or a known torque"
    if scale.constants_std:
        uncertain = f"the motor constants (standard deviation {percent(scale.constants_std)})"
        remedy = "motor constants in the rig file"
    cause = f"only the uncertainty of {uncertain} leaves the limit undecided"
    return Reason(cause, f"state more accurate {remedy}", "scale")
