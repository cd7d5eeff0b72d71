"""Read the runs of a request and their diagnosis, with an event for each run."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

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
    from dpr_lab.gap.result.subject import refuse_other_subject

    diagnosis = load_diagnosis(file)
    refuse_other_subject(diagnosis, runs, rig, file)
    return diagnosis
