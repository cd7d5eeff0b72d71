"""Interface of a board for `serve`, independent of its firmware."""

from collections.abc import Iterable
from typing import Protocol

from firmware_protocol.messages import Frame


class Board(Protocol):
    """Board on a link: it converts received frames to frames to send.

    The wall time is an argument of its methods, s.
    """

    streamed: float
    """Device time spent streaming since the first start, s."""

    @property
    def streams(self) -> bool:
        """Whether samples are being sent."""
        ...

    def service(self, wall: float, blocked: bool = False) -> list[Frame]:
        """Return the messages to send by the wall time `wall`, s.

        `blocked` states that the link accepts no more frames.
        """
        ...

    def receive(self, frame: Frame, wall: float) -> list[Frame]:
        """Process a frame that arrived at the wall time `wall`, s, and return the answers."""
        ...

    def note_dropped(self, frames: Iterable[Frame]) -> None:
        """Register the samples in frames for which the link had no room."""
        ...

    def reset(self) -> None:
        """Restart the board, as after a power failure."""
        ...
