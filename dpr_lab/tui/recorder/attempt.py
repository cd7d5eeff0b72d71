"""State of one attempt to record from a pose, updated by recorder reports."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from dpr_lab.acquisition.holding import PoseReading, RestReading
from dpr_lab.acquisition.rest import RodPair
from dpr_lab.acquisition.swing import Captured, Released, SwingReading
from dpr_lab.arrays import Array
from dpr_lab.rig_tables import Pose
from dpr_lab.tui.recorder.messages import AttemptFinished, AttemptSeen, GoAheadAsked


class Phase(Enum):
    """Phase of an attempt.

    The value is the next action for the operator.
    """

    PLACING = "bring every rod to the pose and hold it there"
    SETTLING = "at the pose: let the rods come to rest"
    READY = "at the pose and at rest"
    RECORDING = "released, recording"
    JUDGED = "recorded"


@dataclass(slots=True)
class Attempt:
    """State of an attempt to record from a pose."""

    number: int
    name: str
    """Name of the pose."""
    pose: Pose
    phase: Phase = Phase.PLACING
    error: RodPair | None = None
    """Measured minus required angles of both rods, rad."""
    rest: RestReading | None = None
    lost: Mapping[str, int] = field(default_factory=dict)
    recorded: SwingReading | None = None
    captured: Captured | None = None
    _asked: bool = False
    _t: list[Array] = field(default_factory=list)
    _theta: list[Array] = field(default_factory=list)
    _inputs: list[Array] = field(default_factory=list)

    @property
    def trace(self) -> tuple[Array, Array]:
        """Times since the release (n,), s, and absolute angles (n, 3), rad, for display."""
        if not self._t:
            return np.empty(0), np.empty((0, 3))
        return np.concatenate(self._t), np.concatenate(self._theta)

    @property
    def inputs(self) -> Array:
        """Input (n,) of the arm's drive at the samples of `trace`.

        Its unit is that of the rig file. The array is empty if the arm has no drive.
        """
        inputs = np.concatenate(self._inputs) if self._inputs else np.empty(0)
        return inputs if len(inputs) == len(self.trace[0]) else np.empty(0)

    @property
    def obstacle(self) -> str:
        """Reason why the rods must not be released now; empty if they may be released."""
        if self.phase is Phase.READY:
            return ""
        if self.phase is Phase.SETTLING and self.rest is not None and self.rest.restless:
            return self.rest.restless
        return self.phase.value

    def hear(self, report: AttemptSeen | GoAheadAsked | AttemptFinished) -> None:
        """Update the attempt with a report of the recorder."""
        match report:
            case GoAheadAsked():
                self._asked = True
            case AttemptFinished(captured=captured):
                self.captured, self.phase = captured, Phase.JUDGED
                self.lost = captured.lost
            case AttemptSeen(progress=progress):
                self.lost = report.lost
                self._take(progress)
        if self.rest is not None and self.phase in (Phase.PLACING, Phase.SETTLING, Phase.READY):
            self.phase = Phase.READY if self._asked and not self.rest.restless else Phase.SETTLING

    def _take(self, progress: object) -> None:
        match progress:
            case PoseReading():
                self.error = progress.error
            case RestReading():
                self.error, self.rest = progress.error, progress
            case Released():
                self.phase, self.error = Phase.RECORDING, None
            case SwingReading():
                self.phase, self.error = Phase.RECORDING, None  # the report of the release may have been lost
                self.recorded = progress
                t, theta = progress.fresh
                self._t.append(t)
                self._theta.append(theta)
                if progress.inputs is not None:
                    self._inputs.append(progress.inputs)
            case _:
                pass
