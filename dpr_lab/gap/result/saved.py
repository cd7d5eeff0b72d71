"""Base types of saved results: frozen records with finite numbers, and intervals."""

import math

from pydantic import BaseModel, ConfigDict


class Saved(BaseModel):
    """Base class of frozen records; a file with unknown keys is refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True, populate_by_name=True, allow_inf_nan=False)


class Interval(Saved):
    """A number with its 90 % interval."""

    value: float
    """Value of the number, SI."""
    interval90: tuple[float, float]
    """Limits of the 90 % interval, SI."""

    @classmethod
    def about(cls, value: float, half_width: float, floor: float = -math.inf) -> "Interval":
        """Return the interval value -+ `half_width`, whose lower limit is at least `floor`."""
        return Interval(value=value, interval90=(max(value - half_width, floor), value + half_width))
