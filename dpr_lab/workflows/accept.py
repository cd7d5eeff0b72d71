"""Test of a rig against the limits in a file."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.workflows.diagnose import DiagnoseRequest, diagnose
from dpr_lab.workflows.events import OnEvent, ignore
from dpr_lab.workflows.reading import read_runs

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
    from dpr_lab.acceptance.free_run import free_run_errors
    from dpr_lab.acceptance.judge import judge
    from dpr_lab.acceptance.limits import load_limits
    from dpr_lab.planning.limits import PlanLimits
    from dpr_lab.planning.plan import plan
    from dpr_lab.rig import load_rig

    wanted = load_limits(limits)  # before the time-consuming part starts
    diagnosis, rig = diagnose(request, on_event).diagnosis, load_rig(request.rig)
    runs = read_runs(request.runs, rig, ignore, request.any_clock, request.torque)
    horizon = wanted.free_run.horizon_s if wanted.free_run else None
    errors = free_run_errors(runs, rig, diagnosis, horizon) if horizon else {}
    acceptance = judge(diagnosis, wanted, errors)
    if acceptance.answer != "not decidable":
        return AcceptResult(acceptance)
    open_ones = {limit.quantity for limit in acceptance.limits if limit.answer == "not decidable"}
    made = plan(rig, runs, diagnosis, limits=PlanLimits(effects=wanted.effects, ratios=wanted.ratios))
    decides = tuple(one.quantity for one in made.limits if one.decides and one.quantity in open_ones)
    texts = tuple(one.text for one in made.releases) if decides else ()
    return AcceptResult(replace(acceptance, recordings=texts, would_decide=decides))
