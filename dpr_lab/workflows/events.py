"""What a job tells while it works: everything that a shell shows of it, as frozen values."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from dpr_lab.progress import FitBegan, GenerationDone, ImportProgress, LocalFitBegan, ScoreTestBegan, StageBegan

if TYPE_CHECKING:
    from dpr_lab.acquisition.capture import Captured, Progress
    from dpr_lab.identification.compare import Comparison
    from dpr_lab.rig_tables import Pose
    from dpr_lab.trials.campaign import Failure
    from dpr_lab.trials.score import TrialOutcome
    from firmware_protocol.identity import DeviceInfo

__all__ = [
    "CaptureBegan",
    "CaptureDone",
    "CaptureProgress",
    "DeviceGreeted",
    "Event",
    "FitBegan",
    "GenerationDone",
    "ImportProgress",
    "JobBegan",
    "LocalFitBegan",
    "OnEvent",
    "PaperSearchDone",
    "Proceed",
    "RunCompared",
    "RunLeftOut",
    "RunRead",
    "ScoreTestBegan",
    "StageBegan",
    "TrialDone",
    "TrialSealed",
    "TrustTrialDone",
    "Warned",
    "always",
    "ignore",
]


@dataclass(frozen=True, slots=True)
class JobBegan:
    """One of the jobs that a longer one is made of began."""

    number: int
    """From 1."""
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
    """What its reader wants the operator to know."""


@dataclass(frozen=True, slots=True)
class RunCompared:
    """A run was held against the model."""

    comparison: "Comparison"


@dataclass(frozen=True, slots=True)
class RunLeftOut:
    """A run that cannot be used; the job continues without it."""

    file: Path
    why: str


@dataclass(frozen=True, slots=True)
class DeviceGreeted:
    """A device answered."""

    url: str
    info: "DeviceInfo"


@dataclass(frozen=True, slots=True)
class CaptureBegan:
    """The operator is to bring the rods to a pose."""

    name: str
    pose: "Pose"
    at_most_s: float
    """How long the recording can become."""


@dataclass(frozen=True, slots=True)
class CaptureProgress:
    """Progress of a capture."""

    progress: "Progress"


@dataclass(frozen=True, slots=True)
class CaptureDone:
    """A release was recorded and judged."""

    name: str
    """Of the pose."""
    captured: "Captured"


@dataclass(frozen=True, slots=True)
class TrialSealed:
    """A plant was drawn, and its seal given away."""

    seal: str


@dataclass(frozen=True, slots=True)
class TrialDone:
    """Progress of a campaign: sent before its first trial and after each."""

    done: int
    of: int
    last: "TrialOutcome | Failure | None"
    """What the last trial came to; None at the start."""


@dataclass(frozen=True, slots=True)
class TrustTrialDone:
    """Progress of the blind trials of a diagnosis on its own rig: sent before the first and after each."""

    done: int
    of: int
    elapsed_s: float
    """Since the first began, s."""

    @property
    def left_s(self) -> float:
        """Estimated time for the remaining trials, s; nan before the first is done."""
        return self.elapsed_s * (self.of - self.done) / self.done if self.done else math.nan


@dataclass(frozen=True, slots=True)
class PaperSearchDone:
    """One of the searches of the published experiment ended."""

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
"""Asked where a job can pause or end early: may wait; false ends it there, with the best so far."""


def ignore(event: Event) -> None:
    """Nobody is interested."""


def always() -> bool:
    """Default job control: neither pause nor stop."""
    return True
