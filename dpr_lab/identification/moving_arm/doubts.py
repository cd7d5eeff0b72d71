"""Detect faults and incorrect descriptions of recordings of a moving arm."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.errors import DprError
from dpr_lab.identification.misread.energy import undescribed_drive
from dpr_lab.identification.misread.moving_arm_description import (
    DESCRIPTION,
    OTHER_ANGLES,
    Interpreted,
    wrong_angles,
    wrong_input,
)
from dpr_lab.identification.misread.scaled_readings import ScaledReadings
from dpr_lab.identification.moving_arm.fit import ArmFit, fit_short_segments
from dpr_lab.identification.moving_arm.problem import ArmRecording
from dpr_lab.identification.moving_arm.unknowns import nominal_gain
from dpr_lab.rig import Rig
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class DoubtSettings:
    """Thresholds for the detection of wrong angles, and of an arm that is held or hits a stop."""

    tried_s: float = 2.5
    """Duration of each recording that is examined for another sign, zero or scale of the angles, s."""
    hardly_rad: float = 0.05
    """Maximum range of theta0 of a free arm that its cable or Coulomb friction may hold, rad."""
    contact_s: float = 0.006
    """Time over which a stop changes the speed of the arm, s."""
    sudden: float = 4.0
    """Minimum change of speed at a stop, relative to the 90 % quantile of all changes."""
    strong: float = 0.3
    """Minimum change of speed at a stop, relative to the largest speed."""
    apart: float = 0.02
    """Maximum distance of the arm from the end of its range at a stop, relative to the range."""
    held_s: float = 0.2
    """Minimum time for which an arm that is pressed against a stop stays there after a single contact, s."""


DOUBTS = DoubtSettings()


def failures(fit: ArmFit, recordings: Sequence[ArmRecording], rig: Rig, *, gain_seen: bool = True) -> list[str]:
    """Describe probable faults of the recordings or of their description.

    The first sentence names the most probable cause. The list is empty if there are no faults.

    Args:
        fit: fit of the recordings with the given description
        recordings: the fitted recordings
        rig: the recorded rig
        gain_seen: whether the recordings determine the gain of the drive; otherwise, sign and unit of the input are not
            tested
    """
    runs = [recording.run for recording in recordings]
    poor = fit.misfit > DESCRIPTION.doubted
    stops = [sentence for run in runs if fit.misfit > 1.5 and (sentence := stop_sentence(run))]
    if poor and (cause := _wrong_angles(recordings, rig, () if stops else OTHER_ANGLES)):
        return [cause]
    if poor and not stops and (pushed := undescribed_drive(runs, rig)):
        return [pushed]
    cause = wrong_input(rig.motor.input, _gain(fit, rig)) if gain_seen and rig.motor else ""
    return [*stops, *([cause] if cause else []), *([] if fit.converged else [_unconverged(recordings)])]


def _wrong_angles(recordings: Sequence[ArmRecording], rig: Rig, others: Sequence[ScaledReadings]) -> str:
    """Return a message if another interpretation of the angles fits far better, otherwise an empty text.

    Short segments at the beginning of the recordings are fitted.
    """

    def fitted(other: ScaledReadings) -> Interpreted | None:
        with suppress(DprError, np.linalg.LinAlgError):
            fit = fit_short_segments([_reinterpreted(_beginning(recording), other) for recording in recordings], rig)
            return Interpreted(fit.fit, fit.problem.evidence_by_segment, _gain(fit, rig))
        return None

    moving = [recording.run for recording in recordings if recording.run.arm_mode != "clamped"]
    return wrong_angles(moving, rig, fitted, others)


def _gain(fit: ArmFit, rig: Rig) -> float:
    """Return the fitted gain of the drive relative to the rig file.

    If the rig file does not state the gain, the result is the sign of the fitted gain. If the gain is not fitted, the
    result is 1.
    """
    if "gain" not in fit.problem.unknowns.free:
        return 1.0
    gain, expected = fit.value("gain"), nominal_gain(rig) / fit.problem.unknowns.scale_value
    return gain / expected if expected else float(np.sign(gain))


def _unconverged(recordings: Sequence[ArmRecording]) -> str:
    for recording in recordings:
        moved = float(np.ptp(recording.run.theta[:, 0]))
        if recording.run.arm_mode == "free" and moved < DOUBTS.hardly_rad:
            return (
                f"{recording.run.file or recording.run.name}: its arm moves by only {moved:.2g} rad, which"
                " determines neither A nor c0. If the arm was held, import or capture with --arm clamped; otherwise"
                " record swings that move the arm"
            )
    return "the fit did not converge: improve the nominal values of A and c0 in [arm]"


def _beginning(recording: ArmRecording) -> ArmRecording:
    run = recording.run.between(-np.inf, DOUBTS.tried_s)
    return replace(recording, run=run, drive=recording.drive[: len(run.t)], slope=recording.slope[: len(run.t)])


def _reinterpreted(recording: ArmRecording, other: ScaledReadings) -> ArmRecording:
    run = replace(recording.run, theta=other.of_theta(recording.run.theta))
    return replace(recording, run=run, std=other.of_sigma(recording.std[..., [1, 2, 0]])[..., [2, 0, 1]])


def stop_sentence(run: Run) -> str:
    """Return a message if the arm hits a stop, otherwise an empty text.

    At a stop, the speed of the arm jumps at least twice, or the speed jumps once and the arm then stays at the stop.
    """
    if run.arm_mode == "clamped" or np.ptp(run.theta[:, 0]) < DOUBTS.hardly_rad:
        return ""
    name = run.file or run.name
    for end, angle, contacts in stops(run.t, run.theta[:, 0]):
        often = f"{len(contacts)} times" if len(contacts) > 1 else "and stays there"
        return (
            f"{name}: the arm hits a stop at theta0 = {angle:.3g} rad, its {end} angle, {often}, first at"
            f" {contacts[0]:.2f} s: the speed of the arm changes abruptly there. Record smaller motions, or"
            f" import the part before it (--duration-s {max(contacts[0] - 0.01, 0.0):.2f})"
        )
    return ""


def _stays(t: Array, theta0: Array, contact: int, angle: float, reach: float) -> bool:
    """Check whether the arm stays within `reach`, rad, of an angle after a contact."""
    after = (t >= t[contact]) & (t < t[contact] + DOUBTS.held_s)
    return bool(t[-1] - t[contact] > DOUBTS.held_s and (np.abs(theta0[after] - angle) < reach).all())


def stops(t: Array, theta0: Array) -> list[tuple[str, float, list[float]]]:
    """Find the stops of an arm.

    Args:
        t: (n,) times, s
        theta0: (n,) angles of the arm, rad

    Returns:
        for each stop, the end of the range (`largest` or `smallest`), its angle, rad, and the instants of the contacts,
        s
    """
    dt = float(np.median(np.diff(t)))
    k = max(1, round(DOUBTS.contact_s / dt / 2 + 1e-6))
    speed = (theta0[k:] - theta0[:-k]) / (t[k:] - t[:-k])
    change = np.abs(speed[k:] - speed[:-k])  # change i is at sample i + k
    limit = max(DOUBTS.sudden * float(np.quantile(change, 0.9)), DOUBTS.strong * float(np.abs(speed).max()))
    reach = DOUBTS.apart * float(np.ptp(theta0))
    hard_stops = list[tuple[str, float, list[float]]]()
    for end, angle in (("largest", float(theta0.max())), ("smallest", float(theta0.min()))):
        sudden = np.flatnonzero((change > limit) & (np.abs(theta0[k : k + len(change)] - angle) < reach))
        first = sudden[np.diff(sudden, prepend=-10 * k) > 4 * k] if len(sudden) else sudden
        if len(first) >= 2 or (len(first) == 1 and _stays(t, theta0, int(first[0]) + k, angle, reach)):
            hard_stops.append((end, angle, t[first + k].tolist()))
    return hard_stops
