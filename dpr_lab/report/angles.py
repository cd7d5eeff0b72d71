"""Define the units in which angles are displayed.

All computations are in radians.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class AngleUnit:
    """Unit in which angles are displayed."""

    name: str
    symbol: str
    per_rad: float
    digits: int
    """Number of decimals of a displayed angle."""
    small: str
    """Symbol of the unit for errors and noise, for example mrad."""
    small_per_rad: float

    def text(self, angle: float) -> str:
        """Format an angle with sign and unit."""
        return f"{_rounded(angle * self.per_rad, self.digits):+.{self.digits}f}{self.symbol}"

    def size(self, angle: float) -> str:
        """Format a small angle without sign, with three significant digits."""
        return f"{angle * self.per_rad:.3g}{self.symbol}"

    def speed(self, speed: float) -> str:
        """Format an angular velocity."""
        return f"{speed * self.per_rad:.{self.digits + 1}f}{self.symbol}/s"

    def speeds(self, omega: Sequence[float]) -> str:
        """Format the angular velocities of both rods in one line."""
        return "  ".join(
            f"ω{rod} {_rounded(speed * self.per_rad, self.digits):+.{self.digits}f}{self.symbol}/s"
            for rod, speed in enumerate(omega, 1)
        )

    def all_of(self, theta: Sequence[float]) -> str:
        """Format the angles of all joints in one line."""
        return "  ".join(f"θ{joint} {self.text(angle)}" for joint, angle in enumerate(theta))

    def heads(self, columns: Sequence[str]) -> list[str]:
        """Replace mrad in column headers by this unit."""
        return [column.replace("mrad", self.small) for column in columns]

    @property
    def scale(self) -> str:
        """Upright and hanging angles as text, for example `0 upright, 180 hanging`."""
        return f"0 upright, {math.pi * self.per_rad:.4g} hanging"


def _rounded(value: float, digits: int) -> float:
    """Round a value; a zero has no sign."""
    return round(value, digits) + 0.0


DEGREES = AngleUnit("degrees", "°", math.degrees(1.0), 1, "°", math.degrees(1.0))
RADIANS = AngleUnit("radians", " rad", 1.0, 3, "mrad", 1e3)
UNITS = {unit.name: unit for unit in (DEGREES, RADIANS)}
"""Units of the screen; reports are in radians."""
