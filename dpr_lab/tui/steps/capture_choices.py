"""Choices for a capture that the screen offers."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class CaptureChoices:
    """Choices for a capture that the screen offers."""

    durations: tuple[float, ...] = (5.0, 10.0, 20.0, 30.0, 60.0)
    """Durations of a recording, s. The choice after the last duration is "until rest"."""
    most_repeats: int = 5
    """Maximum number of recordings per pose. Further swings from one pose add little information."""
    pose_timeout: float = 1800.0
    """Maximum time to reach a pose, s. It can be long, because the screen shows the operator the remaining error."""
    rest_timeout: float = 120.0
    """Maximum time for the held rods to come to rest, s."""


CHOICES = CaptureChoices()
