"""Evidence that the operator has seen the screen; without this evidence, nothing is released."""

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class SightSettings:
    """Requirements on a terminal for the confirmation of a release."""

    round_trip_s: float = 0.3
    """Maximum time until the terminal confirms a frame, s. A shorter delay is hardly noticeable."""
    patience_s: float = 10.0
    """Maximum time for a slow terminal to draw the first frame of a countdown, s."""
    least_columns: int = 40
    """Minimum width of a terminal that shows the complete dialog, columns."""
    least_rows: int = 12
    """Minimum height of a terminal that shows the complete dialog, rows."""
    code_s: float = 60.0
    """Maximum time to type the code that a multiplexer requires, s."""
    code_length: int = 3
    """Number of letters of the code that a multiplexer requires. The probability that a program or a stuck key guesses
    the code is 1/6840."""


SIGHT = SightSettings()


class Sight(Protocol):
    """Evidence that the screen was displayed."""

    @property
    def multiplexer(self) -> str:
        """Name of a program that confirms frames instead of the operator's terminal.

        The text is empty if no such program is known.
        """
        ...

    async def seen(self, patience_s: float) -> float:
        """Send the current frame and wait until the terminal has confirmed that it was drawn.

        Returns:
            the round trip time, s

        Raises:
            SafetyStop: no confirmation in time, or nobody can see the screen; the message states the reason and the
                remedy.
        """
        ...
