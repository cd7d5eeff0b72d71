"""Other interpretations of moving-arm angles: different sign, zero, unit or scale."""

from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array


def per_degree() -> float:
    """Return the factor from readings in degrees, declared as rad, to rad."""
    return float(np.deg2rad(1.0))


@dataclass(frozen=True, slots=True)
class ScaledReadings:
    """Interpretation in which the true angles are multiples of the readings.

    The angles of the rods are measured from the hanging position.
    """

    arm: float = 1.0
    """Ratio of the true angle of the arm to its reading."""
    rods: float = 1.0
    """Ratio of the true angles of the rods, from the hanging position, to their readings."""
    turned: bool = False
    """Whether the zero of the rods has an error of half a turn: upright instead of hanging, or the reverse."""

    def of_joints(self, joints: Array, hanging: Array) -> Array:
        """Convert the readings of the joints to true angles (n, k), rad.

        Args:
            joints: (n, k) readings of joints 1, 2 and, if the arm was read, 0, rad
            hanging: (2,) angles of joints 1 and 2 at the hanging rest, rad
        """
        zero = np.append(hanging, 0.0)[: joints.shape[1]]
        factors = np.array([self.rods, self.rods, self.arm])[: joints.shape[1]]
        return zero * (1.0 + self.turned) + (joints - zero) * factors

    def of_theta(self, theta: Array) -> Array:
        """Convert the readings of arm and rods to true angles (n, 3), rad."""
        return self.of_joints(theta[:, [1, 2, 0]], np.full(2, np.pi))[:, [2, 0, 1]]

    def of_sigma(self, sigma: Array) -> Array:
        """Convert the noise of the readings to the noise (..., k) of the true angles.

        The order is the same as in `of_joints`.
        """
        return sigma * np.abs([self.rods, self.rods, self.arm])[: sigma.shape[-1]]

    def cause(self, mounted: str) -> str:
        """Describe the mistake and its correction: an option or a key of the rig file.

        Args:
            mounted: the mounted rods, as in the rig file
        """
        rods = ("theta1", "theta2") if mounted == "both" else ("theta1",)
        if self.turned:
            return (
                "the angles of the rods are off by half a turn: import a table with the other --zero (upright or"
                " hanging), or, for a device, correct zero_counts in [encoders]"
            )
        if self.arm == self.rods == per_degree():
            return "the angles are in degrees, not in rad: import a table with --unit deg"
        axes = (*(("theta0",) if self.arm != 1.0 else ()), *(rods if self.rods != 1.0 else ()))
        factor = self.arm if self.arm != 1.0 else self.rods
        option = ",".join(f"{axis}={factor:{'.6g' if factor == per_degree() else '.3g'}}" for axis in axes)
        verb = "are" if len(axes) > 1 else "is"
        if factor == per_degree():
            return f"{' and '.join(axes)} {verb} in degrees, not in rad: import a table with --scale {option}"
        return (
            f"{' and '.join(axes)} {verb} {1 / factor:.3g} times the true angle: import a table with --scale"
            f" {option}, or, for a device, multiply counts_per_rev in [encoders] by {1 / factor:.3g}"
        )


SCALED_READINGS = tuple(ScaledReadings(*factors) for f in (2.0, 0.5) for factors in ((1.0, f), (f, 1.0), (f, f)))
"""Interpretations that are tested: the readings are half or twice the true angles."""

TURNED_RODS = ScaledReadings(turned=True)
