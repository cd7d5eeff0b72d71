"""Effects of the library that can act in some recordings."""

from collections.abc import Callable, Mapping

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
        of_points: whether all angles are directions between points in a video, which do not depend on counts per turn
    """
    setups = problem.segments.setups
    torques = [setup.torques for setup in setups if setup.torques]
    rods_driven = any(setup.torques and setup.torques.joints.any() and setup.inner is None for setup in setups)
    arm_driven = any(known.on_arm is not None for known in torques)
    arm_moves = problem.segments.arm_moves
    gain_fitted = DRIVE_GAIN.name in problem.always or any(known.scaled for known in torques)
    rules: list[tuple[bool, Callable[[Effect], bool]]] = [
        (arm_moves, lambda effect: effect.presumes_still_arm or effect.stage == "arm"),
        (not arm_moves, lambda effect: effect.of_arm),
        (any(setup.arm for setup in setups), lambda effect: effect.stage == "arm"),
        (all(setup.alone for setup in setups), lambda effect: effect.joints == (1,)),
        (of_points, lambda effect: effect.corrects == "counts_per_rev"),
        (gain_fitted, lambda effect: effect.name == TORQUE_SCALE_JOINT0.name),
        (not rods_driven, lambda effect: effect.stage == "drive"),
        (not arm_driven, lambda effect: effect.stage == "drive0"),
        (not (rods_driven or arm_driven), lambda effect: effect.stage == "input"),
    ]  # property of the recordings, and effects that cannot act in such recordings
    excludes = [excluded for holds, excluded in rules if holds]
    free = {*problem.always, FREE_ARM.name, DRIVE_GAIN.name}
    return {
        name: effect
        for name, effect in library.items()
        if name not in free and not any(excluded(effect) for excluded in excludes)
    }
