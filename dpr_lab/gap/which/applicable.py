"""Effects of the library that can act in some recordings."""

from collections.abc import Mapping

from dpr_lab.effects.drive_gain import DRIVE_GAIN
from dpr_lab.effects.effect import Effect
from dpr_lab.effects.free_arm import FREE_ARM
from dpr_lab.effects.torque_scale import TORQUE_SCALE_JOINT0
from dpr_lab.fitting.problem import Problem


def applicable(library: Mapping[str, Effect], problem: Problem, *, of_points: bool = False) -> dict[str, Effect]:
    """Return the library effects that can act in these recordings and are not always free.

    Args:
        library: effects by name
        problem: segments of the recordings
        of_points: whether all angles are directions between points in a video, which do not depend on counts per turn
    """
    setups = problem.segments.setups
    torques = [setup.torques for setup in setups if setup.torques]
    rods_driven = any(setup.torques and setup.torques.joints.any() and setup.inner is None for setup in setups)
    arm_driven = any(known.on_arm is not None for known in torques)
    has_input = {"drive": rods_driven, "drive0": arm_driven, "input": rods_driven or arm_driven}
    gain_known = DRIVE_GAIN.name not in problem.always and not any(known.scaled for known in torques)
    excluded = {*problem.always, FREE_ARM.name, DRIVE_GAIN.name}
    if not gain_known:
        excluded.add(TORQUE_SCALE_JOINT0.name)
    arm_moves = problem.segments.arm_moves
    arm_prescribed = any(setup.arm for setup in setups)
    one_rod = all(setup.alone for setup in setups)

    def acts(effect: Effect) -> bool:
        if (one_rod and effect.joints == (1,)) or (of_points and effect.corrects == "counts_per_rev"):
            return False
        if not has_input.get(effect.stage, True):
            return False
        if arm_moves:
            return not effect.presumes_still_arm and effect.stage != "arm"
        return not effect.of_arm and not (arm_prescribed and effect.stage == "arm")

    return {name: effect for name, effect in library.items() if name not in excluded and acts(effect)}
