"""What effects could do in another form: their own torque or reading error times a free function of one coordinate.

The library holds each effect in one form, and a real one may have another: friction by a power of the load, a spring
that softens, a delay that shrinks with speed. While something is left over, one effect more may only be making up for
that, so it has to explain what no other form of the rest could.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects import EFFECTS, SLICES, switched_off
from dpr_lab.gap.along import ALONG
from dpr_lab.gap.coordinates import (
    angle_hats,
    encoder_angle,
    encoder_speed,
    joint_force,
    load_hats,
    speed_hats,
    time_hats,
    under_torque,
)
from dpr_lab.gap.hypothesis import Hypothesis
from dpr_lab.gap.problem import Problem
from dpr_lab.gap.response import Course, course
from dpr_lab.gap.score import Score, Scores

Array = NDArray[np.float64]

RIDGE = 1e-6  # of normal matrices of unit columns


def own_share(problem: Problem, less: Hypothesis, scores: Scores, item: Score) -> float:
    """Share of what an effect explains beside a set that no other form of the set's effects explains, 0 to 1.

    Args:
        problem: what was measured
        less: the set
        scores: the score test beside it
        item: the effect, from that
    """
    along = course(problem, less.fit.point)
    readings = np.concatenate([_other_forms(problem, along, less, name) for name in less.effects], axis=2)
    linear = scores.linear
    forms = linear.projected(problem.whitened(readings))
    known = linear.A[:, :, list(scores.active)]
    own = linear.A[:, :, list(item.columns)]
    before, alone, others, both = (
        _fall(linear.e, *parts) for parts in ((known,), (known, own), (known, forms), (known, own, forms))
    )
    return float(np.clip((both - others) / max(alone - before, 1e-300), 0.0, 1.0))


def _fall(e: Array, *parts: Array) -> float:
    """Fall of chi2 by the least-squares solution of all columns."""
    A = np.concatenate(parts, axis=2).reshape(e.size, -1)
    A = A / np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    H, gradient = A.T @ A, A.T @ e.ravel()
    x = np.linalg.solve(H + RIDGE * np.eye(len(H)), gradient)
    return float(2 * x @ gradient - x @ H @ x)


def _other_forms(problem: Problem, along: Course, at: Hypothesis, name: str) -> Array:
    """(samples, 2, k) readings under what an effect of a set would do in other forms."""
    effect, joints = EFFECTS[name], _joints(name)
    if effect.stage not in ALONG and effect.stage != "load":
        point = at.fit.point
        error = problem.readings(point) - problem.readings(replace(point, vector=switched_off(point.vector, name)))
        free = [_free(encoder_angle(problem, j), encoder_speed(along, j), problem.t) for j in joints]
        return np.nan_to_num(error)[:, :, None] * np.concatenate(free, axis=1)[:, None, :]
    if effect.stage == "load":
        (joint,) = joints
        force = joint_force(problem, along, joint)
        slides = np.sign(along.joint_speed[:, joint])
        return under_torque(along, joint, load_hats(force)[0] * (force * slides)[:, None])
    alone = np.zeros_like(at.fit.point.vector)
    alone[SLICES[name]] = at.fit.point.vector[SLICES[name]]
    torque = ALONG[effect.stage](problem, along, alone[None])
    free = [_free(along.joint_angle[:, j], along.joint_speed[:, j], along.t) for j in joints]
    found = [along.readings(np.ascontiguousarray(torque * np.concatenate(free, axis=1)[:, None, :]))]
    if effect.potential:
        found += [under_torque(along, j, angle_hats(along.joint_angle[:, j])[0]) for j in joints]
    return np.concatenate(found, axis=2)


def _joints(name: str) -> tuple[int, ...]:
    """The joints whose angle and speed an effect may depend on: its own, or both where it has none."""
    return {"joint1": (0,), "link1": (0,), "joint2": (1,), "link2": (1,)}.get(name.rpartition("_")[2], (0, 1))


def _free(angle: Array, speed: Array, t: Array) -> Array:
    """(n, k) hats over angle, speed and time."""
    return np.concatenate([angle_hats(angle)[0], speed_hats(speed)[0], time_hats(t)[0]], axis=1)
