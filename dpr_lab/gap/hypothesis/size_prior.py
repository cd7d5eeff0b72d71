"""Prior of the fitted size of an effect on one rig.

For most effects, the prior is that of laboratory rigs (`dpr_lab.effects.plausibility`). A spring and an error of the
encoder scale imitate each other on a single rod, so that their priors decide between them. These priors depend on the
rig:

- The stiffness of a spring is compared with the gravity torque, because heavy rods have strong cables. A spring is weak
  or, with a small prior weight, arbitrarily strong.
- A scale error is a tolerance, belongs to another common encoder, or is arbitrary (belt, potentiometer).

Most springs are linear. The weight of a spring is therefore that of its simplest adequate form.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, combinations

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import base_of_run
from dpr_lab.effects import EFFECTS, param_index, plausibility
from dpr_lab.effects.encoder_scale import ENCODER_SCALE, usual_counts
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.effects.spring import SPRING
from dpr_lab.fitting.covariance import considered
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.calibration import CALIBRATION


@dataclass(frozen=True, slots=True)
class SizePrior:
    """Prior of the sizes of springs and scale errors."""

    tolerance: float = 5e-3
    """Largest relative error of a scale that counts as a tolerance.

    On a single rod, a spring of twice this fraction of the gravity torque imitates such an error. This torque is
    therefore the scale of the prior of weak springs.
    """
    other_encoder: float = 0.5
    """Prior weight of the scale of another common encoder, relative to a tolerance."""
    arbitrary: float = 0.03
    """Prior weight of an arbitrary scale, for example due to a belt or a potentiometer, and of a strong spring."""


SIZE_PRIOR = SizePrior()

SCALES, SPRINGS = (tuple(effect.name for effect in pair) for pair in (ENCODER_SCALE, SPRING))
"""Names of the scale errors, and of the springs, of joints 1 and 2."""


def gravity_torques(problem: Problem, estimate: Estimate) -> tuple[float, float]:
    """Return the largest gravity torques of the mounted rods about joints 1 and 2, N m."""
    constants = problem.model.constants
    setups = set(problem.segments.setups)
    bases = np.abs([base_of_run(estimate.whole, setup, constants.L1, constants.g) for setup in setups])
    _, _, d, e1, _, _ = bases.T
    e2 = d * constants.g / constants.L1
    return float(np.max(e1 + e2)), float(np.max(e2))


def size_prior(params: Array, effect: str, gravity: Sequence[float], constants: RigConstants) -> float:
    """Return the prior weight of an effect with its fitted size on one rig.

    Args:
        params: (SIZE,) parameters of all effects
        effect: name of the effect
        gravity: gravity torques about joints 1 and 2, N m
        constants: encoders of the rig
    """
    if effect in SCALES:
        counts = (constants.counts_per_rev1, constants.counts_per_rev2)[SCALES.index(effect)]
        return EFFECTS[effect].prior_odds * _scale(float(params[param_index(effect, "excess")]), counts)
    if effect in SPRINGS:
        params, weak = params.copy(), 2.0 * SIZE_PRIOR.tolerance * gravity[SPRINGS.index(effect)]
        for amplitude in EFFECTS[effect].amplitudes:
            params[param_index(effect, amplitude.name)] /= max(1.0, weak / amplitude.prior_scale)
        return max(plausibility(params, effect), EFFECTS[effect].prior_odds * SIZE_PRIOR.arbitrary)
    return plausibility(params, effect)


def fitted_prior(
    fit: Fit, effect: str, gravity: Sequence[float], constants: RigConstants, *, inflation: float, penalty: float
) -> float:
    """Return the prior weight of a fitted effect; for a spring, that of its simplest adequate form.

    If the amplitudes d with the covariance D are removed, chi2 increases by the inflation times d^T D^-1 d, the penalty
    decreases, and the stiffness k becomes k - cov(k, d) D^-1 d.

    Args:
        fit: fit of the set with the effect
        effect: name of the effect
        gravity: gravity torques about joints 1 and 2, N m
        constants: encoders of the rig
        inflation: variance inflation of the fit
        penalty: penalty of an amplitude, in chi2 of independent readings
    """
    params = fit.estimate.params
    weight = size_prior(params, effect, gravity, constants)
    free = {parameter.name: i for i, parameter in enumerate(fit.free) if parameter.effect == effect}
    if effect not in SPRINGS or (stiffness := EFFECTS[effect].adds) not in free:
        return weight
    covariance, k, values = considered(fit, inflation), free.pop(stiffness), fit.values
    for needless in chain.from_iterable(combinations(free, n) for n in range(1, len(free) + 1)):
        rows = [free[name] for name in needless]
        moved = np.linalg.pinv(covariance[np.ix_(rows, rows)], hermitian=True) @ values[rows]
        simpler = params.copy()
        simpler[[param_index(effect, name) for name in needless]] = 0.0
        simpler[param_index(effect, stiffness)] -= covariance[k, rows] @ moved
        at_bound = any(covariance[row, row] == 0.0 != values[row] for row in rows)
        if simpler[param_index(effect, stiffness)] > 0.0 and not at_bound:
            saved = (penalty * len(rows) - max(values[rows] @ moved, 0.0)) / CALIBRATION.unit(1.0)
            weight = max(weight, size_prior(simpler, effect, gravity, constants) * math.exp(saved))
    return weight


def _scale(excess: float, configured: float) -> float:
    """Return the prior weight of a relative scale error; `configured` is the counts per turn of the rig file."""
    usual = usual_counts(abs(configured) * (1.0 + excess))
    other = usual is not None and usual != usual_counts(abs(configured))
    within = 1.0 / (1.0 + (excess / SIZE_PRIOR.tolerance) ** 4)
    return max(within, SIZE_PRIOR.other_encoder if other else SIZE_PRIOR.arbitrary)
