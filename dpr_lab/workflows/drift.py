"""Runs of several days in, what moved between them out."""

from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from dpr_lab.errors import RunError
from dpr_lab.workflows.checks import refuse_file
from dpr_lab.workflows.events import OnEvent, StageBegan, ignore
from dpr_lab.workflows.reading import read_runs

if TYPE_CHECKING:
    from collections.abc import Mapping

    from dpr_lab.drift.changes import Drift
    from dpr_lab.drift.estimates import Estimates
    from dpr_lab.drift.groups import Occasion

STAGES = ("each run alone", "what moved")


@dataclass(frozen=True, slots=True)
class DriftRequest:
    """What to compare."""

    runs: tuple[Path, ...]
    rig: str
    """Rig file, or the name of a built-in one."""
    by: Literal["day", "session", "label"] = "day"
    """A name of `dpr_lab.drift.groups.KEYS`."""
    diagnosis: Path | None = None
    """What `diagnose --json` printed: the sizes of its effects are watched too."""
    model: Path | None = None
    """An identified model to start from; the rig file's values by default."""
    out: Path | None = None
    """Folder of the report; None: none is written."""
    any_clock: bool = False
    torque: str | None = None
    """`measured` or `commanded`: which known torques drove the joints of runs that hold both; None: the measured."""


@dataclass(frozen=True, slots=True)
class DriftResult:
    """What moved, and what each run says."""

    drift: "Drift"
    estimates: "Estimates"
    """In the order of time."""
    group: tuple[int, ...]
    """Of each run in that order."""
    files: dict[str, str]
    torques: tuple[str, ...] = ()
    """Kinds of the known torques that drove the runs."""

    def to_json(self) -> dict[str, Any]:
        """What `drift --json` prints."""
        runs = zip(self.estimates.runs, self.group, self.estimates.values.tolist(), strict=True)
        return {
            "drifted": bool(self.drift.moved),
            **asdict(self.drift),
            "runs": [
                {"name": name, "group": self.drift.groups[g], **dict(zip(self.estimates.names, values, strict=True))}
                for name, g, values in runs
            ],
            "torques": list(self.torques),
            "files": self.files,
        }


def watch_drift(request: DriftRequest, on_event: OnEvent = ignore) -> DriftResult:
    """Say which parameters of a rig moved between groups of runs.

    Tells `RunRead`, `StageBegan`.

    Raises:
        ConfigError: the rig is not valid, or a file stands where the folder is to be.
        RunError: a run, the model or the diagnosis cannot be used, or all runs are of one group.
        DprError: the report cannot be written.
    """
    from dpr_lab.drift.changes import changes
    from dpr_lab.drift.estimates import estimate_each
    from dpr_lab.drift.groups import grouped
    from dpr_lab.identification.model import load_model
    from dpr_lab.report.drift import save_drift
    from dpr_lab.rig import load_rig
    from dpr_lab.run import torque_kinds

    if request.out:
        refuse_file(request.out)
    rig = load_rig(request.rig)
    effects = _effects(request.diagnosis) if request.diagnosis else None
    start = load_model(request.model).starting_point(rig) if request.model else None
    runs = read_runs(request.runs, rig, on_event, request.any_clock, request.torque)
    groups = grouped([_recorded(file) for file in request.runs], request.by)
    on_event(StageBegan(1, len(STAGES), STAGES[0]))
    found = estimate_each([runs[i] for i in groups.order], rig, effects, start)
    on_event(StageBegan(2, len(STAGES), STAGES[1]))
    drift = changes(found, groups.group, groups.names)
    kinds = torque_kinds(runs)
    files = save_drift(drift, found, groups.group, rig.name, request.out, kinds) if request.out else {}
    return DriftResult(drift, found, groups.group, files, kinds)


def _recorded(file: Path) -> "Occasion":
    from dpr_lab.drift.groups import Occasion
    from dpr_lab.storage.inspect import info

    said = info(file)
    try:
        at = datetime.fromisoformat(said.created_utc)
    except ValueError as error:
        raise RunError(f"{file}: does not say when it was recorded: {said.created_utc!r}") from error
    return Occasion(said.file, at if at.tzinfo else at.replace(tzinfo=UTC), said.note or file.resolve().parent.name)


def _effects(file: Path) -> "Mapping[str, Mapping[str, float]]":
    """The effects of a diagnosis that are there all the time."""
    from dpr_lab.effects import EFFECTS
    from dpr_lab.gap.result.diagnosis import load_diagnosis

    found = load_diagnosis(file).model_effects
    return {name: values for name, values in found.items() if not EFFECTS[name].event}
