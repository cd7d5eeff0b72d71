"""Identifiability analysis of a rig, with or without runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dpr_lab.workflows.events import OnEvent, Warned, ignore
from dpr_lab.workflows.reading import read_runs

if TYPE_CHECKING:
    from dpr_lab.identification.identifiability import Identifiability
    from dpr_lab.identification.moving_arm.identifiability import ArmIdentifiability


@dataclass(frozen=True, slots=True)
class IdentifiabilityResult:
    """Determined and free parameters, and recommended measurements."""

    rig: str
    """Name of the rig."""
    identifiability: "Identifiability | ArmIdentifiability"
    torques: tuple[str, ...] = ()
    """Kinds of the known torques that drove the runs."""


def identifiability(
    rig_name: str, files: Sequence[Path] = (), torque: str | None = None, on_event: OnEvent = ignore
) -> IdentifiabilityResult:
    """Determine which parameters the recordings of a rig identify.

    Args:
        rig_name: rig file, or the name of a built-in one
        files: run files. If empty, releases from the poses of the rig are simulated with the values of the rig file.
        torque: `measured` or `commanded`: torques to use for runs that contain both; None: measured
        on_event: receives `RunRead` and `Warned`

    Raises:
        ConfigError: the rig is not valid; or there are no runs, and the rig has no poses or a joint with a prescribed
            motion, which only recordings contain.
        RunError: a run cannot be used.
    """
    from dpr_lab.identification.identify import identifiability as identifiability_of
    from dpr_lab.rig import load_rig
    from dpr_lab.run import torque_kinds

    rig = load_rig(rig_name)
    runs = read_runs(files, rig, on_event, torque=torque)
    answer = identifiability_of(runs, rig, lambda sentence: on_event(Warned(sentence)))
    return IdentifiabilityResult(rig.name, answer, torque_kinds(runs))
