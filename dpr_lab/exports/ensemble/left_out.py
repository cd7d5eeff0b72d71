"""Estimate the width of an ensemble by leave-one-out cross-validation over the fitted recordings.

Models predict the recordings to which they were fitted better than further recordings. The residuals of the fitted
recordings therefore cannot show that the models are incomplete. For each recording r, models are drawn around the
values that are fitted without r (`PosteriorComponent.left_out`). Without one of R recordings, the variance of the
errors of a model is R / (R - 1) times as large as with all recordings (the jackknife). The covariance is therefore
multiplied by this factor. m and w are the middle and the half width of the 90 % band of these models, y are the
readings, and z is the normal quantile of the band. The quantity

    v = median(s_r) / median(chi2_q / q),    s_r = mean (z (y - m) / w)^2

is the ratio of the variance of the errors to the variance of the band. v is 1 if the posterior is correct. chi2_q has q
degrees of freedom, because a recording has about q independent errors. The median is insensitive to a single recording
that differs strongly from the others. If v does not exceed 1 by more than its random scatter, the posterior is not
changed. Otherwise the standard deviations are multiplied by

    t / z ((n + R v) / (n + R))^(1/2),    t = quantile of Student's distribution with n + R degrees of freedom.

Student's distribution is used because the variance is estimated from only R recordings. The prior expectation is v = 1,
and its weight is equal to that of n recordings.

Source: Student (1908), The probable error of a mean, Biometrika 6, 1-25; M. Stone (1974), Cross-validatory choice and
assessment of statistical predictions, Journal of the Royal Statistical Society B 36, 111-147; R. G. Miller (1974), The
jackknife: a review, Biometrika 61, 1-15.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri, stdtrit

from dpr_lab.errors import RunError
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.exports.ensemble.bands import BANDS, PredictiveBand, predictive_band
from dpr_lab.exports.ensemble.sampled import sampled_models
from dpr_lab.gap.result.posterior import PosteriorComponent
from dpr_lab.identification.model import Model
from dpr_lab.rig import Rig
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class LeftOutSettings:
    """Settings for estimating the width of an ensemble."""

    members: int = 39
    """Number of models for each recording. The band lies between their second smallest and second largest values."""
    expected: float = 1.0
    """Weight of the expectation that the posterior is correct, as a number of recordings: n."""
    independent: int = 3
    """Number of independent errors of a recording: q. It is between 1 (an error of one parameter) and 11, the estimate
    from the scatter of s over 21 recordings of simulated rigs."""
    fewest: int = 3
    """Minimum number of recordings from which the width is estimated."""
    chance: float = 1.5
    """Maximum v for which the posterior is kept: 1 plus the standard deviation sqrt(2 / 9) of v for three recordings
    with three independent errors each."""


LEFT_OUT = LeftOutSettings()


def factor_without(
    model: Model, components: Sequence[PosteriorComponent], runs: Sequence[Run], rig: Rig, seed: int
) -> float:
    """Estimate the factor on the standard deviations of the posterior by leave-one-out cross-validation.

    The factor is 1 if there are too few runs, or if the posterior does not contain the fits without each run.

    Args:
        model: the corrected model
        components: posterior of the model
        runs: the fitted recordings, in the order of the posterior's `left_out`
        rig: rig of the recordings
        seed: seed of the random models
    """
    if len(runs) < LEFT_OUT.fewest or any(len(component.left_out) != len(runs) for component in components):
        return 1.0
    errors = []
    for place, run in enumerate(runs):
        members = sampled_models(model, without(components, place), LEFT_OUT.members, seed)
        try:
            errors.append(_squared_errors(predictive_band(model, members, run, rig, seed)))
        except RunError:  # no initial state fits this recording
            continue
    return widening([error for error in errors if np.isfinite(error)])


def without(components: Sequence[PosteriorComponent], place: int) -> list[PosteriorComponent]:
    """Return the posterior of the fit without one recording.

    Its covariances are multiplied by R / (R - 1), where R is the number of recordings.
    """
    return [_without(component, place) for component in components]


def widening(errors: Sequence[float]) -> float:
    """Compute the widening factor of the standard deviations.

    `errors` contains the mean squared standardised error of each recording.
    """
    if not errors:
        return 1.0
    variance = float(np.median(errors) * LEFT_OUT.independent / chdtri(LEFT_OUT.independent, 0.5))
    if variance <= LEFT_OUT.chance:
        return 1.0
    count = LEFT_OUT.expected + len(errors)
    pooled = (LEFT_OUT.expected + len(errors) * variance) / count
    return float(pooled**0.5 * stdtrit(count, (1 + BANDS.level) / 2) / NORMAL_Q90)


def _without(component: PosteriorComponent, place: int) -> PosteriorComponent:
    """Return a component of the posterior of the fit without one recording."""
    recordings = len(component.left_out)
    values = dict(zip(component.free, component.left_out[place], strict=True))
    of_effects = {name: value for name, value in values.items() if name not in component.ratios}
    effects = {name: dict(parameters) for name, parameters in component.effects.items()}
    for name, value in of_effects.items():
        effect, _, parameter = name.partition(".")
        effects.setdefault(effect, {})[parameter] = value
    wider = recordings / (recordings - 1)
    return component.model_copy(
        update={
            "ratios": {name: values.get(name, value) for name, value in component.ratios.items()},
            "effects": effects,
            "covariance": (wider * np.array(component.covariance)).tolist(),
            "between": (wider * np.array(component.between)).tolist(),
        }
    )


def _squared_errors(band: PredictiveBand) -> float:
    """Compute the mean squared error of a recording, in standard deviations of the band.

    The result is nan if there are no readings.
    """
    middle, half = (band.low + band.high) / 2, (band.high - band.low) / 2
    errors = (NORMAL_Q90 * (band.measured - middle) / half)[np.isfinite(band.measured)]
    return float(np.mean(errors**2)) if len(errors) else float("nan")
