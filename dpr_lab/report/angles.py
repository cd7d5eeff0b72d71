"""The unit in which angles are shown; inside they are radians."""

import math
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class AngleUnit:
    """A unit of angle."""

    name: str
    symbol: str
    per_rad: float
    digits: int
    """Decimals that an operator can act on."""
    small: str
    """Unit of errors and noise."""
    small_per_rad: float

    def text(self, angle: float) -> str:
        """An angle with its sign and unit."""
        return f"{angle * self.per_rad:+.{self.digits}f}{self.symbol}"

    def size(self, angle: float) -> str:
        """A small angle without a sign: three digits."""
        return f"{angle * self.per_rad:.3g}{self.symbol}"

    def speed(self, speed: float) -> str:
        """An angular velocity."""
        return f"{speed * self.per_rad:.{self.digits + 1}f}{self.symbol}/s"

    def all_of(self, theta: Sequence[float]) -> str:
        """Three angles, short."""
        return "  ".join(f"θ{joint} {self.text(angle)}" for joint, angle in enumerate(theta))

    def heads(self, columns: Sequence[str]) -> list[str]:
        """Columns of a table with its own unit in the place of mrad."""
        return [column.replace("mrad", self.small) for column in columns]

    @property
    def scale(self) -> str:
        """Where its scale begins: upright and hanging."""
        return f"0 upright, {math.pi * self.per_rad:.4g} hanging"


DEGREES = AngleUnit("degrees", "°", math.degrees(1.0), 1, "°", math.degrees(1.0))
RADIANS = AngleUnit("radians", " rad", 1.0, 3, "mrad", 1e3)
UNITS = {unit.name: unit for unit in (DEGREES, RADIANS)}
"""Which the screen switches between; tables and reports on paper are in radians."""
