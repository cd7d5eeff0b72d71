"""Intervals of the fitted values in models with further effects that the recordings do not exclude.

An effect that is present but not named changes the fitted values: a small Coulomb friction, for example, increases the
viscous friction. An equivalence test must allow for such effects. The intervals are therefore also computed

- with each further effect whose posterior probability is at least `PROBABLE`. The odds of an effect against no further
  effect are q exp((G / f - p) / 2), with the predicted reduction G of chi2, the variance inflation f, the penalty p of
  the parameters (BIC), and the prior odds q relative to their mean
- with all common effects together (`Effect.common`). They are nearly collinear, so their separate estimates are not
  significant. The prior of each amplitude has the mean zero and the minimum detectable size as standard deviation.

Both computations are linear: chi2 and the values follow from the columns of the score test.

Sources: R. L. Berger (1982), Multiparameter hypothesis testing and acceptance sampling, Technometrics 24, 295-300.
R. E. Kass & A. E. Raftery (1995), Bayes factors, Journal of the American Statistical Association 90, 773-795.
"""

from collections.abc import Sequence

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.estimate import SCALE, alone_share
from dpr_lab.gap.hypothesis.detectable import SEEN
from dpr_lab.gap.hypothesis.hypothesis import PENALTY
from dpr_lab.gap.mounted_ratios import ratio_of
from dpr_lab.gap.result.causes import PROBABLE
from dpr_lab.gap.result.evidence import WiderModel
from dpr_lab.gap.state import Transferred
from dpr_lab.setup import only_inner


def wider_models(state: Transferred) -> list[WiderModel]:
    """Return the models with further effects that the recordings do not exclude."""
    selection = state.selection
    model, test = selection.chosen, selection.final_test
    scores = [score for score in test.ranking if score.effect.name not in model.effects]
    mean_odds = float(np.mean([score.effect.prior_odds for score in scores] or [1.0]))
    odds = np.zeros(len(scores))
    for i, score in enumerate(scores):
        penalty = PENALTY.parameter * (len(score.columns) + len(score.effect.shapes))
        odds[i] = score.effect.prior_odds / mean_odds * np.exp(min((score.gain / model.inflation - penalty) / 2, 100.0))
    probabilities = (odds / (1 + odds.sum())).tolist()
    models = [
        WiderModel(effects=[score.effect.name], probability=p, intervals90=intervals)
        for score, p in zip(scores, probabilities, strict=True)
        if p >= PROBABLE and (intervals := _intervals(state, score.columns))
    ]
    common = [
        (score.effect.name, column, size)
        for score in scores
        for column in (score.columns if score.effect.common else ())
        if (size := selection.detectable[score.effect.name][test.free[column].name])
    ]
    if common:
        names, columns, sizes = zip(*common, strict=True)
        models.append(WiderModel(effects=[*dict.fromkeys(names)], intervals90=_intervals(state, columns, sizes)))
    return models


def _intervals(state: Transferred, added: Sequence[int], stds: Sequence[float] = ()) -> dict[str, tuple[float, float]]:
    """Return the 90 % interval of each fitted ratio and amplitude, in a model with further amplitudes.

    A fitted inertia b, or a for the inner rod alone, has an interval too. The result is empty if the fitted values
    absorb a further amplitude.

    Args:
        state: the result of the selection
        added: columns of the further amplitudes in the score test
        stds: prior standard deviation of each further amplitude, with the prior mean zero; empty: no prior
    """
    selection, rig = state.selection, state.fitted.recordings.rig
    fit, inflation, test = selection.chosen.fit, selection.chosen.inflation, selection.final_test
    inside, columns = fit.inside, [*fit.inside, *added]
    prior = np.zeros((len(stds), len(columns)))
    prior[:, len(inside) :] = np.diag(inflation**0.5 / np.array(stds)) if stds else 0.0
    rows, e = np.vstack([test.prior.A[:, columns], prior]), np.append(test.prior.e, np.zeros(len(stds)))
    space = test.space.chosen(columns).with_prior(rows, e)
    covariance, step = space.covariance(), space.solution()
    if not (space.scale**2 / np.diag(covariance)).min() > SEEN:
        return {}
    before = test.space.chosen(inside).with_prior(test.prior.A[:, inside], test.prior.e).covariance()
    more: Array = inflation * np.maximum(np.diag(covariance)[: len(inside)] - np.diag(before), 0.0)
    half_widths = NORMAL_Q90 * np.sqrt(np.diag(state.covariance)[inside] + more)
    alone, intervals = only_inner(state.fitted.problem.segments.setups), dict[str, tuple[float, float]]()
    for place, change, half_width in zip(inside, step.tolist(), half_widths.tolist(), strict=False):
        parameter = fit.free[place]
        ratio = ratio_of(parameter, fit.estimate, rig, alone=alone)
        if parameter.block == "ratios" and parameter.place == SCALE:
            share = alone_share(fit.estimate.ratios) if alone else 1.0
            ratio = "a" if alone else "b", share * parameter.read(fit.estimate), 1.0 / share
        if ratio is None and not parameter.amplitude:
            continue
        name, value, per = ratio or (f"{parameter.effect}.{parameter.name}", parameter.read(fit.estimate), 1.0)
        low, high = value + (change - half_width) / per, value + (change + half_width) / per
        intervals[name] = (max(low, 0.0), max(high, 0.0)) if parameter.lower == 0.0 else (low, high)
    return intervals
