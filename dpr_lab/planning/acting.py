"""Mountings and drives that are permitted in the releases of a plan."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from dpr_lab.fitting.estimate import SCALE, UNKNOWN_RATIOS, visible_ratios
from dpr_lab.planning.limits import PlanLimits
from dpr_lab.planning.release import ArmState
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import Mounting
from dpr_lab.setup import Setup


def arm_states(rig: Rig, limits: PlanLimits) -> tuple[ArmState, ...]:
    """Return the states of the arm that a plan may use.

    The key `modes` of the limits file defines these states. If the key is missing, the states are `held` and the mode
    of the rig file. The state `driven` is included only if the limits file contains the largest input. A plan does not
    choose the motion of an arm. Therefore an arm that is prescribed or driven by an acceleration is held in all planned
    releases.
    """
    if limits.arm.modes is not None:
        return limits.arm.modes
    if rig.arm.mode == "free":
        return "free", "held"
    return ("driven", "held") if rig.arm.mode == "driven" and limits.arm.input is not None else ("held",)


def allowed_rods(rig: Rig, limits: PlanLimits) -> tuple[Mounting, ...]:
    """Return the permitted mountings of the rods, with the current one first.

    If a key is missing in the limits file, its value is that of the rig file.
    """
    elbows = limits.rods.elbow or (rig.rods.elbow,)
    of_both: list[Mounting] = ["clamped" if elbow == "clamped" else "both" for elbow in elbows]
    permitted: list[Mounting] = []
    for mounted in limits.rods.mounted or (rig.rods.mounted,):
        permitted.extend(of_both if mounted == "both" else (mounted,))
    return tuple(sorted(dict.fromkeys(permitted), key=lambda mounting: mounting != rig.rods.mounting))


@dataclass(frozen=True, slots=True)
class Acting:
    """Parts of the rig that can act in the planned releases: rods, drives and arm."""

    rods: frozenset[Mounting] = frozenset({"both"})
    """Permitted mountings of the rods."""
    joint_drives: bool = False
    """Whether the drives of joints 1 and 2 may act."""
    arm_moves: bool = False
    """Whether the arm may move, freely or driven by its motor."""
    arm_motor: bool = False
    """Whether the motor of the arm may act."""

    @classmethod
    def of(cls, rig: Rig, limits: PlanLimits) -> "Acting":
        """Select the parts that the rig file and the limits of a plan permit."""
        states, rods = arm_states(rig, limits), frozenset(allowed_rods(rig, limits))
        return cls(rods, limits.drive is not None, states != ("held",), "driven" in states)

    def including(self, setups: Sequence[Setup]) -> "Acting":
        """Extend this selection by the parts that acted in the recordings."""
        driven = [setup.torques for setup in setups if setup.torques is not None]
        return replace(
            self,
            rods=self.rods.union(setup.mounting for setup in setups),
            joint_drives=self.joint_drives or any(bool(torques.joints.any()) for torques in driven),
            arm_moves=self.arm_moves or any(setup.arm_moves for setup in setups),
            arm_motor=self.arm_motor or any(torques.on_arm is not None for torques in driven),
        )

    @property
    def elbow(self) -> bool:
        """Whether joint 2 exists in at least one of the permitted mountings."""
        return bool(self.rods - {"inner", "outer"})

    @property
    def hidden_ratios(self) -> tuple[int, ...]:
        """Indices of ratios that no release determines, because their rod is absent."""
        if "both" in self.rods:
            return ()
        visible = visible_ratios([Setup(mounting) for mounting in self.rods])
        return tuple(i for i in range(len(UNKNOWN_RATIOS)) if i not in visible and i != SCALE)


GRAVITY_ONLY = Acting()
"""Free swings of both rods with a clamped arm."""
