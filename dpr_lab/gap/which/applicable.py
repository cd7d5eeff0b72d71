"""Selection of the library effects that can act in given recordings."""

from collections.abc import Mapping

from dpr_lab.effects.drive_gain import DRIVE_GAIN
from dpr_lab.effects.effect import Effect
from dpr_lab.effects.free_arm import FREE_ARM
from dpr_lab.effects.torque_scale import TORQUE_SCALE_JOINT0
from dpr_lab.fitting.problem import Problem


def applicable(library: Mapping[str, Effect], problem: Problem, *, of_points: bool) -> dict[str, Effect]:
    """Return the library effects that can act in these recordings and are not always free.

    Args:
        library: effects by name
        problem: segments of the recordings
        of_points: whether all angles come from points in a video, so that counts per turn have no influence
    """
    setups = problem.segments.setups
    torques = [setup.torques for setup in setups if setup.torques]
    rods_driven = any(setup.torques and setup.torques.joints.any() and setup.inner is None for setup in setups)
    arm_driven = any(known.on_arm is not None for known in torques)
    arm_moves = problem.segments.arm_moves
    gain_fitted = DRIVE_GAIN.name in problem.always or any(known.scaled for known in torques)
    alone = all(setup.alone for setup in setups)
    free = {*problem.always, FREE_ARM.name, DRIVE_GAIN.name, *([TORQUE_SCALE_JOINT0.name] if gain_fitted else [])}
    stages = {
        "arm": not (arm_moves or any(setup.arm for setup in setups)),
        "drive": rods_driven,
        "drive0": arm_driven,
        "input": rods_driven or arm_driven,
    }  # stages that act only in some recordings

    def acts(effect: Effect) -> bool:
        of_other_arm = effect.presumes_still_arm if arm_moves else effect.of_arm
        absent = (alone and effect.joints == (1,)) or (of_points and effect.corrects == "counts_per_rev")
        return stages.get(effect.stage, True) and not (of_other_arm or absent)

    return {name: effect for name, effect in library.items() if name not in free and acts(effect)}
