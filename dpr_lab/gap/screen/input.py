"""Tests of the sign and unit of an arm's input, and of its angles."""

from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import BASE, base_of_run
from dpr_lab.effects import param_index
from dpr_lab.effects.coulomb import COULOMB_JOINT0
from dpr_lab.effects.drive_gain import DRIVE_GAIN
from dpr_lab.effects.spring import SPRING_JOINT0
from dpr_lab.errors import IdentificationError, RunError
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.gauss_newton import Fit, fit
from dpr_lab.gap.hypothesis.hypothesis import free_parameters
from dpr_lab.gap.screen.recordings import LENGTHS, Recordings
from dpr_lab.identification.misread.moving_arm_balance import angles_are_right
from dpr_lab.identification.misread.moving_arm_description import (
    DESCRIPTION,
    OTHER_ANGLES,
    UNITS,
    measured_scale,
    wrong_input,
    wrong_sign,
)
from dpr_lab.identification.misread.scaled_readings import TURNED_RODS, ScaledReadings
from dpr_lab.identification.moving_arm.unknowns import nominal_gain
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class InputRules:
    """Thresholds for an arm that stands still, and for other interpretations of a table."""

    still: float = 6.0
    """Maximum range of the arm's angle for an arm that counts as at rest, in standard deviations of a reading."""
    likely: tuple[str, ...] = (SPRING_JOINT0.name, COULOMB_JOINT0.name)
    """Effects that most arms have. Without them in the model, the torque of a strong cable can hide a wrong sign."""
    alike: float = 1.1
    """Maximum ratio of chi-square with the other zero of the rods to chi-square with the given zero.

    Up to this ratio both fits count as equally good.
    """


INPUT = InputRules()


def refuse_wrong_input(recordings: Recordings, start: Array) -> None:
    """Refuse recordings in which the sign or unit of the arm or the input is not as stated.

    Args:
        recordings: the runs
        start: (7,) initial ratios, b and p/b

    Raises:
        RunError: the arm does not move, although it is described as moving.
        IdentificationError: another sign or unit explains the recordings; the message names it.
    """
    if not recordings.arm_moves:
        return
    _refuse_still(recordings)
    as_read = _fitted(recordings, start)
    motor = recordings.rig.motor
    if _reduced(as_read) > DESCRIPTION.doubted or _gain(as_read) < 0.0:
        if cause := measured_scale(_moving(recordings), recordings.rig):
            raise IdentificationError(cause)
        as_read = _fitted(recordings, start, INPUT.likely)
        if not angles_are_right(_moving(recordings), recordings.rig):
            _refuse_other_angles(recordings, start, as_read)
    if _falls_upwards(as_read, recordings):
        turned = _fitted(_reinterpreted(recordings, TURNED_RODS), start)
        if turned.chi2 < INPUT.alike * as_read.chi2 and not _falls_upwards(turned, recordings):
            raise IdentificationError(TURNED_RODS.cause(recordings.rig.rods.mounted))
    if motor is None or not recordings.driven_arm:
        return
    gain = _gain(as_read)
    if (gain < 0.0 or nominal_gain(recordings.rig)) and (cause := wrong_input(motor.input, gain)):
        raise IdentificationError(cause)


def _falls_upwards(fitted: Fit, recordings: Recordings) -> bool:
    """Return whether the fitted gravity torque of a recording has the wrong sign.

    In this case the table states angles from hanging that were read as angles from upright, or the reverse.
    """
    rig, e1 = recordings.rig, BASE.index("e1")
    return any(
        base_of_run(fitted.estimate.whole, recording.setup, rig.L1, rig.g)[e1] < 0.0 for recording in recordings.records
    )


def _gain(fitted: Fit) -> float:
    """Return the fitted torque per unit of input, relative to the value of the rig file."""
    return 1.0 + float(fitted.estimate.params[param_index(DRIVE_GAIN.name, DRIVE_GAIN.amplitudes[0].name)])


def _reduced(fitted: Fit) -> float:
    """Return the reduced chi-square of a fit."""
    return fitted.chi2 / fitted.linear.residual.size


def _far_better(other: Fit, as_read: Fit, factor: float) -> bool:
    """Return whether a different interpretation reduces chi-square by a large factor.

    The factor must be reached in total and in most of the segments that the given interpretation does not fit. A failed
    fit leaves large residuals in a few segments, whichever interpretation is right.
    """
    if not factor * other.chi2 < as_read.chi2:
        return False
    given, changed = as_read.linear.chi2_by_segment, other.linear.chi2_by_segment
    poor = given > DESCRIPTION.doubted * as_read.linear.residual.shape[1]
    return not poor.any() or bool(np.mean(factor * changed[poor] < given[poor]) > 0.5)


def _refuse_other_angles(recordings: Recordings, start: Array, as_read: Fit) -> None:
    """Refuse recordings that fit far better with other angles.

    The tested alternatives are theta0 of opposite sign, another zero of the rods, and half or twice the angles.

    Raises:
        IdentificationError: one of these interpretations explains the recordings; the message names it.
    """
    mirrored = _fitted(_reinterpreted(recordings, ScaledReadings(arm=-1.0)), start, INPUT.likely)
    if _far_better(mirrored, as_read, DESCRIPTION.better):
        of_rods = _gain(mirrored) < 0.0  # in this case, arm and input are consistent
        raise IdentificationError(wrong_sign(recordings.rig, _reduced(as_read), _reduced(mirrored), of_rods=of_rods))
    tried = [(_fitted(_reinterpreted(recordings, other), start, INPUT.likely), other) for other in OTHER_ANGLES]
    best, other = min(tried, key=lambda pair: pair[0].chi2)
    if _far_better(best, as_read, DESCRIPTION.better_angles):
        raise IdentificationError(other.cause(recordings.rig.rods.mounted))


def _moving(recordings: Recordings) -> list[Run]:
    """Return the swings in which the arm moved."""
    return [record.run.swing for record in recordings.records if record.setup.arm_moves]


def _refuse_still(recordings: Recordings) -> None:
    for recording in recordings.records:
        run, turn = recording.run, float(np.ptp(recording.joints[:, -1]))
        if recording.setup.arm_moves and turn < INPUT.still * float(np.median(recording.sigma[:, -1])):
            raise RunError(
                f"{run.file or run.name}: its arm is {run.arm_mode}, but encoder 0 stands still (range"
                f" {turn:.2g} rad). If the arm was held, import with --arm clamped; otherwise check the"
                " column of theta0"
            )


def _fitted(recordings: Recordings, start: Array, effects: tuple[str, ...] = ()) -> Fit:
    """Fit a model with a free gain and some effects to short segments.

    The fit starts from the unit of the input that fits best.
    """
    problem, initial = recordings.cut(LENGTHS.first)
    estimate = Estimate.of(start, recordings.start_params, initial)
    if recordings.driven_arm and recordings.rig.motor:
        problem = replace(problem, always=tuple({*problem.always, DRIVE_GAIN.name}))
        exponents = (0.0, *UNITS.get(recordings.rig.motor.input, ()))
        tried = [estimate.changed(params=_with_gain(estimate.params, 10.0**exponent)) for exponent in exponents]
        estimate = min(tried, key=problem.chi2)
    return fit(problem, estimate, free_parameters(estimate, effects, problem))


def _with_gain(params: Array, gain: float) -> Array:
    changed = params.copy()
    changed[param_index(DRIVE_GAIN.name, DRIVE_GAIN.amplitudes[0].name)] = gain - 1.0
    return changed


def _reinterpreted(recordings: Recordings, other: ScaledReadings) -> Recordings:
    hanging = recordings.rig.encoders.joint_angles.hanging
    return recordings.only([
        replace(
            recording, joints=other.of_joints(recording.joints, hanging), sigma=other.of_sigma(recording.sigma)
        )
        for recording in recordings.records
    ])  # fmt: skip
