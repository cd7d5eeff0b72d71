"""Gravity torques that no rig has."""

import numpy as np

from dpr_lab.dynamics.base import BASE, RATIOS, base_of_run
from dpr_lab.fitting.covariance import considered
from dpr_lab.fitting.estimate import SCALE
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis


def rises(problem: Problem, model: Hypothesis, deviations: float = 2.0) -> bool:
    """Whether the gravity torque of the inner rod is significantly negative, so that gravity would lift the rod.

    In swings of similar amplitude, an effect that depends on the angle can replace gravity, and compensate for a
    gravity torque of the wrong size or sign.
    """
    estimate, constants, place = model.fit.estimate, problem.model.constants, RATIOS.index("e1/b")
    free = [i for i, p in enumerate(model.fit.free) if p.block == "ratios" and p.place == place]
    setups = [setup for setup in set(problem.segments.setups) if setup.mounting != "outer"]
    if not (free and setups and constants.g > 0.0):
        return False
    whole = estimate.whole / estimate.ratios[SCALE]
    torque = max(base_of_run(whole, setup, constants.L1, constants.g)[BASE.index("e1")] for setup in setups)
    if torque >= 0.0:
        return False
    variance = considered(model.fit, model.residuals.inflation)[free[0], free[0]]
    return bool(torque + deviations * np.sqrt(variance) < 0.0)
