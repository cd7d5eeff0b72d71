"""Read the runs of a request and their diagnosis, with an event for each run."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dpr_lab.errors import ConfigError, RunError
from dpr_lab.shown import listed
from dpr_lab.workflows.events import OnEvent, RunRead

if TYPE_CHECKING:
    from dpr_lab.gap.result.diagnosis import Diagnosis
    from dpr_lab.rig import Rig
    from dpr_lab.run import Run


def read_runs(
    files: Sequence[Path],
    rig: "Rig",
    on_event: OnEvent,
    any_clock: bool = True,
    torque: str | None = None,
    moving: bool = True,
) -> "list[Run]":
    """Read runs, in the order of their files.

    Args:
        files: run files
        rig: rig of the runs
        on_event: called for each run
        any_clock: whether any clock rate error is accepted
        torque: `measured` or `commanded`: torques to use for runs that contain both
        moving: whether the arm may have been free or driven

    Raises:
        RunError: a file is not a run, or belongs to another rig; two files contain the same recording; a table contains
            several swings between which the rods are held; a table contains only torques of the other kind; or, unless
            `any_clock`, the clock rate error of a device is larger than that of a crystal.
        IdentificationError: a run has a gap that is too long for a prediction.
    """
    from dpr_lab.estimation.held_rods import refuse_held
    from dpr_lab.estimation.usable_runs import (
        refuse_long_gaps,
        refuse_moving_arms,
        refuse_repeated,
        refuse_wrong_clocks,
    )
    from dpr_lab.storage.reader import load_run

    runs: list[Run] = []
    for file in files:
        run = load_run(file, rig=rig).driven_by(torque)
        known = "torques" if run.arm_input is None else "input of the arm"
        other = f"uses the {run.torque_kind} {known}; --torque commanded selects the other kind"
        runs.append(run)
        on_event(RunRead(file, run.name, (*run.notes, other) if run.both_kinds else run.notes))
    refuse_repeated(runs)
    if not moving:
        refuse_moving_arms(runs)
    refuse_held(runs)
    refuse_long_gaps(runs)
    if not any_clock:
        refuse_wrong_clocks(runs)
    return runs


def read_diagnosis(file: Path, runs: "Sequence[Run]", rig: "Rig") -> "Diagnosis":
    """Read the diagnosis of the given runs and rig from its JSON file or folder.

    Raises:
        ConfigError: the file is not a diagnosis, or was made with another rig file.
        RunError: the diagnosis belongs to other runs.
    """
    from dpr_lab.gap.result.diagnosis import load_diagnosis

    diagnosis = load_diagnosis(file)
    refuse_other_runs(file, diagnosis, runs)
    refuse_other_rig_file(file, diagnosis, rig)
    return diagnosis


def refuse_other_rig_file(file: Path | str, diagnosis: "Diagnosis", rig: "Rig") -> None:
    """Refuse a diagnosis that was made with another description of the rig.

    Its sizes and intervals are not valid for the given rig. Another file with the same values is accepted: a plan adds
    poses to the rig file.

    Raises:
        ConfigError: the values of the rig differ, or the diagnosis does not state its rig file.
    """
    evidence = diagnosis.evidence
    if evidence and rig.values_sha256 == evidence.rig_values_sha256:
        return
    if not (evidence and evidence.rig_sha256):
        fault, instead = "does not state its rig file (key evidence.rig_sha256)", ""
    elif rig.sha256 == evidence.rig_sha256:
        return
    else:
        first, second = f"(SHA-256 {evidence.rig_sha256[:8]}...)", f"(SHA-256 {rig.sha256[:8]}...)"
        fault = f"was made with another file of rig {evidence.rig} {first} than {rig.path or rig.name} {second}"
        instead = "give the rig file of the diagnosis, or "
    raise ConfigError(f"{file}: the diagnosis {fault}: {instead}omit the diagnosis to diagnose the runs again")


def refuse_other_runs(file: Path | str, diagnosis: "Diagnosis", runs: "Sequence[Run]") -> None:
    """Refuse a diagnosis that belongs to other runs.

    The causes in a diagnosis must not be combined with information from other runs.
    """
    from dpr_lab.gap.screen.pieces import whole
    from dpr_lab.run import with_distinct_names

    runs = with_distinct_names(runs)
    instead = "give its runs, or omit the diagnosis, and these runs are diagnosed first"
    closed = diagnosis.gap.closed_held_out
    fitted, stated = {whole(name) for name in closed.per_run}, {run.name for run in runs}
    if fitted and not fitted <= stated <= fitted | {whole(name) for name in closed.held_out}:
        raise RunError(
            f"{file}: is a diagnosis of {listed(sorted(fitted))}, not of {listed(sorted(stated))}: {instead}"
        )
    used = {whole(run.name): run.sha256 for run in diagnosis.evidence.recordings} if diagnosis.evidence else {}
    changed = [run.name for run in runs if run.sha256 and used.get(run.name, run.sha256) not in ("", run.sha256)]
    if changed:
        raise RunError(f"{file}: is a diagnosis of another recording with the name {listed(changed)}: {instead}")
