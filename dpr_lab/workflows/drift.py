"""Drift analysis: changes of parameters between groups of runs."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from dpr_lab.errors import RunError
from dpr_lab.workflows.checks import check_folder_writable
from dpr_lab.workflows.events import OnEvent, StageBegan, ignore
from dpr_lab.workflows.reading import read_runs

if TYPE_CHECKING:
    from collections.abc import Mapping

    from dpr_lab.drift.changes import Drift
    from dpr_lab.drift.estimates import Estimates
    from dpr_lab.drift.groups import Occasion

STAGES = ("each run alone", "changes")


@dataclass(frozen=True, slots=True)
class DriftResult:
    """Changed parameters, and the estimates of each run."""

    drift: "Drift"
    estimates: "Estimates"
    """Estimates of the runs in chronological order."""
    group: tuple[int, ...]
    """Index of the group of each run, in the order of the estimates."""
    files: dict[str, str]
    torques: tuple[str, ...] = ()
    """Kinds of the known torques that drove the runs."""

    def to_json(self) -> dict[str, Any]:
        """Return the output of `drift --json`."""
        from dpr_lab.report.drift import sentence

        runs = zip(self.estimates.runs, self.group, self.estimates.values.tolist(), strict=True)
        return {
            "drifted": bool(self.drift.moved),
            "sentence": sentence(self.drift),
            "assumed_b": self.estimates.b,
            **asdict(self.drift),
            "runs": [{"name": name, "group": self.drift.groups[g], **self._sizes(values)} for name, g, values in runs],
            "torques": list(self.torques),
            "files": self.files,
        }

    def _sizes(self, values: Sequence[float]) -> dict[str, float]:
        """Map the names of parameters to their values.

        The size of an effect may be relative to the reference inertia (`NAME/b`, `NAME*b`). The absolute value for the
        assumed inertia is then added.
        """
        by_name = dict(zip(self.estimates.names, values, strict=True))
        b, inertia = self.estimates.b or 1.0, self.estimates.inertia
        by_name |= {
            name.removesuffix(f"/{inertia}"): value * b
            for name, value in by_name.items()
            if "." in name and name.endswith(f"/{inertia}")
        }
        over = f"*{inertia}"
        return by_name | {name.removesuffix(over): value / b for name, value in by_name.items() if name.endswith(over)}


def watch_drift(
    files: Sequence[Path],
    rig_name: str,
    by: Literal["day", "session", "label"] = "day",
    *,
    diagnosis: Path | None = None,
    model: Path | None = None,
    out: Path | None = None,
    any_clock: bool = False,
    torque: str | None = None,
    on_event: OnEvent = ignore,
) -> DriftResult:
    """Find parameters of a rig that changed between groups of runs.

    Args:
        files: run files
        rig_name: rig file, or the name of a built-in one
        by: criterion of the groups, a key of `dpr_lab.drift.groups.KEYS`
        diagnosis: JSON file or folder. The sizes of its effects are also compared. None: only parameters are compared.
        model: identified model that provides initial values; None: values of the rig file
        out: folder of the report; None: no files are written
        any_clock: see `read_runs`
        torque: `measured` or `commanded`: torques to use for runs that contain both; None: measured
        on_event: receives `RunRead` and `StageBegan`

    Raises:
        ConfigError: the rig is not valid, or a file with the name of the folder exists.
        RunError: a run, the model or the diagnosis cannot be used, or all runs belong to one group.
        DprError: the report cannot be written.
    """
    from dpr_lab.drift.changes import changes
    from dpr_lab.drift.estimates import estimate_each, estimate_each_arm
    from dpr_lab.drift.groups import grouped
    from dpr_lab.identification.model import load_model
    from dpr_lab.report.drift import save_drift
    from dpr_lab.rig import load_rig
    from dpr_lab.run import torque_kinds

    if out:
        check_folder_writable(out)
    rig = load_rig(rig_name)
    effects = _effects(diagnosis) if diagnosis else None
    runs = read_runs(files, rig, on_event, any_clock, torque)
    moving = any(run.arm_mode in ("free", "driven") for run in runs)
    if moving and model:
        raise RunError("runs with a free or driven arm start from the rig file: omit --model")
    start = load_model(model).starting_point(rig) if model else None
    groups = grouped([_recorded(file) for file in files], by)
    on_event(StageBegan(1, len(STAGES), STAGES[0]))
    ordered = [runs[i] for i in groups.order]
    bare = moving and not effects
    estimates = estimate_each_arm(ordered, rig) if bare else estimate_each(ordered, rig, effects, start)
    on_event(StageBegan(2, len(STAGES), STAGES[1]))
    drift = changes(estimates, groups.group, groups.names)
    kinds = torque_kinds(runs)
    saved = save_drift(drift, estimates, groups.group, rig.name, out, kinds) if out else {}
    return DriftResult(drift, estimates, groups.group, saved, kinds)


def _recorded(file: Path) -> "Occasion":
    from dpr_lab.drift.groups import Occasion
    from dpr_lab.storage.inspect import info

    described = info(file)
    try:
        recorded_at = datetime.fromisoformat(described.recorded_utc) if described.recorded_utc else None
    except ValueError as error:
        raise RunError(f"{file}: its date of recording is not valid: {described.recorded_utc!r}") from error
    if recorded_at is not None and recorded_at.tzinfo is None:
        # a date without time is a day in this computer's time zone
        recorded_at = (
            recorded_at.replace(hour=12).astimezone()
            if len(described.recorded_utc) <= len("2026-03-01")
            else recorded_at.replace(tzinfo=UTC)
        )
    return Occasion(described.file, recorded_at, described.note or file.resolve().parent.name)


def _effects(file: Path) -> "Mapping[str, Mapping[str, float]]":
    """Return the effects of a diagnosis that act during the whole recording."""
    from dpr_lab.effects import EFFECTS
    from dpr_lab.gap.result.diagnosis import load_diagnosis

    effects = load_diagnosis(file).model_effects
    return {name: values for name, values in effects.items() if not EFFECTS[name].event}
