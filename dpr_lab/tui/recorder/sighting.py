"""What was last seen of the rods, and how long ago: nothing is stated as fact that may have changed since."""

import math
from dataclasses import dataclass

from dpr_lab.acquisition.capture import SwingReading
from dpr_lab.acquisition.holding import PoseReading, RestReading
from dpr_lab.tui.recorder.messages import AttemptSeen, Idle


@dataclass(frozen=True, slots=True)
class SightingSettings:
    """Validity of the last readings."""

    fresh_s: float = 1.5
    """A device reports ten times a second and counts as lost after one; beyond that nobody knows."""
    outcome_s: float = 4.0
    """After an order to release. The recorder drops an order after 2 s, and a device answers RELEASE within 1 s. So a
    latch that is reported closed later than this was not opened by that order."""


SETTINGS = SightingSettings()


@dataclass(frozen=True, slots=True)
class Sighting:
    """The rods and the latch, at one instant."""

    theta: tuple[float, float, float] | None = None
    """Absolute angles, rad."""
    latched: bool | None = None
    """As the device reported; None before its first report."""
    at: float = -math.inf
    """`time.monotonic()`, s."""

    def fresh(self, now: float) -> bool:
        """Whether it still holds."""
        return now - self.at <= SETTINGS.fresh_s

    def settles(self, ordered: float) -> bool:
        """Whether it shows what became of a release that was ordered at this time, `time.monotonic()`, s."""
        if self.latched is None:
            return False
        return self.at >= ordered if not self.latched else self.at > ordered + SETTINGS.outcome_s

    def ago(self, now: float) -> str:
        """`last seen 3.2 s ago`."""
        return f"last seen {now - self.at:.1f} s ago" if math.isfinite(self.at) else "never seen"


def seen_in(report: Idle | AttemptSeen, before: Sighting) -> Sighting:
    """Update the last readings by a report; values that it lacks are kept."""
    if isinstance(report, Idle):
        return Sighting(report.theta, report.latched, report.at)
    theta = before.theta
    if isinstance(report.progress, PoseReading | RestReading | SwingReading):
        theta = report.progress.theta
    return Sighting(theta, report.latched, report.at)
