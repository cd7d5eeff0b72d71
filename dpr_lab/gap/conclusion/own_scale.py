"""Sizes of a selection at the inertia b that follows from the ratios of the selected set.

During the search, sizes refer to the b of the bare model. An effect changes the ratios, and measured masses and lengths
then give another b. The readings do not change if every parameter proportional to b^k is multiplied by the k-th power
of the change of b. The fits and score tests are therefore converted without a further fit. For load-dependent friction
this is an approximation: with a change of b by 5 %, its influence on the readings changes by at most 1.2 %.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.effects import EFFECTS, param_index
from dpr_lab.fitting.estimate import EFFECTS_BEGIN, SCALE, Estimate, FreeParameter
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.linearise import Linearisation
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.conclusion.ratios import rig_posterior
from dpr_lab.gap.conclusion.uncertainty import covariance
from dpr_lab.gap.hypothesis.detectable import detectable
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest
from dpr_lab.gap.which.selected import Selection
from dpr_lab.rig import Rig

T = TypeVar("T")


def at_own_scale(selection: Selection, problem: Problem, rig: Rig) -> Selection:
    """Convert the sizes of all sets to the b that measured values and the ratios of the selected set determine.

    The selection is unchanged if the recordings determine b, or if measured values do not.
    """
    fit = selection.chosen.fit
    if _fits_scale(fit.free) or any(setup.torques or setup.arm_moves for setup in problem.segments.setups):
        return selection
    scale = rig_posterior(problem, fit, covariance(problem, selection.chosen, rig), rig).scale()
    if not scale.known:
        return selection
    change = scale.b / float(fit.estimate.ratios[SCALE])
    factors = np.ones(len(fit.estimate.vector))
    factors[SCALE] = change
    for name, effect in EFFECTS.items():
        for parameter in effect.parameters:
            factors[EFFECTS_BEGIN + param_index(name, parameter.name)] = change**parameter.scale_power
    return _Conversion(factors).selection(selection)


def _fits_scale(free: tuple[FreeParameter, ...]) -> bool:
    return any(parameter.place == SCALE for parameter in free)


@dataclass(frozen=True, slots=True)
class _Conversion:
    """Conversion of fits and score tests; each object is converted once, so that shared objects remain shared."""

    factors: Array
    """(n,) factor of each entry of `Estimate.vector`."""
    _done: dict[int, Any] = field(default_factory=dict)

    def selection(self, selection: Selection) -> Selection:
        """Convert all sets and score tests."""
        chosen, final_test = self.model(selection.chosen), self.test(selection.final_test)
        return replace(
            selection,
            bare=self.model(selection.bare),
            chosen=chosen,
            fitted={key: self.model(model) for key, model in selection.fitted.items()},
            final_test=final_test,
            detectable=detectable(chosen, final_test),
            without={name: self.model(model) for name, model in selection.without.items()},
            without_substitute={name: self.model(model) for name, model in selection.without_substitute.items()},
            tests_without={name: self.test(test) for name, test in selection.tests_without.items()},
            path=tuple((name, self.model(model)) for name, model in selection.path),
        )

    def model(self, model: Hypothesis) -> Hypothesis:
        """Convert a set."""
        return self._once(model, lambda: replace(model, fit=self._fit(model.fit)))

    def test(self, test: ScoreTest) -> ScoreTest:
        """Convert a score test."""
        return self._once(test, lambda: self._test(test))

    def _test(self, test: ScoreTest) -> ScoreTest:
        free, per = self._free(test.free), self._of(test.free)
        prior = test.prior
        return replace(
            test,
            fit=self._fit(test.fit),
            linear=self._linear(test.linear, per),
            free=free,
            space=replace(test.space, scale=test.space.scale * per),
            prior=replace(prior, estimate=self._estimate(prior.estimate), free=free, A=prior.A / per),
            ranking=tuple(map(self._score, test.ranking)),
            shaped={name: tuple(map(self._score, scores)) for name, scores in test.shaped.items()},
        )

    def _score(self, score: Score) -> Score:
        sizes = score.amplitudes * self._of(score.free[len(score.free) - len(score.amplitudes) :])
        return self._once(score, lambda: replace(score, free=self._free(score.free), amplitudes=sizes))

    def _fit(self, fit: Fit) -> Fit:
        if _fits_scale(fit.free):  # b of this set follows from load-dependent friction
            return fit
        per = self._of(fit.free)
        return self._once(
            fit,
            lambda: replace(
                fit,
                estimate=self._estimate(fit.estimate),
                free=self._free(fit.free),
                linear=self._linear(fit.linear, per),
                prior=fit.prior / per if fit.prior.size else fit.prior,
            ),
        )

    def _estimate(self, estimate: Estimate) -> Estimate:
        return replace(estimate, vector=estimate.vector * self.factors)

    def _free(self, free: tuple[FreeParameter, ...]) -> tuple[FreeParameter, ...]:
        return tuple(map(self._parameter, free))

    def _parameter(self, parameter: FreeParameter) -> FreeParameter:
        factor = float(self.factors[parameter.place])
        return replace(
            parameter,
            step=factor * parameter.step,
            lower=factor * parameter.lower,
            upper=factor * parameter.upper,
            size=factor * parameter.size,
            overrides=tuple((place, float(self.factors[place]) * value) for place, value in parameter.overrides),
        )

    def _of(self, free: tuple[FreeParameter, ...]) -> Array:
        return self.factors[[parameter.place for parameter in free]]

    @staticmethod
    def _linear(linear: Linearisation, per: Array) -> Linearisation:
        coefficients = linear.initial_state_coefficients / per
        return replace(linear, A=linear.A / per, initial_state_coefficients=coefficients)

    def _once(self, converted: T, conversion: Callable[[], T]) -> T:
        if id(converted) not in self._done:
            self._done[id(converted)] = conversion()
        return self._done[id(converted)]
