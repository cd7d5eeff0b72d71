"""Amplitude that a bench measurement should give if the measured effect is the cause."""

from collections.abc import Sequence

import numpy as np

from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.covariance import considered
from dpr_lab.fitting.estimate import FreeParameter
from dpr_lab.gap.advice.measurement import CHECK, magnitude
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest
from dpr_lab.gap.result.checks import AdvisedCheck
from dpr_lab.gap.result.saved import Interval
from dpr_lab.gap.which.selected import Selection
from dpr_lab.identification.scaling.scale import Scale


def expected_size(selection: Selection, scale: Scale, check: AdvisedCheck) -> Interval | None:
    """Return the value that a measurement should give if its effect is the cause, with a 90 % interval.

    The value comes from the fit in which this effect replaces the named effect. If no such fit exists, the value comes
    from the score test.

    Args:
        selection: all fitted sets
        scale: inertia b that absolute sizes assume; its uncertainty widens the interval
        check: the check

    Returns:
        the expected value; None if the check is a recording, if the value is zero, or if an amplitude is not determined
    """
    if check.quantity is None or check.about not in selection.without:
        return None
    size = _size(selection, check, check.quantity.parameters)
    power = check.amplitudes[0].scale_power
    return size and Interval(value=size.value, interval90=scale.absolute90(size.value, size.interval90, power))


def _size(selection: Selection, check: AdvisedCheck, names: tuple[str, ...]) -> Interval | None:
    key = selection.without[check.about].key | {check.measures}
    fitted = selection.chosen if check.measures in selection.chosen.key else selection.fitted.get(key)
    if fitted is not None:
        return _of_fit(fitted, check.measures, names)
    test = selection.tests_without[check.about]
    score = test.best_score(check.measures)
    return _of_score(test, score, selection.chosen, names) if score else None


def _of_fit(fitted: Hypothesis, effect: str, names: tuple[str, ...]) -> Interval | None:
    free = fitted.fit.free
    places = _places(free, effect, names)
    if not places:
        return None
    covariance = considered(fitted.fit, fitted.inflation)[np.ix_(places, places)]
    return magnitude(np.array([free[i].read(fitted.estimate) for i in places]), NORMAL_Q90**2 * covariance)


def _places(parameters: Sequence[FreeParameter], effect: str, names: tuple[str, ...]) -> list[int]:
    """Return the columns of the named amplitudes of an effect.

    The list is empty unless all of these amplitudes are fitted. Amplitudes that base parameters absorb are not fitted.
    """
    places = {parameter.name: place for place, parameter in enumerate(parameters) if parameter.effect == effect}
    return [places[name] for name in names] if places.keys() >= set(names) else []


def _of_score(test: ScoreTest, score: Score, chosen: Hypothesis, names: tuple[str, ...]) -> Interval | None:
    places = _places([test.free[column] for column in score.columns], score.effect.name, names)
    if not places:
        return None
    covariance = test.projected(score.columns).covariance()[np.ix_(places, places)] * chosen.inflation
    covariance = covariance + np.diag((CHECK.linear_error * score.amplitudes[places]) ** 2)
    return magnitude(score.amplitudes[places], NORMAL_Q90**2 * covariance)
