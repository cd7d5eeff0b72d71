"""Plan the next recordings of a rig, given the runs recorded so far."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.errors import ConfigError
from dpr_lab.workflows.checks import check_folder_writable
from dpr_lab.workflows.diagnose import DiagnoseRequest, diagnose
from dpr_lab.workflows.events import OnEvent, ignore
from dpr_lab.workflows.reading import read_diagnosis, read_runs

if TYPE_CHECKING:
    from dpr_lab.planning.result import Plan
    from dpr_lab.rig import Rig

RECORD = "plan.json"
"""Name of the file with the output of `plan --json`, in the folder of a plan."""

RIG_FILE = "rig.toml"
"""Name of the rig file with the start poses of a plan, for `capture --pose`. Releases with other rods, another mass or
another mode of the arm have rig files of their own, such as `rig_P2.toml`."""

UNITS = {"s": 1 / 60, "min": 1.0, "h": 60.0}
"""Duration of each unit of a budget, minutes."""


@dataclass(frozen=True, slots=True)
class PlanRequest:
    """Options of a plan."""

    rig: str
    """Rig file, or the name of a built-in one."""
    runs: tuple[Path, ...] = ()
    """Runs recorded so far; empty: a first plan is made from the rig file alone."""
    diagnosis: Path | None = None
    """Diagnosis of these runs; None: the runs are diagnosed first."""
    limits: Path | None = None
    """Limits file."""
    budget: str | None = None
    """Time at the rig, for example `10min`; None: up to three releases."""
    seed: int = 0
    """Seed of the search; the same seed gives the same plan."""
    out: Path | None = None
    """Folder of `RECORD`, rig files and input signals; None: no files are written."""
    any_clock: bool = False
    """Whether to accept runs of a device whose clock rate error is larger than that of a crystal."""
    torque: str | None = None
    """`measured` or `commanded`: torques to use for runs that contain both; None: measured."""


@dataclass(frozen=True, slots=True)
class PlanResult:
    """The plan, and the written files by name."""

    plan: "Plan"
    files: dict[str, str]

    def to_json(self) -> dict[str, Any]:
        """Return the output of `plan --json`."""
        return self.plan.to_json() | ({"files": self.files} if self.files else {})


def plan(request: PlanRequest, on_event: OnEvent = ignore) -> PlanResult:
    """Plan the next recordings of a rig.

    If runs are given without a diagnosis, the events are those of a diagnosis.

    Raises:
        ConfigError: the rig, the limits or the budget is not valid, or does not permit a recording; or a diagnosis is
            given without its runs, or was made with another rig file.
        RunError: a run or the diagnosis cannot be used; the diagnosis belongs to other runs.
        IdentificationError: zero, unit, sign or order of the readings is specified wrongly.
        DprError: a result cannot be written.
    """
    from dpr_lab.planning.limits import PlanLimits, load_plan_limits
    from dpr_lab.planning.plan import plan as plan_runs
    from dpr_lab.rig import load_rig

    rig = load_rig(request.rig)
    limits = load_plan_limits(request.limits, rig) if request.limits else PlanLimits()
    budget = minutes(request.budget) if request.budget else None
    if request.out:
        check_folder_writable(request.out)
    if request.diagnosis and not request.runs:
        raise ConfigError(f"{request.diagnosis}: a plan after a diagnosis needs its runs: add the run files")
    diagnosis, runs = None, []
    if request.runs:
        if request.diagnosis:
            runs = read_runs(request.runs, rig, on_event, request.any_clock, request.torque)
            diagnosis = read_diagnosis(request.diagnosis, runs, rig)
        else:
            diagnosis_request = DiagnoseRequest(
                request.runs, request.rig, any_clock=request.any_clock, torque=request.torque
            )
            diagnosis = diagnose(diagnosis_request, on_event).diagnosis
            runs = read_runs(request.runs, rig, ignore, request.any_clock, request.torque)
    planned = plan_runs(rig, runs, diagnosis, limits=limits, budget_min=budget, seed=request.seed)
    return write_plan(planned, rig, request.out)


def minutes(text: str) -> float:
    """Convert a time such as `10min`, `90 s`, `1h` or `10` to minutes.

    Raises:
        ConfigError: the text is not such a time.
    """
    parts = re.fullmatch(r"\s*(\d+(?:\.\d*)?)\s*(s|min|h)?\s*", text)
    value = float(parts[1]) * UNITS[parts[2] or "min"] if parts else 0.0
    if not 0 < value <= 1e5:
        raise ConfigError(f"{text!r} is not a time: give one such as 10min, 90s or 1h (units: s, min, h)")
    return value


def write_plan(made: "Plan", rig: "Rig", out: Path | None) -> PlanResult:
    """Write a plan, its input signals, and rig files with its start poses; None as `out`: write no files."""
    from dpr_lab.planning.signals import write_signal
    from dpr_lab.report.plain import write_json
    from dpr_lab.workflows.planned_rigs import planned_poses, planned_rigs

    if out is None:
        return PlanResult(made, {})
    files, releases = {"plan": str(out / RECORD)}, []
    out.mkdir(parents=True, exist_ok=True)
    poses = planned_poses(made, rig)
    rigs: dict[str, Path] = {}
    if poses:
        rigs, files["rig"] = planned_rigs(poses, rig, out / RIG_FILE), str(out / RIG_FILE)
    for pose, release in poses.items():
        release = release.model_copy(update={"pose": pose, "rig": str(rigs[pose])})
        files.setdefault("rig" if rigs[pose].name == RIG_FILE else rigs[pose].stem, str(rigs[pose]))
        if release.torques is not None:
            file = out / f"input_{release.number}.csv"
            write_signal(release.torques, file, rig)
            files[file.stem] = str(file)
            release = release.model_copy(update={"input": str(file)})
        releases.append(release)
    result = PlanResult(made.model_copy(update={"releases": releases}), files)
    write_json(result.to_json(), out / RECORD)
    return result
