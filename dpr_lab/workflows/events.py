"""Progress events of jobs: frozen values that contain everything the callers display."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from dpr_lab.progress import FitBegan, GenerationDone, ImportProgress, LocalFitBegan, ScoreTestBegan, StageBegan

if TYPE_CHECKING:
    from dpr_lab.acquisition.capture import Progress
    from dpr_lab.acquisition.swing import Captured
    from dpr_lab.identification.compare import Comparison
    from dpr_lab.identification.moving_arm.identify import ArmComparison
    from dpr_lab.rig_tables import Pose
    from dpr_lab.trials.campaign import Failure
    from dpr_lab.trials.score import TrialOutcome
    from firmware_protocol.identity import DeviceInfo


@dataclass(frozen=True, slots=True)
class JobBegan:
    """Start of one of the jobs of a longer one."""

    number: int
    """Number of the job, from 1."""
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

    comparison: "Comparison"


@dataclass(frozen=True, slots=True)
class ArmRunCompared:
    """A run was compared with the model of a rig whose arm moves."""

    comparison: "ArmComparison"


@dataclass(frozen=True, slots=True)
class RunLeftOut:
    """A run that cannot be used and is skipped."""

    file: Path
    why: str


@dataclass(frozen=True, slots=True)
class DeviceGreeted:
    """Handshake with a device completed."""

    url: str
    info: "DeviceInfo"


@dataclass(frozen=True, slots=True)
class CaptureBegan:
    """The operator should move the rods to a pose."""

    name: str
    pose: "Pose"
    at_most_s: float
    """Maximum duration of the recording, s."""
    rods: int = 2
    """Number of mounted rods; a single one is theta1."""


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
    """A plant was drawn and its seal published."""

    seal: str


@dataclass(frozen=True, slots=True)
class TrialDone:
    """Progress of a campaign: sent before its first trial and after each."""

    done: int
    of: int
    last: "TrialOutcome | Failure | None"
    """Result of the last trial; None before the first."""


@dataclass(frozen=True, slots=True)
class TrustTrialDone:
    """Progress of the blind trials of a diagnosis on its own rig: sent before the first and after each."""

    done: int
    of: int
    elapsed_s: float
    """Time since the start of the first trial, s."""

    @property
    def left_s(self) -> float:
        """Estimated time for the remaining trials, s; nan before the first is finished."""
        return self.elapsed_s * (self.of - self.done) / self.done if self.done else math.nan


@dataclass(frozen=True, slots=True)
class PaperSearchDone:
    """End of one of the searches of the published experiment."""

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
    | ArmRunCompared
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
"""Function that is called whenever a job can pause or end early. It may wait; if it returns false, the job ends with
the best result so far."""


def ignore(event: Event) -> None:
    """Ignore an event."""


def always() -> bool:
    """Continue: neither pause nor stop."""
    return True
