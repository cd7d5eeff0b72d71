"""Hypothesis: a set of effects, fitted together with ratios and initial states, and its cost."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.friction_drift import FRICTION_DRIFT
from dpr_lab.effects.limits import relative_size
from dpr_lab.fitting.estimate import Estimate, FreeParameter, effect_parameters, ratio_parameters, visible_ratios
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.cross_validation import folds, predictive_loss
from dpr_lab.gap.hypothesis.residuals import ResidualStatistics, residual_statistics
from dpr_lab.gap.hypothesis.size_prior import fitted_prior, gravity_torques
from dpr_lab.gap.hypothesis.swing_lines import on_swing_line, one_decay
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS


@dataclass(frozen=True, slots=True)
class Penalty:
    """Penalty of the parameters of a set of effects, in chi2 units."""

    parameter: float = 9.0
    """Penalty of one parameter: the logarithm of the number of samples, about 1e4 (BIC)."""
    curve: int = 3
    """Minimum number of amplitudes of an effect that counts as a curve. On a small arc, a curve can imitate a sum of
    other effects."""
    ordinary: float = 0.1
    """Maximum size s0 of a curve without an additional penalty: a typical eccentricity."""


PENALTY = Penalty()


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """A set of effects with its fit and its residuals."""

    effects: tuple[str, ...]
    fit: Fit
    residuals: ResidualStatistics
    predictive_loss: float
    """Predictive loss in units of chi2: each run, or each quarter of a single run, is predicted from the others."""
    curves: Mapping[str, float]
    """Size s of each curve in the set, dimensionless: the rms of its amplitudes, each divided by its limit."""
    harmonic_vibrations: frozenset[str] = frozenset()
    """Vibrations in the set at a multiple of the swing's frequency."""
    decay_drifts: frozenset[str] = frozenset()
    """Friction drifts in the set if the recordings are a single decay, in which amplitude and time are inseparable."""
    priors: Mapping[str, float] = field(default_factory=dict)
    """Prior weight of each effect with its fitted size (`fitted_prior`)."""

    @property
    def cost(self) -> float:
        """Selection criterion: predictive loss plus variance inflation times penalty."""
        return self.cost_at(self.inflation)

    def cost_at(self, inflation: float) -> float:
        """Return the cost with a given variance inflation, for example that of another set.

        With the inflation of another set, the residual of that set is treated as noise.
        """
        return self.predictive_loss + inflation * self.penalty

    @property
    def parameters(self) -> int:
        """Number of free parameters and of shape parameters."""
        return len(self.fit.free) + sum(len(EFFECTS[name].shapes) for name in self.effects)

    @property
    def penalty(self) -> float:
        """Penalty of the parameters, in chi2 of independent readings.

        A curve of n amplitudes whose size s exceeds s0 (`PENALTY.ordinary`) has the additional penalty 2 n ln(s / s0).
        This corresponds to a prior density of the amplitudes proportional to s^-n. It is necessary because a curve with
        large amplitudes that cancel each other can imitate other effects.
        """
        penalty = PENALTY.parameter * self.parameters
        for name, size in self.curves.items():
            penalty += 2 * len(EFFECTS[name].amplitudes) * float(np.log(max(size / PENALTY.ordinary, 1.0)))
        return penalty

    @property
    def estimate(self) -> Estimate:
        """Fitted values of all unknowns."""
        return self.fit.estimate

    @property
    def inflation(self) -> float:
        """Variance inflation n / n_eff, the mean chi2 per independent reading."""
        return self.residuals.inflation

    @property
    def chance(self) -> float:
        """Maximum reduction of chi2 that is attributed to chance."""
        return THRESHOLDS.chance * self.inflation

    @property
    def bounded_excess(self) -> float:
        """Excess chi-square, at least `THRESHOLDS.noise_floor` standard deviations for noise alone."""
        return max(self.residuals.excess, THRESHOLDS.noise_floor * self.residuals.uncertainty)

    @property
    def at_noise_floor(self) -> bool:
        """Whether the residual is consistent with noise."""
        return self.residuals.z < THRESHOLDS.noise_floor

    @property
    def far_from_noise(self) -> bool:
        """Whether the residual is so large that linear scores are only approximate."""
        return self.residuals.chi2 > THRESHOLDS.far * self.residuals.dof

    @property
    def key(self) -> frozenset[str]:
        """Names of the effects, as a set."""
        return frozenset(self.effects)


def hypothesis(problem: Problem, effects: Iterable[str], fitted: Fit) -> Hypothesis:
    """Compute the residual statistics and the cost of a fit."""
    residuals = residual_statistics(problem, fitted)
    names, loss = tuple(effects), predictive_loss(fitted, folds(problem), residuals.inflation)
    curves = [name for name in names if len(EFFECTS[name].amplitudes) >= PENALTY.curve]
    params, limits = fitted.estimate.params, problem.limits
    sizes = {} if limits is None else {name: relative_size(params, limits, name) for name in curves}
    harmonic_vibrations = frozenset(name for name in names if on_swing_line(problem, name, fitted.estimate))
    drifts = frozenset(names) & {effect.name for effect in FRICTION_DRIFT} if one_decay(problem) else frozenset[str]()
    cost = {"inflation": residuals.inflation, "penalty": PENALTY.parameter}
    gravity, constants = gravity_torques(problem, fitted.estimate), problem.model.constants
    priors = {name: fitted_prior(fitted, name, gravity, constants, **cost) for name in names}
    return Hypothesis(names, fitted, residuals, loss, sizes, harmonic_vibrations, drifts, priors)


def explained(bare: Hypothesis, model: Hypothesis) -> float:
    """Return the reduction of the bare model's excess chi-square by a set of effects."""
    return bare.bounded_excess - model.bounded_excess


def log_prior_ratio(model: Hypothesis, current: Hypothesis) -> float:
    """Return the logarithm of the ratio of the prior weights of two sets, at their fitted sizes.

    It is zero for sets of different size, which are compared by the penalty of their parameters.
    """
    if len(model.effects) != len(current.effects):
        return 0.0
    return _log_prior(model) - _log_prior(current)


def _log_prior(model: Hypothesis) -> float:
    return sum(math.log(model.priors[name]) for name in model.effects)


def refutes_torque_noise(problem: Problem, model: Hypothesis) -> bool:
    """Return whether the residual far exceeds the noise of readings and known torques."""
    return problem.disturbance is not None and model.far_from_noise


def scale_visible(effects: Iterable[str], problem: Problem) -> bool:
    """Return whether b is identifiable, from known torques, an added mass, or load-dependent friction."""
    weighs = problem.masses_weighed and any(EFFECTS[name].stage == "load" for name in effects)
    return weighs or any(setup.weighs for setup in problem.segments.setups)


def free_parameters(estimate: Estimate, effects: Sequence[str], problem: Problem) -> tuple[FreeParameter, ...]:
    """Return the free parameters of a fit: ratios, b if it is identifiable, and parameters of all effects."""
    names = dict.fromkeys((*problem.always, *effects))
    visible = visible_ratios(problem.segments.setups, scale_visible(effects, problem))
    limits = problem.limits
    of_effects = (p for name in names for p in effect_parameters(EFFECTS[name], refined=True, limits=limits))
    return (*ratio_parameters(estimate, visible), *of_effects)
