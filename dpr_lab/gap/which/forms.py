"""Other functional forms of an effect: products of its torque, or of its error, with a free function.

The library contains each effect in one functional form, and a real effect may have another: friction that grows with a
power of the load, a softening spring, a delay that decreases with speed. While a residual remains, an additional effect
may merely compensate for such a deviation. It must therefore explain a part of the residual that no other form of the
remaining effects can explain. Conservative torques and encoder errors have no forms that depend on the speed: a tilt
whose sign changes with the speed, for example, would be friction.

A form that contains the tested effect itself is not an alternative explanation. Air drag, for example, is Coulomb
friction multiplied by a function of the speed. For two dissipative effects at one joint, forms that depend on the speed
are therefore not considered. The same applies to forms that depend on time, because the amplitude of a free swing
decreases with time. A free function of the speed is itself an effect of the library (`friction_curve`), and the search
compares both effects with it.
"""

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.rig_constants import constants_of_run
from dpr_lab.dynamics.trajectory import TRAJECTORY_TORQUES
from dpr_lab.effects import EFFECTS, SLICES, without_effect
from dpr_lab.effects.effect import Effect
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import ColumnSpace
from dpr_lab.fitting.response import Trajectory, trajectory
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.score_test import ScoreTest
from dpr_lab.gap.where.coordinates import (
    BINS,
    angle_hats,
    encoder_angle,
    encoder_speed,
    hats,
    speed_hats,
    time_hats,
    under_torque,
)

READINGS_PER_FORM = 8
"""Minimum number of readings per column of the other forms; with fewer readings, free functions can fit any
residual."""


def own_share(problem: Problem, smaller: Hypothesis, test: ScoreTest, effect: str) -> float | None:
    """Return the own share of an effect, 0 to 1.

    It is the part of the reduction of chi2 by the effect that no other form of the remaining effects explains. Let
    G(...) be the reduction of chi2 by the fitted parameters p, the effect c and the other forms o. Then

        own share = (G(p, c, o) - G(p, o)) / (G(p, c) - G(p))

    The result is 1 if the recordings are too short to determine the other forms, and None if the effect has no score.

    Args:
        problem: segments and noise
        smaller: set without the effect
        test: score test of that set
        effect: name of the effect
    """
    score = test.best_score(effect)
    if score is None:
        return None
    reference, linear = trajectory(problem, smaller.estimate), test.linear
    forms = linear.projected(
        np.concatenate(
            [_other_forms(problem, reference, smaller, name, score.effect) for name in smaller.effects], axis=2
        )
    )
    fitted, new = linear.A[:, :, list(test.fitted_columns)], linear.A[:, :, list(score.columns)]
    space = ColumnSpace.of(np.concatenate([fitted, new, forms], axis=2), linear.e)
    of_fitted, of_own, of_forms = np.split(np.arange(len(space)), np.cumsum([fitted.shape[2], new.shape[2]]))
    if len(of_forms) * READINGS_PER_FORM > linear.e.size:
        return 1.0
    of_p, of_pc, of_po, of_pco = (
        space.chosen(np.concatenate(columns)).gain()
        for columns in ([of_fitted], [of_fitted, of_own], [of_fitted, of_forms], [of_fitted, of_own, of_forms])
    )
    return float(np.clip((of_pco - of_po) / (of_pc - of_p), 0.0, 1.0)) if of_pc > of_p else 0.0


def _other_forms(problem: Problem, reference: Trajectory, model: Hypothesis, name: str, tested: Effect) -> Array:
    """Return the (segments, m, k) whitened changes of the readings by the other forms of one effect.

    Forms that contain the tested effect are omitted.
    """
    effect, estimate = EFFECTS[name], model.estimate
    if effect.stage == "load":
        (joint,) = effect.joints
        force = _joint_force(problem, reference, joint)
        slides = np.sign(reference.joint_speed[:, joint])
        knots = np.quantile(force, np.linspace(0.01, 0.99, BINS // 2))
        return under_torque(problem, reference, joint, hats(force, knots) * (force * slides)[:, None])
    if effect.stage not in TRAJECTORY_TORQUES:
        without = estimate.changed(params=without_effect(estimate.params, name))
        error = np.nan_to_num(problem.predict(estimate) - problem.predict(without))
        free = [
            _free(effect, tested, encoder_angle(problem, j), encoder_speed(reference, j), problem.t)
            for j in effect.joints
        ]
        return problem.whitened(error[:, :, None] * np.concatenate(free, axis=1)[:, None, :])
    alone = np.zeros_like(estimate.params)
    alone[SLICES[name]] = estimate.params[SLICES[name]]
    torque = reference.torques(effect.stage, problem.model.constants, alone[None])
    free = [
        _free(effect, tested, reference.joint_angle[:, j], reference.joint_speed[:, j], reference.motion.t)
        for j in effect.joints
    ]
    columns = [reference.response(problem, torque * np.concatenate(free, axis=1)[:, None, :])]
    if effect.potential:
        columns += [
            under_torque(problem, reference, j, angle_hats(reference.joint_angle[:, j])[0]) for j in effect.joints
        ]
    return np.concatenate(columns, axis=2)


def _free(effect: Effect, tested: Effect, angle: Array, speed: Array, t: Array) -> Array:
    """Return the (n, k) hat functions of angle, time and speed that multiply an effect.

    Functions of time and speed are omitted if the forms would contain the tested effect, and those of speed for
    conservative torques and encoder errors.
    """
    of_pose = not effect.dissipative and effect.stage in ("torque", "encoder")
    functions = [angle_hats(angle)[0]]
    if not _are_losses_of_speed(effect, tested):
        functions += [time_hats(t)[0], *([] if of_pose else [speed_hats(speed)[0]])]
    return np.concatenate(functions, axis=1)


def _are_losses_of_speed(effect: Effect, tested: Effect) -> bool:
    """Return whether both effects are speed-dependent dissipative torques at one joint.

    The tested effect must not be load-dependent friction.
    """
    share_joint = not set(effect.joints).isdisjoint(tested.joints)
    return share_joint and effect.dissipative and tested.dissipative and tested.stage != "load"


def _joint_force(problem: Problem, reference: Trajectory, joint: int) -> Array:
    """Return the (n,) force on a joint, N, from the accelerations of equation (1)."""
    motion = reference.motion.part(slice(None), axes=2)
    theta, omega, alpha = motion.theta, motion.omega, motion.alpha
    sin, cos = np.sin(theta), np.cos(theta)
    across = cos * alpha - sin * omega**2
    up = -sin * alpha - cos * omega**2
    force = np.empty(len(motion.t))
    for setup, base in zip(reference.setups, reference.bases, strict=True):
        samples, rig = reference.of_setup(setup), constants_of_run(problem.model.constants, setup)
        inner, outer = base[3] / rig.g, base[2] / problem.model.constants.L1
        if joint == 0:
            weight = (rig.m1 + rig.m2 + rig.mb) * rig.g
            lengths = np.array([inner, outer])
        else:
            weight = rig.m2 * rig.g
            lengths = np.array([rig.m2 * rig.L1, outer])
        force[samples] = np.hypot(across[samples] @ lengths, up[samples] @ lengths + weight)
    return force
