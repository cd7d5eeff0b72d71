"""Timing of the recorder."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RecorderSettings:
    """Time limits and message limits of the recorder."""

    go_ahead_lasts_s: float = 2.0
    """Maximum age of a release command, s. The operator may no longer intend an older command."""
    look_s: float = 0.1
    """Duration of one read from the device, s. Commands and displayed readings are delayed by up to this time."""
    idle_s: float = 0.5
    """Interval of reports while the rods rest, s. Readings count as current for three times as long."""
    noises: float = 3.0
    """Maximum change of an encoder reading at rest, in standard deviations of its noise. One count is added."""
    trace_hz: int = 100
    """Maximum number of points of a swing that are sent per second; a screen cannot show more."""
    unread: int = 30
    """Maximum number of waiting progress reports, about three seconds. Further messages are dropped while the screen
    does not read."""


SETTINGS = RecorderSettings()
