"""Sign and unit of the input of a driven arm, sign and scale of its angle: alternatives are tested and named."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

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
from dpr_lab.identification.misread.moving_arm_balance import angles_are_right, wrong_scale
from dpr_lab.identification.misread.scaled_readings import OTHER_ZERO, SCALED_READINGS, ScaledReadings
from dpr_lab.identification.moving_arm.unknowns import nominal_gain
from dpr_lab.rig import Rig
from dpr_lab.run import Run

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class InputRules:
    """Thresholds from which another sign or unit is the likely cause."""

    still: float = 6.0
    """Range of the arm's angle, in standard deviations of a reading, below which the arm counts as at rest."""
    suspicious: float = 20.0
    """Reduced chi-square from which other signs and scales are tested."""
    likely: tuple[str, ...] = (SPRING_JOINT0.name, COULOMB_JOINT0.name)
    """Effects that most arms have: without them, a strong cable hides which sign is right."""
    better: float = 4.0
    """Factor by which the other sign must reduce chi-square."""
    better_scale: float = 10.0
    """Factor by which half or twice the angles must reduce chi-square."""
    alike: float = 1.1
    """Factor of chi-square up to which the rods' other zero fits as well."""
    off: float = 0.5
    """Maximum distance of the logarithm (base 10) of the gain from that of a unit's factor."""


RULES = InputRules()

UNITS = {
    "torque": {-3.0: "mN m", -2.0: "N cm", 3.0: "kN m"},
    "current": {-3.0: "mA", 3.0: "kA"},
    "voltage": {-3.0: "mV", 3.0: "kV"},
}
"""Kind of input -> logarithm of the ratio of the fitted gain to that of the rig file -> unit that the column seems
to have.
"""


def refuse_wrong_input(recordings: Recordings, start: Array) -> None:
    """Refuse recordings whose arm or input has another sign or unit than stated.

    Args:
        recordings: the runs
        start: (7,) ratios, b and p/b to start from

    Raises:
        RunError: the arm does not move, although it is described as moving.
        IdentificationError: another sign or unit explains the recordings; the message names it.
    """
    if not recordings.arm_moves:
        return
    _refuse_still(recordings)
    as_read = _fitted(recordings, start)
    motor = recordings.rig.motor
    if as_read.chi2 > RULES.suspicious * as_read.linear.residual.size or _gain(as_read) < 0.0:
        _refuse_measured_scale(recordings)
        as_read = _fitted(recordings, start, RULES.likely)
        if not angles_are_right(_moving(recordings), recordings.rig):
            _refuse_other_angles(recordings, start, as_read)
    if _falls_upwards(as_read, recordings):
        turned = _fitted(_turned(recordings), start)
        if turned.chi2 < RULES.alike * as_read.chi2 and not _falls_upwards(turned, recordings):
            raise IdentificationError(OTHER_ZERO)
    gain = _gain(as_read)
    if motor is None or not recordings.driven_arm:
        return
    if gain < 0.0:
        raise IdentificationError(
            f"the sign of the {motor.input} is reversed: the fitted gain is negative. Import the table with"
            " --scale input=-1"
        )
    for exponent, unit in _units(gain, motor.input) if nominal_gain(recordings.rig) else ():
        raise IdentificationError(
            f"the {motor.input} acts {gain:.3g} times as strongly as the rig file says: its column seems to be in"
            f" {unit}. Import the table with --scale input={10.0**exponent:g}, or correct the constants of [motor]"
        )


def _falls_upwards(fitted: Fit, recordings: Recordings) -> bool:
    """Whether gravity pulls a rod of any recording upwards: that of one rod is then read from the other zero."""
    rig, e1 = recordings.rig, BASE.index("e1")
    return any(
        base_of_run(fitted.estimate.whole, recording.setup, rig.L1, rig.g)[e1] < 0.0 for recording in recordings.records
    )


def _gain(fitted: Fit) -> float:
    """Fitted torque per input, relative to that of the rig file."""
    return 1.0 + float(fitted.estimate.params[param_index(DRIVE_GAIN.name, DRIVE_GAIN.amplitudes[0].name)])


def _wrong_sign(rig: Rig, gain: float) -> str:
    """Sentence on the sign that is wrong if the model fits with the opposite sign of theta0 and some gain.

    With a positive gain, theta0 is reversed. With a negative gain, arm and input agree with each other, and the
    rods are reversed.
    """
    if gain > 0.0:
        return (
            "the sign of theta0 is reversed: with the opposite sign, the model fits the recordings. Import"
            " the table with --scale theta0=-1, or reverse the direction of encoder 0 in [encoders]"
        )
    rods = "theta1=-1,theta2=-1" if rig.rods.mounted == "both" else "theta1=-1"
    return (
        "the sign of the rods is opposite to that of the arm and its input: with it reversed, the model fits the"
        f" recordings. Import the table with --scale {rods}, or reverse the direction of their encoders in [encoders]"
    )


def _far_better(other: Fit, as_read: Fit, factor: float) -> bool:
    """Whether another interpretation reduces chi-square by a factor, in total and in most of the segments that misfit.

    A fit that has failed leaves large residuals in a few segments, whichever interpretation is right.
    """
    if not factor * other.chi2 < as_read.chi2:
        return False
    given, changed = as_read.linear.chi2_by_segment, other.linear.chi2_by_segment
    poor = given > RULES.suspicious * as_read.linear.residual.shape[1]
    return not poor.any() or bool(np.mean(factor * changed[poor] < given[poor]) > 0.5)


def _refuse_other_angles(recordings: Recordings, start: Array, as_read: Fit) -> None:
    """Refuse the opposite sign of theta0, another zero of the rods, and half or twice the angles.

    Raises:
        IdentificationError: one of these interpretations explains the recordings; the message names it.
    """
    mirrored = _fitted(_mirrored(recordings), start, RULES.likely)
    if _far_better(mirrored, as_read, RULES.better):
        raise IdentificationError(_wrong_sign(recordings.rig, _gain(mirrored)))
    if _far_better(_fitted(_turned(recordings), start, RULES.likely), as_read, RULES.better_scale):
        raise IdentificationError(OTHER_ZERO)
    _refuse_scale(recordings, start, as_read)


def _refuse_scale(recordings: Recordings, start: Array, as_read: Fit) -> None:
    """Refuse half or twice the angles of the arm or of the rods.

    Raises:
        IdentificationError: another scale explains the recordings; the message names it.
    """
    tried = [(_fitted(_scaled(recordings, scale), start, RULES.likely), scale) for scale in SCALED_READINGS]
    best, scale = min(tried, key=lambda pair: pair[0].chi2)
    if _far_better(best, as_read, RULES.better_scale):
        raise IdentificationError(scale.cause(recordings.rig.rods.mounted))


def _refuse_measured_scale(recordings: Recordings) -> None:
    """Refuse angles of another scale or unit, which the acceleration of the last rod shows.

    Raises:
        IdentificationError: the angles have another scale or unit; the message names it.
    """
    for run in _moving(recordings):
        if scale := wrong_scale(run.t, run.theta, recordings.rig):
            raise IdentificationError(scale.cause(recordings.rig.rods.mounted))


def _moving(recordings: Recordings) -> list[Run]:
    """The swings whose arm moved."""
    return [record.run.swing for record in recordings.records if record.setup.arm_moves]


def _units(gain: float, kind: str) -> Iterator[tuple[float, str]]:
    for exponent, unit in UNITS.get(kind, {}).items():
        if abs(np.log10(gain) - exponent) < RULES.off:
            yield exponent, unit


def _refuse_still(recordings: Recordings) -> None:
    for recording in recordings.records:
        run, turn = recording.run, float(np.ptp(recording.joints[:, -1]))
        if recording.setup.arm_moves and turn < RULES.still * float(np.median(recording.sigma[:, -1])):
            raise RunError(
                f"{run.file or run.name}: its arm is {run.arm_mode}, but encoder 0 stands still (range {turn:.2g} rad):"
                " if the arm was held, import with --arm clamped, else check the column of theta0"
            )


def _fitted(recordings: Recordings, start: Array, effects: tuple[str, ...] = ()) -> Fit:
    """The model with a free gain and some effects, fitted to short segments; it starts from the most similar unit."""
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


def _mirrored(recordings: Recordings) -> Recordings:
    turned = np.array([1.0, 1.0, -1.0])
    mirrored = [
        replace(recording, joints=recording.joints * turned[: recording.joints.shape[1]])
        for recording in recordings.records
    ]
    return recordings.only(mirrored)


def _turned(recordings: Recordings) -> Recordings:
    """The rods turned by half a turn: another zero."""
    hanging = np.append(recordings.rig.encoders.joint_angles.hanging, 0.0)
    turned = [
        replace(recording, joints=recording.joints + hanging[: recording.joints.shape[1]])
        for recording in recordings.records
    ]
    return recordings.only(turned)


def _scaled(recordings: Recordings, scale: ScaledReadings) -> Recordings:
    hanging, factors = recordings.rig.encoders.joint_angles.hanging, np.array([scale.rods, scale.rods, scale.arm])
    scaled = [
        replace(
            recording,
            joints=scale.of_joints(recording.joints, hanging),
            sigma=recording.sigma * factors[: recording.sigma.shape[1]],
        )
        for recording in recordings.records
    ]
    return recordings.only(scaled)
