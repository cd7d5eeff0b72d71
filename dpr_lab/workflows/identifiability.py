"""A rig, and runs where there are any, in; what free swings can and cannot tell about it out."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dpr_lab.errors import ConfigError
from dpr_lab.workflows.events import OnEvent, Warned, ignore
from dpr_lab.workflows.reading import read_runs

if TYPE_CHECKING:
    from dpr_lab.identification.identifiability import Identifiability
    from dpr_lab.rig import Rig
    from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class IdentifiabilityRequest:
    """What to judge."""

    rig: str
    """Rig file, or the name of a built-in one."""
    runs: tuple[Path, ...] = ()
    """None: releases simulated from the rig's poses, at the rig file's values."""
    torque: str | None = None
    """`measured` or `commanded`: which known torques drove the joints of runs that hold both; None: the measured."""


@dataclass(frozen=True, slots=True)
class IdentifiabilityResult:
    """What is fixed, what is free, and what to measure next."""

    rig: str
    """Its name."""
    found: "Identifiability"
    torques: tuple[str, ...] = ()
    """Kinds of the known torques that drove the runs."""


def identifiability(request: IdentifiabilityRequest, on_event: OnEvent = ignore) -> IdentifiabilityResult:
    """Say what recordings of a rig can and cannot tell.

    Tells `RunRead`, `Warned`.

    Raises:
        ConfigError: the rig is not valid, or has no poses to simulate releases from.
        RunError: a run that cannot be used.
    """
    from dpr_lab.rig import load_rig
    from dpr_lab.run import torque_kinds

    rig = load_rig(request.rig)
    runs = read_runs(request.runs, rig, on_event, torque=request.torque)
    found = _of_runs(runs, rig, on_event) if runs else _of_poses(rig, on_event)
    return IdentifiabilityResult(rig.name, found, torque_kinds(runs))


def _of_poses(rig: "Rig", on_event: OnEvent) -> "Identifiability":
    from dpr_lab.identification.expected import expected_information
    from dpr_lab.identification.identifiability import identifiability as judge

    if not rig.poses:
        raise ConfigError(f"{rig.path}: poses: there are none to simulate; add [poses.X1], or name recorded runs")
    on_event(Warned(f"no runs given: simulated releases from {', '.join(rig.poses)}, at the rig file's values"))
    return judge(expected_information(rig.nominal, rig), rig)


def _of_runs(runs: "Sequence[Run]", rig: "Rig", on_event: OnEvent) -> "Identifiability":
    import numpy as np

    from dpr_lab.identification.identifiability import identifiability as judge
    from dpr_lab.identification.identify import polish
    from dpr_lab.identification.preprocess import preprocess
    from dpr_lab.identification.prior_update import update_prior
    from dpr_lab.identification.uncertainty import uncertainty

    found = polish(rig.nominal, [preprocess(run, rig) for run in runs], rig)
    if not found.fit.converged:
        on_event(
            Warned(
                "warning: the fit from the rig file's values did not settle; run `dpr-lab identify` for a global search"
            )
        )
    sure = uncertainty(found)
    nine, _ = update_prior(sure.values, sure.covariance, rig, found.visible)
    # What the model misses is no better than noise of that size.
    return judge(
        sure.information / max(1.0, found.chi2_per_dof),
        rig,
        np.array([value.value for value in nine.values()]),
        visible=found.visible,
    )
