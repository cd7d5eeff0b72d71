"""Whether the operator has seen what is shown: nothing that moves rods goes by what nobody saw."""

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class SightSettings:
    """Required speed of a terminal."""

    round_trip_s: float = 0.3
    """From a frame until the terminal has confirmed that it drew it: what an eye takes for at once."""
    patience_s: float = 10.0
    """How long a slow line may take to draw the first picture of a countdown."""
    least_columns: int = 40
    least_rows: int = 12
    """Size of a terminal in which the dialog is seen whole."""
    code_s: float = 60.0
    """How long the code that a multiplexer requires may take, until the countdown is cancelled."""
    code_length: int = 3
    """Characters of that code: a program or a stuck key guesses it in one of 6840 tries."""


SIGHT = SightSettings()


class Sight(Protocol):
    """Evidence that the screen was displayed."""

    @property
    def multiplexer(self) -> str:
        """Name of a program that confirms frames in place of the operator's terminal; empty where none is known."""
        ...

    async def seen(self, patience_s: float) -> float:
        """Send what is to be shown now, and wait until the terminal has confirmed that it drew it.

        Returns:
            The round trip, s.

        Raises:
            SafetyStop: it did not within the patience, or nobody is there to see it; says why and what to do.
        """
        ...
