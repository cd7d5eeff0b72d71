"""Tests of the sign and unit of the arm's input, and of the angles of arm and rods."""

from dataclasses import dataclass, replace
from functools import cache

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
from dpr_lab.identification.misread.moving_arm_description import (
    DESCRIPTION,
    UNITS,
    Interpreted,
    wrong_angles,
    wrong_input,
)
from dpr_lab.identification.misread.scaled_readings import TURNED_RODS, ScaledReadings
from dpr_lab.identification.moving_arm.unknowns import nominal_gain
from dpr_lab.run import turned_arm


@dataclass(frozen=True, slots=True)
class InputRules:
    """Thresholds of the tests of an arm's description, and effects of these tests."""

    still: float = 6.0
    """Maximum range of the arm's angle for an arm that counts as at rest, in standard deviations of a reading."""
    likely: tuple[str, ...] = (SPRING_JOINT0.name, COULOMB_JOINT0.name)
    """Effects that the model of the tests contains. Without them, the torque of a strong cable can hide a wrong
    sign."""
    alike: float = 1.1
    """Maximum ratio of the chi-square of the fit with the other zero of the rods to that with the stated zero.

    Up to this ratio the other zero fits as well.
    """


INPUT = InputRules()
GAIN_EXCESS = param_index(DRIVE_GAIN.name, DRIVE_GAIN.amplitudes[0].name)
"""Index of the relative error of the drive's gain in the parameters of the effects."""


def refuse_wrong_input(recordings: Recordings, start: Array) -> None:
    """Reject recordings whose arm angle or input has another sign or unit than stated.

    Args:
        recordings: the runs
        start: (7,) initial ratios, b and p/b

    Raises:
        RunError: the arm is at rest although it is described as moving, or moves although it is described as clamped.
        IdentificationError: another sign or unit explains the recordings; the message names it.
    """
    if not recordings.arm_moves:
        return
    _refuse_other_modes(recordings)
    rig = recordings.rig
    as_read = _fitted(recordings, start)
    if as_read.reduced > DESCRIPTION.doubted or as_read.gain < 0.0:

        @cache
        def fitted(other: ScaledReadings) -> Interpreted:
            return _fitted(_reinterpreted(recordings, other), start, INPUT.likely)

        moving = [record.run.swing for record in recordings.records if record.setup.arm_moves]
        if cause := wrong_angles(moving, rig, fitted):
            raise IdentificationError(cause)
        as_read = fitted(ScaledReadings())
    if _falls_upwards(as_read.fit, recordings):
        turned = _fitted(_reinterpreted(recordings, TURNED_RODS), start).fit
        if turned.chi2 < INPUT.alike * as_read.fit.chi2 and not _falls_upwards(turned, recordings):
            raise IdentificationError(TURNED_RODS.cause(rig.rods.mounted))
    if recordings.driven_arm and rig.motor and (cause := wrong_input(rig.motor.input, as_read.gain)):
        raise IdentificationError(cause)


def _falls_upwards(fitted: Fit, recordings: Recordings) -> bool:
    """Return whether the fitted gravity torque of a recording has the wrong sign.

    The cause is a wrong zero: angles that are measured from hanging were read as measured from upright, or vice versa.
    """
    rig, e1 = recordings.rig, BASE.index("e1")
    return any(
        base_of_run(fitted.estimate.whole, record.setup, rig.L1, rig.g)[e1] < 0.0 for record in recordings.records
    )


def _refuse_other_modes(recordings: Recordings) -> None:
    for record in recordings.records:
        run = record.run
        if run.arm_mode == "clamped" and (turned := turned_arm(run.swing.theta)):
            raise RunError(f"{run.file or run.name}: {turned}")
        if not record.setup.arm_moves:
            continue
        turn = float(np.ptp(record.joints[:, -1]))
        if turn < INPUT.still * float(np.median(record.sigma[:, -1])):
            raise RunError(
                f"{run.file or run.name}: its arm is {run.arm_mode}, but encoder 0 does not move (range"
                f" {turn:.2g} rad). If the arm was held, import with --arm clamped; otherwise check the"
                " column of theta0"
            )


def _fitted(recordings: Recordings, start: Array, effects: tuple[str, ...] = ()) -> Interpreted:
    """Fit ratios, the gain of a driven arm, and the given effects to short segments.

    The initial gain is that of the unit of the input with the smallest chi-square. The initial states are fitted first,
    because a fit of all values from the states of the readings can end in another minimum.
    """
    problem, initial = recordings.cut(LENGTHS.first)
    estimate = Estimate.of(start, recordings.start_params, initial)
    if recordings.driven_arm and recordings.rig.motor:
        problem = replace(problem, always=tuple({*problem.always, DRIVE_GAIN.name}))
        exponents = (0.0, *UNITS.get(recordings.rig.motor.input, ()))
        params = np.tile(estimate.params, (len(exponents), 1))
        params[:, GAIN_EXCESS] = np.power(10.0, exponents) - 1.0
        estimate = min((estimate.changed(params=of_unit) for of_unit in params), key=problem.chi2)
    estimate = fit(problem, estimate, (), iterations=5).estimate
    fitted = fit(problem, estimate, free_parameters(estimate, effects, problem))
    gain = 1.0 + float(fitted.estimate.params[GAIN_EXCESS])
    gain = gain if nominal_gain(recordings.rig) else float(np.sign(gain))
    return Interpreted(fitted, problem.evidence_by_segment, gain)


def _reinterpreted(recordings: Recordings, other: ScaledReadings) -> Recordings:
    hanging = recordings.rig.encoders.joint_angles.hanging
    return recordings.only([
        replace(
            record, joints=other.of_joints(record.joints, hanging), sigma=other.of_sigma(record.sigma)
        )
        for record in recordings.records
    ])  # fmt: skip
