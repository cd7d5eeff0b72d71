"""Sizes of a selection at the inertia b that follows from the ratios of the selected set.

During the search, sizes refer to the b of the bare model. An effect changes the ratios, from which measured masses and
lengths give another b. If b changes by a factor and every parameter proportional to b^k by its k-th power, the readings
stay the same. The fits and score tests are therefore converted without a further fit. For load-dependent friction this
is an approximation: if b changes by 5 %, the influence of this friction on the readings changes by at most 1.2 %.
"""

from collections.abc import Mapping
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
    """Convert the sizes of all sets to the inertia b that follows from measured values.

    The ratios of the selected set convert the measured values to b. The selection is returned unchanged if the
    recordings already determine b, or if the measured values do not determine it.
    """
    fit = selection.chosen.fit
    if _fits_scale(fit) or any(setup.torques for setup in problem.segments.setups):
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
    converted = _Conversion(factors)
    chosen, final_test = converted(selection.chosen), converted(selection.final_test)
    return replace(
        selection,
        bare=converted(selection.bare),
        chosen=chosen,
        fitted=converted(selection.fitted),
        final_test=final_test,
        detectable=detectable(chosen, final_test),
        without=converted(selection.without),
        without_substitute=converted(selection.without_substitute),
        tests_without=converted(selection.tests_without),
        path=converted(selection.path),
    )


def _fits_scale(fit: Fit) -> bool:
    return any(parameter.place == SCALE for parameter in fit.free)


@dataclass(frozen=True, slots=True)
class _Conversion:
    """Conversion of sets, score tests and their parts to another b."""

    factors: Array
    """(n,) factor of each entry of `Estimate.vector`."""
    _results: dict[int, Any] = field(default_factory=dict)
    """Converted objects by the identity of the original, so that shared objects remain shared."""

    def __call__(self, value: T) -> T:
        """Return a value converted with all its parts; parts that do not depend on b stay unchanged."""
        if id(value) not in self._results:
            self._results[id(value)] = self._converted(value)
        return self._results[id(value)]

    def _converted(self, value: Any) -> Any:
        match value:
            case Mapping():
                return {key: self(part) for key, part in value.items()}
            case tuple():
                return tuple(self(part) for part in value)
            case Estimate():
                return replace(value, vector=value.vector * self.factors)
            case FreeParameter():
                return self._parameter(value)
            case Hypothesis():
                return replace(value, fit=self(value.fit))
            case Fit() if not _fits_scale(value):  # otherwise load-dependent friction determines b of this set
                prior = value.prior / self._units(value.free) if value.prior.size else value.prior
                linear = self._linear(value.linear, value.free)
                return replace(value, estimate=self(value.estimate), free=self(value.free), linear=linear, prior=prior)
            case ScoreTest():
                return self._test(value)
            case Score():
                sizes = value.amplitudes * self._units(value.free)[len(value.free) - len(value.amplitudes) :]
                return replace(value, free=self(value.free), amplitudes=sizes)
        return value

    def _test(self, test: ScoreTest) -> ScoreTest:
        units, free, prior = self._units(test.free), self(test.free), test.prior
        return replace(
            test,
            fit=self(test.fit),
            linear=self._linear(test.linear, test.free),
            free=free,
            space=replace(test.space, scale=test.space.scale * units),
            prior=replace(prior, estimate=self(prior.estimate), free=free, A=prior.A / units),
            ranking=self(test.ranking),
            shaped=self(test.shaped),
        )

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

    def _units(self, free: tuple[FreeParameter, ...]) -> Array:
        """Return the (free,) factors of the parameters `free`."""
        return self.factors[[parameter.place for parameter in free]]

    def _linear(self, linear: Linearisation, free: tuple[FreeParameter, ...]) -> Linearisation:
        """Convert derivatives with respect to the parameters `free` to the other value of b."""
        units = self._units(free)
        coefficients = linear.initial_state_coefficients / units
        return replace(linear, A=linear.A / units, initial_state_coefficients=coefficients)
