"""Effects in the lanes of a workspace, one loop per effect.

The loop of an inactive effect is skipped. The loops are generated from the same rows of `dpr_lab.effects.stages.STAGES`
as the scalar versions.
"""

import math
from typing import Any

from dpr_lab.arrays import Flags
from dpr_lab.dynamics.lanes.workspace import (
    LaneWorkspace,
    base_at,
    constants_at,
    copy_rows,
    joint0_at,
    joint1_at,
    joint2_at,
    motion_at,
)
from dpr_lab.effects.effect_kernels import contributions
from dpr_lab.effects.fold import compiled
from dpr_lab.effects.quantities import yielding
from dpr_lab.effects.stages import STAGES
from dpr_lab.kernels import subroutine


class _LaneNotation(dict[str, str]):
    """Expressions for the variables of lane k in a workspace w, by the names of the variables.

    For example, `params_3` becomes `w.params[3, k]`.
    """

    def __missing__(self, name: str) -> str:
        rows, _, index = name.rpartition("_")
        return f"w.{rows}[{index}, k]" if index.isdecimal() else f"w.{name}[k]"


_NOTATION = _LaneNotation(
    motion="motion_at(w, k)",
    base="base_at(w, k)",
    constants="constants_at(w, k, constants)",
    joint0="joint0_at(w, k)",
    joint1="joint1_at(w, k)",
    joint2="joint2_at(w, k)",
    known1="(w.drive1[k] + w.drive2[k])",
    known2="w.drive2[k]",
)

_NAMES: dict[str, Any] = {"yielding": yielding, "copysign": math.copysign}
_NAMES |= {
    function.__name__: function for function in (base_at, constants_at, joint0_at, joint1_at, joint2_at, motion_at)
}


def lane_stage(stage: str) -> Any:
    """Return the compiled function of a stage for all lanes.

    It has the form (w, [constants,] active) -> None, and updates the rows in which the stage has its results.
    """
    calls = contributions(stage)
    arguments = "w, constants, active" if "constants" in STAGES[stage].quantities else "w, active"
    lines = [f"def {stage}_lanes({arguments}):"]
    for contribution in calls:
        lines += [f"    {contribution.guard()}", "        for k in range(len(w.t)):"]
        lines += [f"            {statement}" for statement in contribution.statements(stage, _NOTATION)]
    return compiled([*lines, "    return"], _NAMES | {c.name: c.kernel for c in calls})


add_torques = lane_stage("torque")
"""(w, constants, active): add the contributions of the effects to the terms of the equation of motion."""

add_load_friction = lane_stage("load")
"""(w, constants, active): add load-dependent friction to the terms, for known joint forces."""

add_drives = lane_stage("drive")
"""(w, active): add the difference between acting and known drive torques to the torques on the rods."""

add_dry_limits = lane_stage("dry")
"""(w, active): add the Coulomb friction of joints under given torques to the rows of friction limits."""

add_arm_torques = lane_stage("torque0")
"""(w, active): add the torques of effects on the arm to the row `torque0`."""

add_arm_drives = lane_stage("drive0")
"""(w, active): replace the known torque of the arm's drive in the row `torque0` by the acting torque."""

add_whole_torques = lane_stage("whole0")
"""(w, constants, active): add the torques on a moving arm and its rods to the rows `torque0`, `torque1`, `torque2`.
"""

add_dry_limit0 = lane_stage("dry0")
"""(w, active): add the Coulomb friction of the arm to the row of its friction limit."""

hold_angle2 = lane_stage("play")
"""(w, active): replace the angle of joint 2 by the angle that its encoder holds."""

hold_angle1 = lane_stage("play1")
"""(w, active): replace the angle of joint 1 by the angle that its encoder holds."""

follow_motor = lane_stage("play0")
"""(w, active): move the arm's motor within the backlash of its gear by the time in the row `elapsed0`."""

_move_states = lane_stage("transition")


@subroutine
def displaced(w: LaneWorkspace, active: Flags) -> None:
    """Fill the rows `moved` with the internal states after the displacements of the joints.

    The displacements start from the states in `old_internal`.
    """
    copy_rows(w.old_internal, w.moved)
    _move_states(w, active)
