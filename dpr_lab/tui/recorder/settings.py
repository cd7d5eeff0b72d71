"""Timing of the recorder."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RecorderSettings:
    """Time limits and amounts of the recorder."""

    go_ahead_lasts_s: float = 2.0
    """Maximum age of a release command, s; an older one may no longer be intended."""
    look_s: float = 0.1
    """Duration of one read of the device, s: the delay of a command and of displayed readings."""
    idle_s: float = 0.5
    """Interval of reports on resting rods, s; a reading counts as current for three times as long."""
    noises: float = 3.0
    """Standard deviations of an encoder, plus one count, within which a rod counts as resting."""
    trace_hz: int = 100
    """Maximum number of points of a swing sent per second, because a screen cannot show more."""
    unread: int = 30
    """Maximum number of progress reports waiting for a screen that does not read them; about three seconds."""


SETTINGS = RecorderSettings()
