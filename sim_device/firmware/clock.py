"""Device time, as counted by the device's crystal, in real time or faster."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from firmware_protocol.messages import State

CLOCKS: dict[str, Mapping[State, float]] = {
    "realtime": {},
    "fast": {State.IDLE: 20.0, State.HOLDING: 20.0, State.STREAMING: 20.0, State.RELEASED: 60.0},
}
"""Device seconds per wall second in each state, by the name of the clock; 1 for a state that is not listed.

Before a release the ratio is smaller: the host determines the duration of these states, and receives messages all the
time.
"""

LONGEST_STEP = 0.01
"""Maximum wall time by which the fast clock advances at once, s. The rest of a longer stall is skipped."""


PATIENCE = 6.0
"""Factor by which the fast clock extends the lease, because the host has more work per wall second."""


@dataclass(slots=True)
class Clock:
    """Device time since power-up, s.

    Wall times are arguments; the clock does not read the time.
    """

    pace: Mapping[State, float] = field(default_factory=dict)
    """Device seconds per wall second in each state: a value of `CLOCKS`."""
    drift_ppm: float = 0.0
    """Error of the crystal, ppm: device time = true time * (1 + drift_ppm 1e-6)."""
    most_ticks_hz: float = math.inf
    """Maximum number of ticks per wall second of a fast clock."""
    now: float = 0.0
    _wall: float | None = None

    @property
    def simulated(self) -> bool:
        """Whether device time differs from wall time."""
        return bool(self.pace)

    @property
    def rate(self) -> float:
        """Device seconds per true second."""
        return 1.0 + self.drift_ppm * 1e-6

    def watch(self, wall: float) -> float:
        """Convert the wall time `wall`, s, to the time by which the lease of the host is measured."""
        return wall / PATIENCE if self.simulated else wall

    def advance(self, wall: float, state: State, rate_hz: float, blocked: bool = False) -> float:
        """Return the device time at the wall time `wall`, s, for a device with `rate_hz` ticks per second.

        A fast clock stops while the link is `blocked`; a real clock continues.
        """
        passed = 0.0 if self._wall is None else wall - self._wall
        self._wall = wall
        if self.simulated:
            passed = 0.0 if blocked else min(passed, LONGEST_STEP)
        pace = self.pace.get(state, 1.0)
        self.now += passed * self.rate * min(pace, max(1.0, self.most_ticks_hz / rate_hz))
        return self.now
