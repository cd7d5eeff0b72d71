"""Test of a rig against the limits in a file."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.shown import counted
from dpr_lab.workflows.checks import check_folder_writable
from dpr_lab.workflows.diagnose import DiagnoseRequest, diagnose, save_report
from dpr_lab.workflows.events import OnEvent, ignore
from dpr_lab.workflows.reading import read_diagnosis, read_runs

if TYPE_CHECKING:
    from dpr_lab.acceptance.judge import Acceptance, JudgedLimit
    from dpr_lab.acceptance.limits import Limits
    from dpr_lab.gap.result.diagnosis import Diagnosis
    from dpr_lab.planning.limits import PlanLimits
    from dpr_lab.planning.result import Plan
    from dpr_lab.rig import Rig
    from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class AcceptResult:
    """Results of all limits, and the written files by name."""

    acceptance: "Acceptance"
    files: Mapping[str, str]

    def to_json(self) -> dict[str, Any]:
        """Return the output of `accept --json`."""
        return asdict(self.acceptance)


def accept(
    request: DiagnoseRequest, limits: Path, on_event: OnEvent = ignore, diagnosis_file: Path | None = None
) -> AcceptResult:
    """Test whether a rig meets the limits in a file.

    The job reports the events of a diagnosis. It writes `ACCEPTANCE` and the files of the diagnosis to the folder of
    the request. The report of the diagnosis then contains a section on the limits.

    Args:
        request: runs and rig
        limits: limits file
        on_event: called for each event
        diagnosis_file: diagnosis of these runs, as JSON file or folder; None: the runs are diagnosed first

    Raises:
        ConfigError: the rig, the limits file or the diagnosis is not valid, or the diagnosis was made with another rig
            file.
        RunError: a run cannot be used, or the diagnosis belongs to other runs.
        IdentificationError: zero, unit, sign or order of the readings is specified wrongly.
        DprError: a result cannot be written.
    """
    from dpr_lab.rig import load_rig

    rig = load_rig(request.rig)
    requirements = read_limits(limits, rig)  # check all inputs before the time-consuming part
    if request.out:
        check_folder_writable(request.out)
    runs = read_runs(request.runs, rig, ignore, request.any_clock, request.torque)
    if diagnosis_file is None:
        diagnosis = diagnose(replace(request, out=None), on_event).diagnosis
    else:
        diagnosis = read_diagnosis(diagnosis_file, runs, rig)
    acceptance = accept_runs(runs, rig, requirements, diagnosis)
    files = save_report(diagnosis, runs, rig, request.out, acceptance, on_event) if request.out else {}
    return AcceptResult(acceptance, files)


def accept_runs(
    runs: "Run | Sequence[Run]",
    rig: "Rig",
    limits: "PlanLimits | Path | str",
    diagnosis: "Diagnosis | None" = None,
) -> "Acceptance":
    """Test whether a rig meets limits, as `dpr-lab accept` does.

    Args:
        runs: the runs
        rig: the rig
        limits: path of a limits file, or the limits read from one
        diagnosis: diagnosis of these runs; None: the function diagnoses them

    Returns:
        pass, fail or not decidable for each limit, and the releases that would decide further limits

    Raises:
        ConfigError: the limits are not valid, or the diagnosis was made with another description of the rig.
        RunError: a run cannot be used, or belongs to another rig, or the diagnosis belongs to other runs.

    Source: docs/how-to/accept.md.
    """
    from dpr_lab.gap.diagnose import diagnose
    from dpr_lab.gap.result.subject import refuse_other_subject
    from dpr_lab.planning.plan import plan
    from dpr_lab.run import as_runs

    runs = as_runs(runs)
    requirements = read_limits(Path(limits), rig) if isinstance(limits, (Path, str)) else limits
    if diagnosis is None:
        diagnosis = diagnose(runs, rig)
    else:
        refuse_other_subject(diagnosis, runs, rig)
    acceptance = judged(diagnosis, requirements, runs, rig)
    if all(limit.answer != "not decidable" for limit in acceptance.limits):
        return acceptance
    of_plan = requirements.model_copy(update={"free_run": None})  # the test itself forecasts free runs
    return with_recordings(acceptance, plan(rig, runs, diagnosis, limits=of_plan))


def read_limits(file: Path, rig: "Rig") -> "PlanLimits":
    """Read a limits file with at least one limit for a rig.

    Raises:
        ConfigError: the file is not readable, contains no limit, or does not fit the rig.
    """
    from dpr_lab.acceptance.limits import load_limits
    from dpr_lab.planning.limits import PlanLimits, refuse_impossible_plan

    limits = load_limits(file, PlanLimits)
    refuse_impossible_plan(file, limits, rig)
    return limits


def judged(diagnosis: "Diagnosis", limits: "Limits", runs: "Sequence[Run]", rig: "Rig") -> "Acceptance":
    """Test every limit with a diagnosis of the given runs.

    Raises:
        RunError: a run belongs to another rig.
    """
    from dpr_lab.acceptance.free_run import free_run_errors
    from dpr_lab.acceptance.gain import with_gain
    from dpr_lab.acceptance.judge import judge
    from dpr_lab.estimation.usable_runs import refuse_other_rigs

    refuse_other_rigs(runs, rig)
    horizon = limits.free_run.horizon_s if limits.free_run else None
    errors = free_run_errors(runs, rig, diagnosis, horizon) if horizon else {}
    return judge(with_gain(diagnosis, runs, rig), limits, errors)


def with_recordings(acceptance: "Acceptance", planned: "Plan") -> "Acceptance":
    """Add remedies to the undecided limits, and the planned releases if they are expected to decide a limit.

    The reason of an undecided limit is extended by one of these statements:

    - the release that alone is expected to decide the limit
    - that the planned releases would probably not decide it; omitted if the interval covers all shapes of an effect,
      because the forecast refers to one shape
    - the bench check of the plan, if no release separates the possible causes

    `with_remedy` adds a remedy to the remaining limits. If a limit is undecided only because the scale is uncertain,
    only a release with an added mass can decide it, because this release determines the scale. No release decides a
    limit before the diagnosis has valid intervals.
    """
    forecasts = {forecast.quantity: forecast for forecast in planned.limits}
    determines_scale = any(release.added_mass is not None for release in planned.releases)
    decidable = ("interval", "scale") if determines_scale else ("interval",)
    hopeless = f"{counted(len(planned.releases), 'further release')} would probably not decide it"

    def advised(limit: "JudgedLimit") -> "JudgedLimit":
        forecast = forecasts.get(limit.quantity)
        if limit.obstacle not in ("interval", "scale"):
            return _with_bench_check(limit, planned)
        if limit.obstacle not in decidable or forecast is None:
            return limit
        cause, of_scale = limit.reason.removesuffix(f": {limit.remedy}"), limit.obstacle == "scale"
        if forecast.decides and forecast.release is not None:
            remedy = f"release {forecast.release} alone is expected to decide it"
            return _ending(limit, f"{limit.reason}; " if of_scale else f"{cause}: ", remedy)
        unchanged = forecast.decides or forecast.all_shapes or of_scale
        return limit if unchanged else _ending(limit, f"{cause}, and ", hopeless)

    limits = tuple(map(advised, acceptance.limits))
    decided = tuple(
        limit.quantity
        for before, limit in zip(acceptance.limits, limits, strict=True)
        if limit.quantity in forecasts and forecasts[limit.quantity].decides
        if limit.obstacle in decidable or (limit.obstacle in ("cause", "recordings") and limit.reason == before.reason)
    )
    texts = tuple(release.text for release in planned.releases) if decided else ()
    limits = tuple(with_remedy(limit, planned, limit.quantity in decided) for limit in limits)
    return replace(acceptance, limits=limits, recordings=texts, would_decide=decided)


def with_remedy(limit: "JudgedLimit", planned: "Plan", decided: bool) -> "JudgedLimit":
    """Add a remedy to an undecided limit without one: the planned releases, or a bench check.

    Args:
        limit: the limit
        planned: the planned releases
        decided: whether the releases are expected to decide the limit
    """
    from dpr_lab.effects import EFFECTS

    if limit.answer != "not decidable" or limit.remedy:
        return limit
    if limit.obstacle == "cause" and planned.releases:
        remedy = f"record {planned.releases[0].text}, which tests the causes, and diagnose again"
        return _ending(limit, f"{limit.reason}: ", remedy)
    if decided:
        return _ending(limit, f"{limit.reason}: ", "record the planned releases")
    checks = [EFFECTS[name].bench_check for name in _effects(limit) if name in EFFECTS]
    check = (*checks, "Measure the quantity directly")[0]
    return _ending(limit, f"{limit.reason}. ", f"No planned release decides it. {check}".removesuffix("."))


def _with_bench_check(limit: "JudgedLimit", planned: "Plan") -> "JudgedLimit":
    """Add the bench check of the causes that the limit or its reason names, if no release separates them."""
    checks = [pair for pair in planned.inseparable if set(_effects(limit)).intersection(pair.causes)]
    if not checks or limit.remedy or limit.answer != "not decidable":
        return limit
    return _ending(limit, f"{limit.reason}. ", checks[0].advice.removesuffix("."))


def _ending(limit: "JudgedLimit", beginning: str, remedy: str) -> "JudgedLimit":
    return replace(limit, reason=f"{beginning}{remedy}", remedy=remedy)


def _effects(limit: "JudgedLimit") -> tuple[str, ...]:
    """Return the effect in the quantity of a limit, followed by the effects in its reason."""
    return (limit.quantity.partition(".")[0], *limit.effects)
