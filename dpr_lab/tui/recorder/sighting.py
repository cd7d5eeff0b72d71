"""Last readings of the rods and their age; values that may have changed are marked as outdated."""

import math
from dataclasses import dataclass

from dpr_lab.acquisition.holding import PoseReading, RestReading
from dpr_lab.acquisition.rest import RodAngles
from dpr_lab.acquisition.swing import SwingReading
from dpr_lab.tui.recorder.messages import AttemptSeen, Idle
from dpr_lab.tui.recorder.settings import SETTINGS


@dataclass(frozen=True, slots=True)
class Sighting:
    """Angles of the rods and state of the latch at one instant."""

    theta: RodAngles | None = None
    """Absolute angles, rad."""
    latched: bool | None = None
    """State of the latch reported by the device; None before its first report."""
    at: float = -math.inf
    """Time of the reading, `time.monotonic()`, s."""

    def fresh(self, now: float) -> bool:
        """Return whether the reading is still current."""
        return now - self.at <= SETTINGS.fresh_s

    def settles(self, ordered: float) -> bool:
        """Return whether the reading shows the result of a release command.

        Args:
            ordered: instant at which the command was sent, s, as in `time.monotonic()`
        """
        if self.latched is None:
            return False
        return self.at >= ordered if not self.latched else self.at > ordered + SETTINGS.outcome_s

    def ago(self, now: float) -> str:
        """Format the age of the reading, for example `last seen 3.2 s ago`."""
        return f"last seen {now - self.at:.1f} s ago" if math.isfinite(self.at) else "never seen"


def seen_in(report: Idle | AttemptSeen, before: Sighting) -> Sighting:
    """Return the last readings after a report.

    A value that the report does not contain keeps its old reading.
    """
    if isinstance(report, Idle):
        return Sighting(report.theta, report.latched, report.at)
    theta = before.theta
    if isinstance(report.progress, PoseReading | RestReading | SwingReading):
        theta = report.progress.theta
    return Sighting(theta, report.latched, report.at)
