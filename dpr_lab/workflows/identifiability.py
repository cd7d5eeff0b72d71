"""Identifiability analysis of a rig, with or without runs."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dpr_lab.workflows.events import OnEvent, Warned, ignore
from dpr_lab.workflows.reading import read_runs

if TYPE_CHECKING:
    from dpr_lab.identification.identifiability import Identifiability
    from dpr_lab.identification.moving_arm.identifiability import ArmIdentifiability


@dataclass(frozen=True, slots=True)
class IdentifiabilityRequest:
    """Options of an identifiability analysis."""

    rig: str
    """Rig file, or the name of a built-in one."""
    runs: tuple[Path, ...] = ()
    """Run files. If it is empty, releases from the poses of the rig are simulated with the values of the rig file."""
    torque: str | None = None
    """`measured` or `commanded`: torques to use for runs that contain both; None: measured."""


@dataclass(frozen=True, slots=True)
class IdentifiabilityResult:
    """Determined and free parameters, and recommended measurements."""

    rig: str
    """Name of the rig."""
    identifiability: "Identifiability | ArmIdentifiability"
    torques: tuple[str, ...] = ()
    """Kinds of the known torques that drove the runs."""


def identifiability(request: IdentifiabilityRequest, on_event: OnEvent = ignore) -> IdentifiabilityResult:
    """Determine which parameters the recordings of a rig identify.

    Events: `RunRead`, `Warned`.

    Raises:
        ConfigError: the rig is not valid; or there are no runs, and the rig has no poses or a joint with a prescribed
            motion, which only recordings contain.
        RunError: a run cannot be used.
    """
    from dpr_lab.identification.identify import identifiability as identifiability_of
    from dpr_lab.rig import load_rig
    from dpr_lab.run import torque_kinds

    rig = load_rig(request.rig)
    runs = read_runs(request.runs, rig, on_event, torque=request.torque)
    answer = identifiability_of(runs, rig, lambda sentence: on_event(Warned(sentence)))
    return IdentifiabilityResult(rig.name, answer, torque_kinds(runs))
