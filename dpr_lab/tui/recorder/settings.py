"""How the recorder listens and talks."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RecorderSettings:
    """Time limits and amounts of the recorder."""

    go_ahead_lasts_s: float = 2.0
    """A go-ahead that was stuck in a pipe for longer is not what the operator wants now."""
    look_s: float = 0.1
    """How long one look at the device takes: the delay of an order, and of what is shown of idle rods."""
    idle_s: float = 0.5
    """Interval of reports on resting rods; a sighting is fact for three times as long."""
    noises: float = 3.0
    """Standard deviations of an encoder, plus one count, within which a rod counts as resting."""
    trace_hz: int = 100
    """Points of a swing that are sent a second; a screen has no room for more."""
    unread: int = 30
    """Reports of progress kept for a screen that does not read them; about three seconds of them."""


SETTINGS = RecorderSettings()
