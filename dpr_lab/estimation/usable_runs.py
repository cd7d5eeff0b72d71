"""Checks that raise an error for runs that a job cannot use."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.errors import IdentificationError, RunError
from dpr_lab.rig import Rig
from dpr_lab.run import Run, clock_error


@dataclass(frozen=True, slots=True)
class GapSettings:
    """Limits of the interruptions across which the motion may be predicted (decision 101)."""

    longest_s: float = 3.0
    """Longest interruption that is not refused, s. After a longer one, smoothed states can be infinite."""
    steps: float = 20.0
    """Number of median steps up to which an interruption is permitted, because the unit of time may be wrong."""


GAP = GapSettings()


def long_gap(t: Array) -> tuple[int, str]:
    """Return the first sample after the first interruption that is too long, and a description of the interruption.

    If no interruption is too long, the sample is 0 and the description is empty.
    """
    steps = np.diff(t)
    limit = max(GAP.longest_s, GAP.steps * np.median(steps)) if len(steps) else np.inf
    for before in np.flatnonzero(steps > limit)[:1].tolist():
        return before + 1, (
            f"has an interruption of {steps[before]:.3g} s at {t[before]:.5g} s, which is too long for a prediction."
            " Import the parts before and after the interruption as separate runs"
        )
    return 0, ""


def refuse_unusable(runs: Sequence[Run], rig: Rig) -> None:
    """Check that no run is given twice, belongs to another rig, or has a long interruption.

    Raises:
        RunError: a run is given twice or names another rig, or `rig` is the name or path of a rig file.
        IdentificationError: a run has an interruption that is too long.
    """
    refuse_repeated(runs)
    refuse_other_rigs(runs, rig)
    refuse_long_gaps(runs)


def refuse_long_gaps(runs: Iterable[Run]) -> None:
    """Check that no run has an interruption after the release that is too long to predict the motion.

    Raises:
        IdentificationError: a run has an interruption that is too long.
    """
    for run in runs:
        _, words = long_gap(run.swing.t)
        if words:
            raise IdentificationError(f"{run.file or run.name}: {words} (--start-s, --duration-s)")


def refuse_other_rigs(runs: Iterable[Run], rig: Rig) -> None:
    """Check that `rig` is a rig, and that no run names another rig.

    Raises:
        RunError: a run names another rig, or `rig` is the name or path of a rig file.
    """
    if isinstance(rig, (str, Path)):
        raise RunError(f"{rig}: is the name of a rig file, not a rig: read the file with load_rig")
    for run in runs:
        refuse_other_rig(run.file or run.name, run.rig_name, rig.name)


def refuse_other_rig(place: Path | str, recorded: str, expected: str) -> None:
    """Check that the rig of a recording, if known, is the given rig.

    Raises:
        RunError: the names differ; the message starts with `place`, the file or the name of the run.
    """
    if recorded not in ("", expected):
        raise RunError(
            f"{place}: is a run of another rig: {recorded}, not {expected}. Give the rig file that was used for the"
            " recording, or leave this run out"
        )


def refuse_moving_arms(runs: Iterable[Run]) -> None:
    """Check that the arm was neither free nor driven in any run.

    Raises:
        RunError: the arm of a run was free or driven.
    """
    for run in runs:
        if run.arm_mode in ("free", "driven"):
            raise RunError(
                f"{run.file or run.name}: its arm was {run.arm_mode}. Only `identify`, `compare`, `diagnose`, `accept`,"
                " `plan`, `check`, `certify`, `drift` and `identifiability` support such a run;"
                " import the table with --arm prescribed to use the arm's encoder instead"
            )


def refuse_wrong_clocks(runs: Sequence[Run], limit_ppm: float = 600.0) -> None:
    """Check the clock rate of every recording.

    Raises:
        RunError: the clock rates of device and host differ by more than `limit_ppm`, which exceeds the error of any
            crystal.
    """
    for run in runs:
        error, words = clock_error(run.clock)
        if error > limit_ppm:
            raise RunError(
                f"{run.file or run.name}: the device's clock runs {words} relative to the computer that recorded it"
                f" (limit {limit_ppm:g} ppm; the error of a crystal is about 100 ppm): all times and all results in"
                " seconds have this error. Repair the device's sample timer and record again, or use the run"
                " as it is with --any-clock"
            )


def refuse_repeated(runs: Sequence[Run]) -> None:
    """Check that no recording is given twice, or is both fitted and held out.

    Raises:
        RunError: two runs contain the same times and angles, also if a table was imported twice.
    """
    by_digest: dict[str, Run] = {}
    for run in runs:
        digest = run.angles_sha256
        if same := by_digest.get(digest):
            names = [str(repeated.file or repeated.name) for repeated in (run, same)]
            raise RunError(f"{names[0]}: is the same recording as {names[1]}; it was given twice: give each run once")
        by_digest[digest] = run
