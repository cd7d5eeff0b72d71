"""Test whether a diagnosis belongs to given runs and to a given rig."""

from collections.abc import Sequence
from pathlib import Path

from dpr_lab.errors import ConfigError, RunError
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.screen.pieces import uncut, whole
from dpr_lab.rig import Rig
from dpr_lab.run import Run, with_distinct_names
from dpr_lab.shown import listed

AGAIN = " again (plan and accept do so if the diagnosis is omitted)"


def refuse_other_subject(diagnosis: Diagnosis, runs: Sequence[Run], rig: Rig, file: Path | str = "diagnosis") -> None:
    """Refuse a diagnosis that does not belong to the runs and the rig.

    Raises:
        RunError: the diagnosis belongs to other runs.
        ConfigError: the values of the rig differ, or the diagnosis does not state its rig file.
    """
    _refuse_other_runs(file, diagnosis, runs)
    _refuse_other_rig_file(file, diagnosis, rig)


def _refuse_other_rig_file(file: Path | str, diagnosis: Diagnosis, rig: Rig) -> None:
    """Refuse a diagnosis that was made with another description of the rig.

    Sizes and intervals of such a diagnosis are not valid for the given rig. Another file with the same values is
    accepted, because a plan adds poses to the rig file.

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
    raise ConfigError(f"{file}: the diagnosis {fault}: {instead}diagnose the runs{AGAIN}")


def _refuse_other_runs(file: Path | str, diagnosis: Diagnosis, runs: Sequence[Run]) -> None:
    """Refuse a diagnosis that belongs to other runs.

    The causes in a diagnosis must not be combined with information from other runs.
    """
    runs = with_distinct_names(runs)
    instead = f"give its runs, or diagnose these runs{AGAIN}"
    closed = diagnosis.gap.closed_held_out
    stated = {run.name for run in runs}
    fitted = uncut(closed.per_run, stated)
    if fitted and not fitted <= stated <= fitted | uncut(closed.held_out, stated):
        other = f", not of {listed(sorted(stated))}: {instead}" if stated else ", but no runs are given: give its runs"
        raise RunError(f"{file}: is a diagnosis of {listed(sorted(fitted))}{other}")
    recordings = diagnosis.evidence.recordings if diagnosis.evidence else []
    used = {whole(run.name): run.sha256 for run in recordings} | {run.name: run.sha256 for run in recordings}
    changed = [run.name for run in runs if run.sha256 and used.get(run.name, run.sha256) not in ("", run.sha256)]
    if changed:
        raise RunError(f"{file}: is a diagnosis of another recording with the name {listed(changed)}: {instead}")
