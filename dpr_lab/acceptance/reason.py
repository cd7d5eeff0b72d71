"""Reason why a limit is not decidable: cause, remedy, and the effects that the cause concerns."""

from dataclasses import dataclass
from typing import Literal

Obstacle = Literal["", "interval", "scale", "cause", "alike", "recordings", "diagnosis"]
"""What leaves a limit undecided: the width of the interval, the scale b alone, an uncertain cause, an indistinguishable
effect or value, missing recordings, or a diagnosis without valid intervals. Empty for a decided limit."""


@dataclass(frozen=True, slots=True)
class Reason:
    """Reason why a limit is not decidable; an empty reason is false."""

    cause: str = ""
    """Clause that states the cause."""
    remedy: str = ""
    """Clause that states how the limit can be decided, or why no further release decides it; empty if unknown."""
    obstacle: Obstacle = ""
    """Kind of the cause."""
    effects: tuple[str, ...] = ()
    """Effects that the cause names."""

    def __bool__(self) -> bool:
        """Return whether there is a reason."""
        return bool(self.cause)

    @property
    def text(self) -> str:
        """Cause and remedy in one clause."""
        return ": ".join(filter(None, (self.cause, self.remedy)))


NONE = Reason()
"""No reason: the limit is decided, or another rule gives the reason."""

WITHIN = "the limit lies within the interval"
"""Beginning of the cause of an undecided limit that further releases may decide."""


def within(further: str = "", remedy: str = "record more releases", effects: tuple[str, ...] = ()) -> Reason:
    """Return the reason of a limit that is undecided because it lies within the interval.

    Args:
        further: continuation of the cause, with its punctuation
        remedy: clause that states how the limit can be decided
        effects: effects that the cause names
    """
    return Reason(f"{WITHIN}{further}", remedy, "interval", effects)
