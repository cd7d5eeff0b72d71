"""Test whether fewer effects suffice if the readings are multiplied by a factor.

The test applies to the readings of a single rod, or of rods with a clamped elbow. If a rod turns by theta = f phi for
readings phi, gravity acts on phi like e1 sin(f phi) / f. This equals e1 sin(phi) plus a torque that depends on the
angle, such as the torque of a cable or of cogging. The accelerations of two coupled rods determine their scale, and so
do the accelerations of a rod on a moving arm. The accelerations of one degree of freedom do not determine it.
"""

from dataclasses import replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.effects import without_effect
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis, free_parameters, hypothesis
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.gap.which.selected import Selection
from dpr_lab.rig import Rig

SCALES = (2.0, 0.5)
"""Tested ratios of the true angle to the reading, for example for a wrong number of counts per turn."""


def other_scale(problem: Problem, selection: Selection, rig: Rig) -> str:
    """Describe a scale of the readings at which fewer effects suffice.

    Only readings of one degree of freedom are considered. The text is empty if there is no such scale.

    Args:
        problem: the segments
        selection: the selected set of effects
        rig: rig according to its file
    """
    chosen = selection.chosen
    setups = problem.segments.setups
    alone = all(setup.held and setup.arm is None and not setup.arm_moves for setup in setups)
    if not chosen.effects or not alone:
        return ""
    smaller = (chosen.key - {name} for name in chosen.effects)
    # in the selected set, an effect of the angle has changed the gravity torque
    bare = selection.bare.estimate.ratios
    tried = [(factor, _scaled_fit(problem, chosen, bare, factor, names)) for names in smaller for factor in SCALES]
    factor, best = min(tried, key=lambda pair: pair[1].cost)
    if best.cost > chosen.cost + chosen.chance or not _closes(best, selection):
        return ""
    joint, coupled = 2 if rig.rods.mounted == "outer" else 1, rig.rods.mounted == "both"
    counts = rig.encoders.counts_per_rev[joint]
    turns, moving = ("rods turn", "rods with a clamped elbow") if coupled else ("rod turns", "a single rod")
    option = f"--scale {factor:g}" + (f", or --scale theta1={factor:g} if theta2 is relative" if coupled else "")
    return (
        f"If the {turns} by {factor:g} times the reading, one effect fewer is sufficient, and recordings"
        f" of {moving} cannot distinguish the two cases. Check counts_per_rev of joint {joint} ({counts} in the rig"
        f" file; it would be {counts / factor:.0f}), or the unit of the table ({option})."
    )


def _closes(scaled: Hypothesis, selection: Selection) -> bool:
    """Return whether the model of the scaled readings explains the gap.

    If both models leave the gap open, the result is no evidence for either scale.
    """
    before, after = selection.bare.residuals.excess, max(scaled.residuals.excess, 0.0)
    return scaled.at_noise_floor or after <= (1 - THRESHOLDS.explained) * before


def _scaled_fit(
    problem: Problem, chosen: Hypothesis, ratios: Array, factor: float, effects: frozenset[str]
) -> Hypothesis:
    """Fit `effects` to the readings of joint 1 multiplied by `factor`.

    These readings are measured from hanging. The fit starts from (7,) ratios.
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
