"""Messages between the screen and the recorder process."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from dpr_lab.acquisition.capture import CaptureOptions, Progress
from dpr_lab.acquisition.rest import RodAngles
from dpr_lab.acquisition.swing import Captured
from dpr_lab.transports.software_link import leads_to_software
from firmware_protocol.clock import ClockFit
from firmware_protocol.identity import DeviceInfo


@dataclass(frozen=True, slots=True)
class Exercise:
    """Command: test the link with a short stream; closes the latch."""

    rate_hz: int
    seconds: float = 2.0


@dataclass(frozen=True, slots=True)
class CaptureAttempt:
    """Command: guide the rods to a pose, and record after a release command.

    The release command names this attempt.
    """

    attempt: int
    pose: str
    options: CaptureOptions


@dataclass(frozen=True, slots=True)
class GoAhead:
    """Command: release the rods.

    The command is ignored if it is old, or if it belongs to another attempt or pose.
    """

    attempt: int
    pose: str
    given_at: float
    """Time of the command, `time.monotonic()`, s; this clock is common to all processes of the computer."""


@dataclass(frozen=True, slots=True)
class CancelAttempt:
    """Command: end an attempt and keep the samples recorded so far."""

    attempt: int


RecorderOrder: TypeAlias = Exercise | CaptureAttempt | GoAhead | CancelAttempt


@dataclass(frozen=True, slots=True)
class Connected:
    """Report: the device answered the handshake."""

    url: str
    info: DeviceInfo
    rate_hz: int
    loads: tuple[str, ...]
    """Sentences on the load of the link at this rate, one for each limit."""
    problem: str
    """Reason why the rate or the rig does not match this device; empty if they match."""
    rods: int = 2
    """Number of mounted rods."""

    @property
    def simulated(self) -> bool:
        """Whether the device is simulated, without real rods."""
        return self.url.startswith("sim:") or (self.info.simulated_time and leads_to_software(self.url))


@dataclass(frozen=True, slots=True)
class Idle:
    """Report: angles of the rods outside an attempt."""

    theta: RodAngles
    """Absolute angles, rad."""
    latched: bool
    at: float
    """Time of the last message of the device, `time.monotonic()`, s; this clock is common to all processes of the
    computer."""


@dataclass(frozen=True, slots=True)
class Exercised:
    """Report: result of the link test."""

    samples: int
    lost: Mapping[str, int]
    clock: ClockFit | None
    """Clock fit; None for a device with simulated time."""


@dataclass(frozen=True, slots=True)
class AttemptSeen:
    """Report: progress of an attempt."""

    attempt: int
    progress: Progress
    latched: bool | None
    """State of the latch; None before the first report of the device."""
    at: float
    """Time of the last message of the device, `time.monotonic()`, s."""
    lost: Mapping[str, int] = field(default_factory=dict)
    """Losses since the start of this attempt, by cause."""


@dataclass(frozen=True, slots=True)
class GoAheadAsked:
    """Report: the rods rest at the pose, and the attempt waits for release."""

    attempt: int


@dataclass(frozen=True, slots=True)
class AttemptFinished:
    """Report: an attempt ended with a checked recording."""

    attempt: int
    captured: Captured
    clock: ClockFit | None


@dataclass(frozen=True, slots=True)
class RecorderFailed:
    """Report: an error."""

    attempt: int | None
    """Number of the attempt; None if there is no attempt."""
    message: str
    """What happened and what to do."""
    alive: bool
    """Whether the device is still connected after the error."""
    unwritten: bool = False
    """Whether the recording could not be written, for example on a full disk: the operator must act."""


RecorderReport: TypeAlias = Connected | Idle | Exercised | AttemptSeen | GoAheadAsked | AttemptFinished | RecorderFailed
