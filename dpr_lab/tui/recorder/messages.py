"""Messages between the screen and the process that records."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from dpr_lab.acquisition.capture import Captured, CaptureOptions, Progress
from dpr_lab.transports.software_link import leads_to_software
from firmware_protocol.clock import ClockFit
from firmware_protocol.identity import DeviceInfo


@dataclass(frozen=True, slots=True)
class Exercise:
    """Test the link by a short stream; closes the latch."""

    rate_hz: int
    seconds: float = 2.0


@dataclass(frozen=True, slots=True)
class CaptureAttempt:
    """Guide the rods to a pose and, on a go-ahead for this very attempt, let them go."""

    attempt: int
    pose: str
    options: CaptureOptions


@dataclass(frozen=True, slots=True)
class GoAhead:
    """The operator's order to release; an old one, or one for another attempt or pose, counts for nothing."""

    attempt: int
    pose: str
    given_at: float
    """`time.monotonic()`, s; the clock is the computer's, the same in every process."""


@dataclass(frozen=True, slots=True)
class CancelAttempt:
    """End an attempt and keep the samples recorded so far."""

    attempt: int


RecorderOrder: TypeAlias = Exercise | CaptureAttempt | GoAhead | CancelAttempt


@dataclass(frozen=True, slots=True)
class Connected:
    """The device answered the handshake."""

    url: str
    info: DeviceInfo
    rate_hz: int
    loads: tuple[str, ...]
    """What the rate takes of the link, a sentence for each limit."""
    problem: str
    """Why the rate or the rig does not fit this device; empty when they do."""

    @property
    def simulated(self) -> bool:
        """Whether there are no rods."""
        return self.url.startswith("sim:") or (self.info.simulated_time and leads_to_software(self.url))


@dataclass(frozen=True, slots=True)
class Idle:
    """Position of the rods without an attempt."""

    theta: tuple[float, float, float]
    """Absolute angles, rad."""
    latched: bool
    at: float
    """When the device was heard, `time.monotonic()`, s; the clock is the computer's, the same in every process."""


@dataclass(frozen=True, slots=True)
class Exercised:
    """Result of the link test."""

    samples: int
    lost: Mapping[str, int]
    clock: ClockFit | None
    """None for a device whose time is simulated."""


@dataclass(frozen=True, slots=True)
class AttemptSeen:
    """Progress of an attempt."""

    attempt: int
    progress: Progress
    latched: bool | None
    """None before the first report of the device."""
    at: float
    """When the device was heard, `time.monotonic()`, s."""
    lost: Mapping[str, int] = field(default_factory=dict)
    """Since this attempt began, by cause."""


@dataclass(frozen=True, slots=True)
class GoAheadAsked:
    """The rods are at the pose and at rest; the attempt waits for a go-ahead."""

    attempt: int


@dataclass(frozen=True, slots=True)
class AttemptFinished:
    """An attempt ended with a judged recording."""

    attempt: int
    captured: Captured
    clock: ClockFit | None


@dataclass(frozen=True, slots=True)
class RecorderFailed:
    """Something did not work."""

    attempt: int | None
    """None when no attempt was under way."""
    message: str
    """What happened and what to do."""
    alive: bool
    """Whether the device is still connected."""


RecorderReport: TypeAlias = Connected | Idle | Exercised | AttemptSeen | GoAheadAsked | AttemptFinished | RecorderFailed
