"""Common scale of masses, inertias and torques: the inertia b.

A free swing determines only ratios to b. A size that is proportional to b^k is therefore ratio * b^k, and both factors
are uncertain. The power k is 1 for a torque or an inertia, and -1 for a quantity in 1/kg.
"""

from math import exp, hypot, log
from typing import Literal

from pydantic import BaseModel, ConfigDict, NonNegativeFloat, PositiveFloat

from dpr_lab.estimation.noise import NORMAL_Q90

Interval90 = tuple[float, float]


ROD_OF = {"a": "inner rod about joint 1", "b": "outer rod about joint 2"}
"""Rods to which the inertias a and b belong."""


class ModelPart(BaseModel):
    """Part of a model file; keys of other versions are ignored."""

    model_config = ConfigDict(extra="ignore", frozen=True, defer_build=True, allow_inf_nan=False)


class Scale(ModelPart):
    """Scale of absolute sizes: the assumed inertia b, with its interval and source."""

    b: PositiveFloat
    """Inertia assumed for all absolute sizes, kg m^2: b of the outer rod about joint 2, or a of an inner rod alone."""
    interval90: tuple[PositiveFloat, PositiveFloat]
    """90 % interval of b from the recordings and the rig file together, kg m^2."""
    fixed_by: Literal["data", "measured", "bound"]
    """Source of the scale: `data`, `measured` or `bound`.

    `data`: a known torque, added mass or weighed load. `measured`: measured values of the rig file. `bound`: only
    nominal values and bounds of the rig file, so that only ratios to b are identifiable.
    """
    inertia: Literal["a", "b"] = "b"
    """Name of the inertia: `b` of the outer rod about joint 2, or `a` of the inner rod about joint 1 if it is alone."""
    constants_std: NonNegativeFloat = 0.0
    """Relative standard deviation of b due to motor constants of the rig file; 0 if b does not depend on them."""
    by_friction: bool = False
    """Whether load-dependent friction determines the scale, without known torques and added masses."""
    sizes90: tuple[PositiveFloat, PositiveFloat] | None = None
    """90 % interval of the scale of sizes, if it differs from that of b, kg m^2.

    With a clamped elbow, sizes are known relative to the inertia of the whole body. `sizes90` is the interval of this
    inertia, converted to b by the ratios a/b and d/b in use, which the recordings do not determine.
    """

    @property
    def known(self) -> bool:
        """Whether the recordings or measured values determine the scale."""
        return self.fixed_by != "bound"

    @property
    def interval90_of_sizes(self) -> Interval90:
        """90 % interval of b that applies to sizes proportional to b, kg m^2."""
        return self.sizes90 or self.interval90

    @property
    def log_std(self) -> float:
        """Standard deviation of the logarithm of b that corresponds to the interval of sizes."""
        low, high = self.interval90_of_sizes
        return log(high / low) / (2 * NORMAL_Q90)

    @property
    def assumption(self) -> str:
        """Note on the scale, for example `assuming b = 0.00534 kg m^2 (not measured)`."""
        if self.known:
            source = "measured" if self.fixed_by == "measured" else "identified"
            return f"with {self.inertia} = {self.b:.4g} kg m^2 ({source})"
        return f"assuming {self.inertia} = {self.b:.4g} kg m^2 (not measured)"

    @property
    def condition(self) -> str:
        """Sentence on the validity of the interval.

        It is empty unless a known torque or added mass determines the scale.
        """
        if self.fixed_by != "data" or self.constants_std or self.by_friction:
            return ""
        exact = "Known torques and added masses are treated as exact"
        return f" {exact}: an error of 1 % in them changes all sizes by 1 %, and no interval contains this error."

    @property
    def sentence(self) -> str:
        """Sentence that states the scale of absolute sizes and the interval of b."""
        low, high = self.interval90
        known = f"{self.inertia} = {self.b:.4g} kg m^2 (90 % interval {low:.4g} to {high:.4g})"
        if self.fixed_by == "data":
            sources = "The recordings" + (" and measured motor constants" if self.constants_std else "")
            return f"{sources} determine the scale of masses, inertias and torques: {known}.{self.condition}"
        if self.fixed_by == "measured":
            return f"Measured values of the rig file determine the scale of masses, inertias and torques: {known}."
        values = "recorded input of the motor and its nominal constants in" if self.constants_std else "values of"
        return (
            f"Only the ratios of masses, inertias and torques to {self.inertia}, the inertia of the"
            f" {ROD_OF[self.inertia]}, are identified. Absolute values assume {self.inertia} = {self.b:.4g} kg m^2,"
            f" from the {values} the rig file (90 % interval from its bounds {low:.4g} to {high:.4g})."
        )

    def as_inertia(self, inertia: Literal["a", "b"], factor: float) -> "Scale":
        """Express the scale by a different inertia, which is `factor` times the current inertia."""
        intervals = {"interval90": self.interval90} | ({"sizes90": self.sizes90} if self.sizes90 else {})
        scaled = {name: (low * factor, high * factor) for name, (low, high) in intervals.items()}
        return self.model_copy(update={"b": self.b * factor, "inertia": inertia} | scaled)

    def ratio(self, value: float, power: int = 1) -> float:
        """Divide a size by b^power, so that the result does not depend on the scale b."""
        return value / self.b**power

    def factors90(self, power: int) -> tuple[float, float]:
        """Return the factors by which a size proportional to b^power changes at the ends of the interval of b.

        If the recordings determine the scale b, it is fitted together with the size. The interval of the size then
        already contains the error of b, and only errors of motor constants, which are not fitted, are added.
        """
        reach = NORMAL_Q90 * self.constants_std
        low, high = (
            (1 - reach, 1 + reach) if self.fixed_by == "data" else [end / self.b for end in self.interval90_of_sizes]
        )
        ends = [max(low, 1e-3) ** power, high**power]
        return min(ends), max(ends)

    def with_scale90(self, value: float, interval: Interval90) -> Interval90:
        """Compute the 90 % interval of a torque or inertia from the interval of its ratio.

        `value` and `interval` are the ratio and its interval, multiplied by the b of this scale. The error of the scale
        is always added as in `absolute90`, because the interval of a ratio does not contain it.
        """
        return self.model_copy(update={"fixed_by": "measured"}).absolute90(value, interval)

    def absolute90(self, value: float, interval: Interval90, power: int = 1) -> Interval90:
        """Compute the 90 % interval of an absolute size, including the uncertainty of the scale.

        On each side, two independent errors are added in quadrature: the distance to the end of the fitted interval,
        and the change of the value due to b alone. Because b is positive, the interval contains values of the other
        sign only if the fitted interval does.

        Args:
            value: size at this b
            interval: 90 % interval of the size at this b
            power: power of the scale in the size; 0 for an angle or a time, whose interval is unchanged
        """
        factors = self.factors90(power)
        if factors == (1.0, 1.0):
            return interval
        moved = sorted(value * factor for factor in factors)
        below = hypot(value - interval[0], max(value - moved[0], 0.0))
        above = hypot(interval[1] - value, max(moved[1] - value, 0.0))
        low, high = value - below, value + above
        return max(low, 0.0) if interval[0] >= 0.0 else low, min(high, 0.0) if interval[1] <= 0.0 else high


def lognormal90(median: float, log_std: float) -> Interval90:
    """Return the 90 % interval of a positive value whose logarithm has a normal distribution."""
    reach = exp(NORMAL_Q90 * log_std)
    return median / reach, median * reach
