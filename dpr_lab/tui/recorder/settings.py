"""Timing of the recorder."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RecorderSettings:
    """Time limits and message limits of the recorder, and limits on the age of its readings."""

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
    fresh_s: float = 1.5
    """Age above which the last readings count as outdated, s. A device reports ten times per second, and counts as lost
    after 1 s without a report."""
    outcome_s: float = 4.0
    """Time after a release command by which its result is known, s. The recorder discards a command after 2 s, and a
    device answers RELEASE within 1 s. A latch that is still closed later was not opened by that command."""


SETTINGS = RecorderSettings()
