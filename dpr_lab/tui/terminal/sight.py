"""Whether the operator has seen what is shown: nothing that moves rods goes by what nobody saw."""

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class SightSettings:
    """How quick a terminal has to be."""

    round_trip_s: float = 0.3
    """From a frame until the terminal has confirmed that it drew it: what an eye takes for at once."""
    patience_s: float = 10.0
    """How long a slow line may take to draw the first picture of a countdown."""


SIGHT = SightSettings()


class Sight(Protocol):
    """What can tell whether the screen was seen."""

    async def seen(self, patience_s: float) -> float:
        """Send what is to be shown now, and wait until the terminal has confirmed that it drew it.

        Returns:
            The round trip, s.

        Raises:
            SafetyStop: it did not within the patience, or nobody is there to see it; says why and what to do.
        """
        ...
