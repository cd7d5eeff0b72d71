"""Progress events of jobs: frozen objects that contain everything to be displayed."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from dpr_lab.progress import FitBegan, GenerationDone, ImportProgress, LocalFitBegan, ScoreTestBegan, StageBegan

if TYPE_CHECKING:
    from dpr_lab.acquisition.capture import Progress
    from dpr_lab.acquisition.swing import Captured
    from dpr_lab.identification.moving_arm.identify import AnyComparison
    from dpr_lab.rig_tables import Pose
    from dpr_lab.trials.campaign import Failure
    from dpr_lab.trials.score import TrialOutcome
    from firmware_protocol.identity import DeviceInfo


@dataclass(frozen=True, slots=True)
class JobBegan:
    """A job that is part of a longer job started."""

    number: int
    """Number of the part, from 1."""
    of: int
    sentence: str


@dataclass(frozen=True, slots=True)
class Warned:
    """A warning; the job continues."""

    sentence: str


@dataclass(frozen=True, slots=True)
class RunRead:
    """A run was read."""

    file: Path
    name: str
    notes: tuple[str, ...]
    """Notes of the file reader for the operator."""


@dataclass(frozen=True, slots=True)
class RunCompared:
    """A run was compared with the model."""

    comparison: "AnyComparison"


@dataclass(frozen=True, slots=True)
class RunLeftOut:
    """A run cannot be used and is skipped."""

    file: Path
    why: str


@dataclass(frozen=True, slots=True)
class DeviceGreeted:
    """A device completed its handshake."""

    url: str
    info: "DeviceInfo"


@dataclass(frozen=True, slots=True)
class CaptureBegan:
    """The operator should now move the rods to a pose."""

    name: str
    pose: "Pose"
    at_most_s: float
    """Maximum duration of the recording, s."""
    rods: int = 2
    """Number of mounted rods. A single rod has the angle theta1."""


@dataclass(frozen=True, slots=True)
class CaptureProgress:
    """Progress of a capture."""

    progress: "Progress"


@dataclass(frozen=True, slots=True)
class CaptureDone:
    """A release was recorded and checked."""

    name: str
    """Name of the pose."""
    captured: "Captured"


@dataclass(frozen=True, slots=True)
class TrialSealed:
    """A plant was drawn and its seal was published."""

    seal: str


@dataclass(frozen=True, slots=True)
class TrialDone:
    """Progress of a campaign, before its first trial and after each trial."""

    done: int
    of: int
    last: "TrialOutcome | Failure | None"
    """Result of the last trial; None before the first trial."""


@dataclass(frozen=True, slots=True)
class TrustTrialDone:
    """Progress of the blind trials of a diagnosis.

    The event is sent before the first and after each trial.
    """

    done: int
    of: int
    elapsed_s: float
    """Time since the start of the first trial, s."""

    @property
    def left_s(self) -> float:
        """Estimated time for the remaining trials, s.

        The value is nan before the first trial is finished.
        """
        return self.elapsed_s * (self.of - self.done) / self.done if self.done else math.nan


@dataclass(frozen=True, slots=True)
class PaperSearchDone:
    """A search of the published experiment ended."""

    done: int
    of: int


Event: TypeAlias = (
    JobBegan
    | Warned
    | StageBegan
    | FitBegan
    | ScoreTestBegan
    | GenerationDone
    | LocalFitBegan
    | ImportProgress
    | RunRead
    | RunCompared
    | RunLeftOut
    | DeviceGreeted
    | CaptureBegan
    | CaptureProgress
    | CaptureDone
    | TrialSealed
    | TrialDone
    | TrustTrialDone
    | PaperSearchDone
)

OnEvent: TypeAlias = Callable[[Event], None]

Proceed: TypeAlias = Callable[[], bool]
"""Function that a job calls where it can end early. If it returns False, the job ends with the best result so far."""


def ignore(event: Event) -> None:
    """Ignore an event."""


def always() -> bool:
    """Return True: the job does not end early."""
    return True
