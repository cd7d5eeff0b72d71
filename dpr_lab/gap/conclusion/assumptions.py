"""Assumptions of a diagnosis, and effects that the recordings cannot show."""

from collections.abc import Iterator, Mapping

import numpy as np

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.effects import EFFECTS, named_params
from dpr_lab.effects.drive_gain import DRIVE_GAIN
from dpr_lab.effects.encoder_scale import ENCODER_SCALE_JOINT0
from dpr_lab.fitting.disturbance import most_noise
from dpr_lab.gap.result.evidence import DetectableSizes
from dpr_lab.gap.state import Transferred
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.shown import listed, percent

LENGTH_CONTRADICTED = 3.0
"""Deviation of the fitted L1 from the rig file, in standard uncertainties, from which the file is probably wrong."""


def assumptions(state: Transferred, least: DetectableSizes, scale: Scale) -> Iterator[str]:
    """Yield all assumptions of a diagnosis, one sentence each.

    Args:
        state: the diagnosis so far
        least: minimum detectable size, SI, by effect and amplitude; None if no size is detectable
        scale: inertia b that absolute sizes assume
    """
    if state.fitted.division:
        yield state.fitted.division
    yield _length(state)
    yield _scale(state, scale)
    yield (
        "The encoder noise is white, except for the sensor faults that the screening reports. Readings at 300 Hz or"
        " more were averaged over blocks of at most 5 ms."
    )
    yield "The initial state of each segment is fitted; the first 30 ms after each release are excluded."
    yield from _arm(state, least)
    yield from _torques(state)
    yield from _zeros(state)
    yield from _geared(state)
    yield from _misleading(state)
    yield from _unseen(least, state.selection.absorbed, scale.inertia)


def _length(state: Transferred) -> str:
    """State whether L1 is the value of the rig file or was fitted."""
    rig, estimate = state.fitted.recordings.rig, state.selection.chosen.estimate
    if rig.rig.L1_std is None:
        return (
            f"L1 = {rig.L1:g} m and g = {rig.g:g} m/s^2 are taken as exact. Minimum detectable sizes, and sizes from"
            " which effects are excluded, hold only at these values."
        )
    name = next(name for name in state.fitted.problem.always if EFFECTS[name].corrects == "L1")
    (added,) = named_params(estimate.params).get(name, {"": 0.0}).values()
    half_width = max(state.intervals[key] for key in state.intervals if key[0] == name)
    text = (
        f"L1 is given as {rig.L1:g} m with a standard uncertainty of {rig.rig.L1_std:g} m and fitted:"
        f" {rig.L1 + added:.5g} m +- {half_width:.2g} m (90 %), at g = {rig.g:g} m/s^2 and by the device's clock."
    )
    return text if abs(added) < LENGTH_CONTRADICTED * rig.rig.L1_std else f"{text} This contradicts the rig file."


def _scale(state: Transferred, assumed: Scale) -> str:
    """State what determines the scale of all torques."""
    setups = state.fitted.problem.segments.setups
    if drives := [setup.torques for setup in setups if setup.torques and setup.torques.scaled]:
        kinds = " and ".join(sorted({drive.kind for drive in drives} - {""}))
        return f"The known torques{f', as {kinds},' if kinds else ''} fix the scale of all torques.{assumed.condition}"
    if any(setup.added for setup in setups):
        return f"The known added mass fixes the scale of all torques.{assumed.condition}"
    if ("", "b") in state.intervals:
        return "Load-dependent friction fixes the scale of all torques, because the masses were weighed."
    if assumed.known:
        return assumed.sentence
    return f"{assumed.sentence} A release with a known added mass fixes {assumed.inertia}."


def _arm(state: Transferred, least: DetectableSizes) -> Iterator[str]:
    """State whether the arm moves, is prescribed, stood still, or was not recorded."""
    records = state.fitted.recordings.records
    if state.fitted.recordings.arm_moves:
        yield _moving_arm(state)
    elif any(setup.arm for setup in state.fitted.problem.segments.setups):
        size = least.get(ENCODER_SCALE_JOINT0.name, {}).get("excess")
        yield (
            "The arm moves exactly as its readings state, and L0 is taken as exact. A scale error of these readings"
            f" {f'of {percent(size, 1)} or more is' if size else 'is not'} detectable in the segments."
        )
    elif all(record.encoder0_moves is False for record in records):
        yield "According to encoder 0 the arm stood still, so compliance of the arm was not considered."
    elif any(record.encoder0_moves is None for record in records):
        yield "The arm's angle was not recorded."


def _moving_arm(state: Transferred) -> str:
    """State the assumptions about an arm that moves freely or is driven."""
    rig, setups = state.fitted.recordings.rig, state.fitted.problem.segments.setups
    text = "The angle of the arm is measured; its inertia and viscous friction are fitted"
    if not state.fitted.recordings.driven_arm:
        return f"{text}. Only friction, springs and the rods act on it."
    kind = rig.motor.input if rig.motor else "torque"
    if DRIVE_GAIN.name in state.fitted.problem.always:
        return (
            f"{text}. The ratio of torque to {kind} is fitted too, because the rig file contains no measured motor"
            " constants."
        )
    known = "The drive torque is given in N m"
    if kind != "torque":
        known = f"The drive torque follows from the {kind} and the motor constants of the rig file"
    if any(setup.torques and setup.torques.scaled for setup in setups):
        return f"{text}. {known}. This torque fixes the scale of all torques."
    return (
        f"{text}. {known}. Sizes are stated at the nominal b, because m2 and l2 are measured as well. A contradiction"
        " between this b and the drive torque is detectable."
    )


def _torques(state: Transferred) -> Iterator[str]:
    """State the assumptions about the times and the noise of known torques."""
    recordings, problem = state.fitted.recordings, state.fitted.problem
    if share := recordings.torques_earlier:
        yield (
            "The known torques change between rows, so holding each value until the next row would delay the torques."
            f" Each value therefore acts earlier than its time stamp, by {share:.2f} of the row interval (fitted). A"
            " delay of the drive by less than one row is indistinguishable from this shift."
        )
    if recordings.exact_torques:
        yield "The measured torques are taken as exact, because the remainder is far above the effect of their noise."
    if problem.disturbance is None or not (most := most_noise(problem)).any():
        return
    inner, outer = np.minimum(most, recordings.torque_noise_Nm)
    text = f"Noise of the measured torques of joints 1 and 2, standard deviation: {inner:.2g} and {outer:.2g} N m"
    differences = "differences of the recorded torques"
    if np.isfinite(recordings.torque_noise_Nm).all():
        bound = f"{most[0]:.2g} and {most[1]:.2g} N m"
        yield f"{text}, estimated by maximum likelihood of the residuals. Upper bound from {differences}: {bound}."
    else:
        yield f"{text}, estimated from {differences}."


def _zeros(state: Transferred) -> Iterator[str]:
    """State the fitted zero errors of encoders that are zeroed before each recording."""
    runs, zeros = state.fitted.recordings.records, 1e3 * state.selection.chosen.estimate.zeros
    texts = [
        f"{record.run.name}: {offsets[0]:.3g} and {offsets[1]:.3g}"
        for record, offsets in zip(runs, zeros, strict=False)
    ]
    if texts:
        text = "The encoders are zeroed before each recording. Fitted zero errors of joints 1 and 2 in mrad"
        yield f"{text}: {'; '.join(texts)}."


def _geared(state: Transferred) -> Iterator[str]:
    """State which effects the model always contains because the rig has a geared motor."""
    names = [name for name in state.selection.chosen.effects if name in state.selection.expected]
    if names:
        joints = listed([f"joint {joint}" for joint in state.fitted.recordings.rig.joints.geared])
        are = "is" if len(names) == 1 else "are"
        yield f"The rig file has a geared motor on {joints}: {listed(names)} {are} always in the model, even if small."


def _misleading(state: Transferred) -> Iterator[str]:
    """State which effects were excluded because they worsen the held-out predictions."""
    if names := state.selection.misleading:
        was, them = ("was", "it") if len(names) == 1 else ("were", "them")
        yield (
            f"{listed(names)} {was} excluded from the model, because the held-out runs are predicted better without"
            f" {them}. The held-out runs therefore influenced the selection."
        )


def _unseen(least: DetectableSizes, absorbed: Mapping[str, Mapping[str, str]], inertia: str) -> Iterator[str]:
    """State which effects are undetectable, and which ones the ratios absorb."""
    blind = {name: absorbed.get(name, {}) for name, sizes in least.items() if sizes and not any(sizes.values())}
    twins = {
        name: listed(sorted(set(ratios_by_name.values()) & {*RATIOS, "p/b", "b"}))
        for name, ratios_by_name in blind.items()
    }
    if alike := [
        f"{name} is indistinguishable from {twin.replace('/b', f'/{inertia}')}" for name, twin in twins.items() if twin
    ]:
        yield f"In these recordings {listed(alike)}. Effects that a base parameter absorbs are not fitted."
    if hidden := [name for name, twin in twins.items() if not twin]:
        yield f"Undetectable at any size in these recordings: {', '.join(hidden)}."
