"""Runs and a limits file in, the judged limits out."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.workflows.diagnose import DiagnoseRequest, diagnose
from dpr_lab.workflows.events import OnEvent, ignore

if TYPE_CHECKING:
    from dpr_lab.acceptance.judge import Acceptance


@dataclass(frozen=True, slots=True)
class AcceptResult:
    """The judged limits."""

    acceptance: "Acceptance"

    def to_json(self) -> dict[str, Any]:
        """Output of `accept --json`."""
        return asdict(self.acceptance)


def accept(request: DiagnoseRequest, limits: Path, on_event: OnEvent = ignore) -> AcceptResult:
    """Test whether a rig keeps the limits of a file.

    Events: those of a diagnosis.

    Raises:
        ConfigError: the rig or the limits file is not valid.
        RunError: a run cannot be used.
        IdentificationError: the recordings are read with another zero, unit, sign or order than they were written with.
    """
    from dpr_lab.acceptance.judge import judge
    from dpr_lab.acceptance.limits import load_limits

    wanted = load_limits(limits)  # before the work begins
    return AcceptResult(judge(diagnose(request, on_event).diagnosis, wanted))
