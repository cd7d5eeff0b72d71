"""Comparison of one run with a model of any arm."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dpr_lab.identification.moving_arm.identify import AnyComparison, ArmComparison
    from dpr_lab.identification.moving_arm.model import AnyModel, MovingArmModel
    from dpr_lab.rig import Rig
    from dpr_lab.run import Run


def compare_any_run(run: "Run", rig: "Rig", model: "AnyModel", segment_s: float = 0.5) -> "AnyComparison":
    """Simulate a run by segments with a model of any arm.

    Only the initial states are fitted. If the arm is clamped or prescribed, the result also contains one free run, from
    the initial state of the first segment.

    Args:
        run: the measurement
        rig: its rig, whose encoders determine the noise floor
        model: model of `identify` or `corrected_model`
        segment_s: length of a segment, s

    Raises:
        RunError: the run is the name of a file, the run or the model belongs to another rig, the model belongs to
            another mode of the arm, or the model cannot follow the readings.
        IdentificationError: the run has a gap that is too long for a prediction.
    """
    from dpr_lab.estimation.usable_runs import refuse_long_gaps, refuse_other_rigs
    from dpr_lab.identification.compare import compare_run
    from dpr_lab.identification.moving_arm.model import MovingArmModel
    from dpr_lab.run import as_runs

    refuse_other_rigs(as_runs(run), rig)
    refuse_long_gaps([run])
    if isinstance(model, MovingArmModel):
        return compare_arm_run(run, rig, model, segment_s)
    return compare_run(run, rig, model, segment_s)


def compare_arm_run(run: "Run", rig: "Rig", model: "MovingArmModel", segment_s: float = 0.5) -> "ArmComparison":
    """Simulate a run by segments with a model of a moving arm and its effects.

    See `compare_any_run` for arguments and errors.
    """
    from dpr_lab.exports.replay import follow_with_arm
    from dpr_lab.identification.moving_arm.identify import ArmComparison, compare_moving_arm

    if not model.effects:
        return compare_moving_arm(run, rig, model, segment_s)
    followed = follow_with_arm(run, rig, model, segment_s)
    return ArmComparison.of(run, model, followed.t, followed.measured, followed.simulated, segment_s, followed.noise)
