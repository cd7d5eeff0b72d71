"""Estimated values with their uncertainty and source, and the values of the inner rod alone."""

from collections.abc import Sequence
from typing import Literal

from pydantic import NonNegativeFloat

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.identification.scaling.scale import ModelPart, Scale


class EstimatedValue(ModelPart):
    """Estimated value, its standard deviation and its 90 % interval."""

    value: float
    """Estimated value, SI."""
    std: NonNegativeFloat
    """Standard deviation, in the unit of the value."""
    interval90: tuple[float, float]
    """90 % interval, in the unit of the value."""
    profile90: tuple[float | None, float | None] | None = None
    """90 % interval by profile likelihood, if requested; an end without a bound is None."""
    fixed_by: Literal["data", "bound"] = "data"
    """Source: `data`, or `bound` if the value depends mainly on nominal values and bounds of the rig file."""

    def moved(self, value: float) -> "EstimatedValue":
        """Return the estimate with another value, and the interval moved by the same difference.

        An end at zero is not moved, and the lower end of an interval without negative values does not become negative.
        Both rules do not apply if the interval would then exclude the new value.
        """
        (lowest, highest), change = self.interval90, value - self.value
        low, high = lowest + change, highest + change
        if min(lowest, value) >= 0.0:
            low = max(low, 0.0) if lowest else 0.0
        if highest == 0.0 and value <= 0.0:
            high = 0.0
        return self.model_copy(update={"value": value, "interval90": (low, high)})


class ParameterValue(ModelPart):
    """One of the nine kinetic parameters and its source."""

    value: float
    """Value of the parameter, SI."""
    std: float | None
    """Standard deviation, SI; None for a value that only bounds determine."""
    fixed_by: Literal["data", "measured", "bound"]
    """Source: `data`, `measured` or `bound`.

    `data`: the recordings and measured values determine the value. `measured`: a bench measurement. `bound`: only the
    bounds of the search determine the value, so other values are equally good.
    """
    interval90: tuple[float, float] | None = None
    """90 % interval from the recordings and the rig file; that of the prior if only bounds determine the value."""


def ratios_alone(five: Sequence[EstimatedValue], p_over_b: float, gravity_rate: float) -> dict[str, EstimatedValue]:
    """Compute the ratios e1/a and c1/a of the inner rod alone.

    Args:
        five: the ratios of the fit
        p_over_b: ratio p/b of the fit
        gravity_rate: g / L1, 1/s^2
    """
    ratios, share = dict(zip(RATIOS, five, strict=True)), five[0].value - p_over_b

    def over_a(ratio: EstimatedValue, offset: float) -> EstimatedValue:
        low, high = ((end - offset) / share for end in ratio.interval90)
        ends = tuple(end if end is None else (end - offset) / share for end in ratio.profile90 or ())
        scaled = {"value": (ratio.value - offset) / share, "std": ratio.std / share, "interval90": (low, high)}
        return ratio.model_copy(update=scaled | {"profile90": ends or None})

    return {"e1/a": over_a(ratios["e1/b"], p_over_b * gravity_rate), "c1/a": over_a(ratios["c1/b"], 0.0)}


def base_alone(scale: Scale, gravity: EstimatedValue) -> dict[str, ParameterValue]:
    """Compute the base parameters a and e1 of the inner rod alone.

    Args:
        scale: inertia a with its interval and source
        gravity: ratio e1/a
    """
    value = gravity.value * scale.b
    low, high = (end * scale.b for end in gravity.interval90)
    interval = scale.with_scale90(value, (low, high))
    return {
        name: ParameterValue(
            value=middle,
            std=(ends[1] - ends[0]) / (2 * NORMAL_Q90) if scale.known else None,
            fixed_by=scale.fixed_by,
            interval90=ends,
        )
        for name, middle, ends in (("a", scale.b, scale.interval90), ("e1", value, interval))
    }
