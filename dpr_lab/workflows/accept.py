"""Test of a rig against the limits in a file."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.workflows.diagnose import DiagnoseRequest, diagnose
from dpr_lab.workflows.events import OnEvent, ignore

if TYPE_CHECKING:
    from dpr_lab.acceptance.judge import Acceptance


@dataclass(frozen=True, slots=True)
class AcceptResult:
    """Results of all limits."""

    acceptance: "Acceptance"

    def to_json(self) -> dict[str, Any]:
        """Output of `accept --json`."""
        return asdict(self.acceptance)


def accept(request: DiagnoseRequest, limits: Path, on_event: OnEvent = ignore) -> AcceptResult:
    """Test whether a rig meets the limits in a file.

    Events: those of a diagnosis.

    Raises:
        ConfigError: the rig or the limits file is not valid.
        RunError: a run cannot be used.
        IdentificationError: zero, unit, sign or order of the readings is specified wrongly.
    """
    from dpr_lab.acceptance.judge import judge
    from dpr_lab.acceptance.limits import load_limits

    wanted = load_limits(limits)  # before the time-consuming part starts
    return AcceptResult(judge(diagnose(request, on_event).diagnosis, wanted))
