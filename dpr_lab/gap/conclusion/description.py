"""Test whether a wrong description of the recordings causes an unexplained gap.

The description of a recording consists of the zeros, signs, scales, units and times of the readings.

One test searches for a scale of the readings at which fewer effects suffice (`other_scale`). It applies to a single
rod, and to rods with a clamped elbow. Suppose that the true angle is theta = f phi for a reading phi. In terms of phi,
the gravity torque is e1 sin(f phi) / f, that is e1 sin(phi) plus a torque that depends on the angle, such as that of a
cable or of cogging. The motion of one degree of freedom does not distinguish the two cases. The coupling of two rods,
or of a rod and a moving arm, does.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.effects import EFFECTS, named_params, without_effect
from dpr_lab.effects.hard_stop import HARD_STOP_JOINT0
from dpr_lab.effects.input_delay import INPUT_DELAY
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import COMPILED
from dpr_lab.gap.damage.hand import energies
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis, free_parameters, hypothesis
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.gap.screen.record import Record
from dpr_lab.gap.state import Description
from dpr_lab.gap.transfer.outcome import Transfer
from dpr_lab.gap.which.selected import Selection
from dpr_lab.identification.misread.balance import ENERGY, residual_near
from dpr_lab.identification.misread.energy import undescribed_drive
from dpr_lab.identification.misread.tried import DescriptionCheck, check_description
from dpr_lab.identification.moving_arm.doubts import stop_sentence
from dpr_lab.rig import Rig
from dpr_lab.run import Run, moves
from dpr_lab.shown import percent


@dataclass(frozen=True, slots=True)
class DescriptionRules:
    """Limits beyond which the diagnosis reports a wrong description of the recordings instead of causes."""

    gap: float = 3.0
    """chi2 per degree of freedom of the bare model above which alternative interpretations are tested.

    A swing of 20 degrees whose angles were imported at half their size has the value 8.
    """
    as_good: float = 0.02
    """Maximum shortfall of the share of the excess that another description explains, compared with the effects.

    Up to this shortfall, the other description counts as equally good.
    """
    torque_step: float = 0.08
    """Maximum median change of a known torque between rows, relative to its range, for a delay within a row.

    If the change is larger, a delay of less than a row is not attributed to the drive. The change is 0.02 or less in
    recordings of real drives, and 0.12 for a sine of 1 Hz at 20 Hz.
    """
    rise: float = 0.1
    """Minimum rise of the energy of a free swing that shows a drive, relative to the mean energy."""
    rise_in_std: float = 6.0
    """Minimum slope of the energy in standard deviations, estimated from the scatter about a straight line."""
    segments: int = 4
    """Minimum number of segments of a run for the test of its energy."""


DESCRIPTION = DescriptionRules()


def description(
    records: Sequence[Record], rig: Rig, problem: Problem, selection: Selection, transfer: Transfer
) -> Description:
    """Test alternative interpretations of the recordings, unless plausible effects explain the gap.

    The effects are not plausible if a gap above the noise remains, if they do not carry over to held-out data, or if
    their sizes are impossible.

    Args:
        records: the fitted runs, screened
        rig: rig of the runs according to its file
        problem: segments of the fitted runs
        selection: the selected set of effects
        transfer: results of the set on held-out recordings
    """
    of_points = all(record.run.film_noise is not None for record in records)  # a direction has no scale
    if hint := _wrong_gravity(rig, selection) or (not of_points and other_scale(problem, selection, rig)):
        return Description(hint, True)
    if hint := _delay_within_row(problem, selection):
        return Description(hint, selection.chosen.effects == (INPUT_DELAY.name,))
    if moves(record.run for record in records):  # other interpretations were tested before (`gap.screen.input`)
        return _stopped(records, rig, selection)
    residuals = selection.bare.residuals
    large = residuals.chi2 > DESCRIPTION.gap * residuals.dof
    doubtful = not selection.chosen.at_noise_floor or transfer.withdrawn or transfer.oversized
    # With a wrong sign of its motion, an arm acts on small swings like a spring, which closes a small gap too.
    arm_as_spring = any(record.run.arm is not None for record in records) and selection.chosen.effects
    if not (arm_as_spring or (large and doubtful)):
        supplied = [(record.run.torques, record.run.inner, record.run.arm) for record in records]
        explained = selection.chosen.effects and selection.chosen.at_noise_floor
        free = all(source is None for sources in supplied for source in sources)
        return rising_energy(problem, selection.bare) if free and not explained else Description()
    runs = [_trusted(record) for record in records]
    look = check_description(runs, rig)
    # an encoder error also causes an apparent energy input
    if not look.sentence or (not look.tried and selection.share_explained >= THRESHOLDS.explained):
        return unexplained_energy(runs, rig)
    return Description(look.sentence, _as_good(look, selection))


def unexplained_energy(runs: Sequence[Run], rig: Rig) -> Description:
    """Describe a change of the rods' energy that neither friction nor known torques explain.

    This test is needed because effects with many amplitudes can imitate the force that supplies the energy (decision
    89). The energy is computed with zero errors of any size, because these are effects too. Recordings with a
    prescribed arm or inner rod are not tested, because the prescribed motion supplies energy.

    Returns:
        the description, or an empty one if no such change exists
    """
    for run in (run.swing for run in runs if run.inner is None and run.arm is None):
        residual = residual_near(run.t, run.theta[:, 1:], run.torques, rig, np.inf, COMPILED)
        if ENERGY.unexplained[run.torques is not None] < residual < np.inf:
            change = f"{percent(residual)} of" if residual < 1 else "more than"
            return Description(
                f"The energy of the rods changes by {change} the energy exchanged by gravity. Friction and known"
                " torques do not explain this change: a motor, a hand or the base drives the rods, or the readings or"
                " their description are incorrect. Record the torques of the motors, or a free swing.",
                forced=True,
            )
    return Description()


def rising_energy(problem: Problem, bare: Hypothesis) -> Description:
    """Describe an energy of free rods that rises throughout a run, although friction can only reduce it.

    The segments of such a run may show no gap, because each has its own initial state. The description is empty if the
    energy of no run rises.
    """
    if len(problem.segments.setups) != 1:
        return Description()
    begins, energy = problem.t[problem.segments.offsets[:-1]], energies(problem, bare.estimate)
    for run in range(problem.segments.run.max() + 1):
        in_run = (problem.segments.run == run) & np.isfinite(energy)
        if np.count_nonzero(in_run) < DESCRIPTION.segments:
            continue
        (slope, _), covariance = np.polyfit(begins[in_run], energy[in_run], 1, cov=True)
        change = slope * np.ptp(begins[in_run]) / np.mean(energy[in_run])
        if change > DESCRIPTION.rise and slope > DESCRIPTION.rise_in_std * covariance[0, 0] ** 0.5:
            return Description(
                f"The energy of the swing rises by {percent(change)}, although friction can only reduce it: a motor, a"
                " hand, another rod or the base drives the rods. Record the torques of the motors, or a free swing.",
                True,
            )
    return Description()


def _stopped(records: Sequence[Record], rig: Rig, selection: Selection) -> Description:
    """Describe an arm that hits a stop, or an arm with a drive that the rig file does not contain.

    The description is empty if the selected effects explain the gap.
    """
    if selection.chosen.at_noise_floor or selection.share_explained >= THRESHOLDS.explained:
        return Description()
    runs = [record.run.swing for record in records]
    stops = [] if HARD_STOP_JOINT0.name in selection.chosen.effects else [stop_sentence(run) for run in runs]
    pushed = undescribed_drive(runs, rig)
    sentence = next(filter(None, stops), "") or pushed[:1].upper() + pushed[1:]
    return Description(f"{sentence}." if sentence else "", bool(sentence))


def _trusted(record: Record) -> Run:
    """Return the run without faulty readings, which would appear as an energy input."""
    run, screened = record.run, record.screened
    return run.only(~np.isin(run.t, screened.t[~screened.keep.all(axis=1)]))


def _wrong_gravity(rig: Rig, selection: Selection) -> str:
    """Describe a wrong gravity of the rig file, which appears as an error of L1 or of the clock.

    Only the quotient g / L1 is identifiable. The text is empty unless the corrected gravity occurs on earth and that of
    the file does not.
    """
    chosen = [EFFECTS[name] for name in selection.chosen.effects if EFFECTS[name].corrects == "L1"]
    if rig.rig.on_earth(rig.g) or not chosen:
        return ""
    (effect,) = chosen
    assert effect.exported is not None
    added = effect.exported(named_params(selection.chosen.estimate.params)[effect.name])["added_length"]
    g = rig.g * rig.L1 / (rig.L1 + added)
    if not rig.rig.on_earth(g):
        return ""
    return (
        f"g = {rig.g:g} m/s^2 in the rig file does not occur on earth. With g = {g:.4g} m/s^2, the"
        f" recordings are explained without an error of L1 = {rig.L1:g} m or of the clock. Correct g in the rig"
        " file and diagnose again."
    )


def _delay_within_row(problem: Problem, selection: Selection) -> str:
    """Describe a delay shorter than a row that cannot be determined, because the torques change too much in a row.

    The text is empty if the fitted delay is longer, or if the torques change little between rows.
    """
    if INPUT_DELAY.name not in selection.chosen.effects:
        return ""
    delay = named_params(selection.chosen.estimate.params)[INPUT_DELAY.name]["delay_s"]
    for torques in (setup.torques for setup in problem.segments.setups if setup.torques):
        interval, ranges = float(np.median(np.diff(torques.t))), np.ptp(torques.joints, axis=0)
        changes = np.median(np.abs(np.diff(torques.joints, axis=0)), axis=0)
        if abs(delay) < interval and np.any(changes > DESCRIPTION.torque_step * ranges):
            return (
                f"The torques change considerably within the {1e3 * interval:.3g} ms between rows. These"
                f" unrecorded changes can cause an apparent delay of {1e3 * delay:.2g} ms. Export the torques at the"
                " rate of the controller."
            )
    return ""


def _as_good(look: DescriptionCheck, selection: Selection) -> bool:
    """Return whether another description explains as much of the gap as the selected effects."""
    if not look.tried:
        return True
    of_arm = any(EFFECTS[name].stage == "arm" for name in selection.chosen.effects)
    refuting = [share for reading, share in look.tried if not (reading.arm and of_arm)]
    return max(refuting, default=0.0) >= selection.share_explained - DESCRIPTION.as_good


SCALES = (2.0, 0.5)
"""Tested ratios of the true angle to the reading, for example for a wrong number of counts per turn."""


def other_scale(problem: Problem, selection: Selection, rig: Rig) -> str:
    """Describe a scale of the readings at which one effect fewer suffices.

    Only recordings of one degree of freedom are tested. The omitted effect must be one whose removal significantly
    increases the cost. The text is empty if there is no such scale.

    Args:
        problem: the segments
        selection: the selected set of effects
        rig: rig according to its file
    """
    chosen = selection.chosen
    setups = problem.segments.setups
    alone = all(setup.held and setup.arm is None and not setup.arm_moves for setup in setups)
    most = chosen.cost + chosen.chance
    smaller = [model.key for model in selection.without.values() if model.cost > most]
    if not smaller or not alone:
        return ""
    # in the selected set, an effect of the angle has changed the gravity torque
    bare = selection.bare.estimate.ratios
    scaled_fits = [
        (factor, _scaled_fit(problem, chosen, bare, factor, names)) for names in smaller for factor in SCALES
    ]
    factor, best = min(scaled_fits, key=lambda pair: pair[1].cost)
    if best.cost > most or not _closes(best, selection):
        return ""
    joint, coupled = 2 if rig.rods.mounted == "outer" else 1, rig.rods.mounted == "both"
    counts = rig.encoders.counts_per_rev[joint]
    moving = "rods with a clamped elbow" if coupled else "a single rod"
    option = f"--scale {factor:g}" + (f", or --scale theta1={factor:g} if theta2 is relative" if coupled else "")
    return (
        f"If the angles are multiplied by {factor:g}, one effect fewer explains the recordings. Recordings of {moving}"
        f" cannot distinguish this scale from the omitted effect. Check counts_per_rev of joint {joint} ({counts} in"
        f" the rig file; it would be {counts / factor:.0f}), or the unit of the table ({option})."
    )


def _closes(scaled: Hypothesis, selection: Selection) -> bool:
    """Return whether the model of the scaled readings explains the gap, without which it supports no scale."""
    before, after = selection.bare.residuals.excess, max(scaled.residuals.excess, 0.0)
    return scaled.at_noise_floor or after <= (1 - THRESHOLDS.explained) * before


def _scaled_fit(
    problem: Problem, chosen: Hypothesis, ratios: Array, factor: float, effects: frozenset[str]
) -> Hypothesis:
    """Fit a set of effects to readings whose deviation of the inner rod from hanging is scaled.

    Args:
        problem: the segments
        chosen: the selected set, from which the fit starts
        ratios: (7,) ratios, b and p/b from which the fit starts
        factor: scale of the angle of the inner rod from hanging; the elbow keeps its angle
        effects: names of the fitted effects
    """
    joints = problem.joints
    turned = joints.to_rods(problem.measured)
    turned += (factor - 1.0) * (turned[:, :1] - np.pi)  # the elbow keeps its angle
    scaled = replace(
        problem,
        measured=joints.of_rods(turned),
        weight=problem.weight / np.array([factor, 1.0 if joints.relative2 else factor]),
    )
    estimate, params = chosen.estimate, chosen.estimate.params
    for name in chosen.key - effects:
        params = without_effect(params, name)
    moved = estimate.initial[:, [0, 0, 2, 2]] - np.array([np.pi, np.pi, 0.0, 0.0])
    start = estimate.changed(ratios=ratios, params=params, initial=estimate.initial + (factor - 1.0) * moved)
    names = tuple(name for name in chosen.effects if name in effects)
    return hypothesis(scaled, names, fit(scaled, start, free_parameters(start, names, scaled)))
