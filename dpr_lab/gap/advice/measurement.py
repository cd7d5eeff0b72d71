"""Predictive density of a measured amplitude under each candidate cause and under a cause outside the candidates.

A measurement gives a value y with the standard uncertainty u for an amplitude of one effect. The recordings predict
this amplitude. If the effect is the cause, the amplitude is the fitted size s with the standard deviation w. If another
candidate is the cause, the amplitude is a small background with the standard deviation b. If the cause is outside the
candidates, the amplitude is either the background or of any plausible size. This size has a Cauchy density of scale c,
which is proper and decreases slowly:

    f(y | effect)     = N(y; s, w^2 + (m s)^2 + u^2)
    f(y | other)      = N(y; 0, b^2 + u^2),                               b = m' min(t, |s|)
    f(y | outside)    = (1 - h) N(y; 0, b^2 + u^2) + h V(y; u, c),         c = k max(t, |s|)

with t the typical size of the amplitude, V the Cauchy density convolved with the normal density of the measurement (the
Voigt profile), and m, m', h, k of `CheckSettings`. The densities stay broad even if u is very small, because w, m s and
b remain. If a size depends on the scale b of torques and inertias, w contains the uncertainty of that scale. This is
equation (59) of docs/theory.md.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.effects import EFFECTS
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.gap.result.checks import NONE_OF_THEM, AdvisedCheck
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.saved import Interval


@dataclass(frozen=True, slots=True)
class CheckSettings:
    """Settings of the update of probabilities by a check."""

    model_error: float = 0.1
    """m: relative standard deviation of a fitted amplitude, in addition to the standard deviation of the fit.

    It covers the difference between the law of the effect and the bench measurement, and an error of the torque scale
    that is not larger. The value is assumed.
    """
    linear_error: float = 0.3
    """Additional relative standard deviation of an amplitude from a linear score test; the value is assumed."""
    background: float = 0.1
    """m': standard deviation of an amplitude whose effect is not the cause, relative to min(t, |s|).

    Every rig has a small amount of every effect. A tenth of the size that explains the gap causes 1 % of the excess
    chi-square. The value is assumed.
    """
    broad: float = 3.0
    """k: scale c of an amplitude that no fit predicts, relative to max(t, |s|).

    The typical size t is that of laboratory rigs. A Cauchy density of scale 3 t has 20 % of its probability beyond 9 t.
    """
    elsewhere: float = 0.5
    """h: probability that the measured amplitude differs from the background if the cause is outside the candidates.

    Nothing is known about such a cause, so both cases have the probability one half (principle of indifference).
    """
    questioned: float = 3.0
    """Distance from the nearest prediction beyond which a value is doubtful, in standard deviations.

    By chance, one correct value in 370 is farther away.
    """
    undetermined: float = 3.0
    """Ratio to the largest fitted size with the same unit above which a measured value is doubtful.

    The rule applies if the recordings do not determine the measured quantity. Friction at rest, for example, is at most
    about twice the friction of sliding. The value is assumed.
    """
    largest: float = 1e6
    """Maximum accepted value and uncertainty, in units of the larger of typical and fitted size."""
    largest_power: float = 6.0
    """Decimal logarithm of a Bayes factor beyond which only a bound is stated.

    The tail of the normal distribution does not describe such improbable results.
    """
    dropped: float = 0.01
    """Minimum probability of a member that stays in its class, relative to the probability of the class."""
    iterations: int = 20
    """Maximum number of iterations of a fit to new recordings."""


CHECK = CheckSettings()


@dataclass(frozen=True, slots=True)
class Prediction:
    """Normal distribution that one cause predicts for a measured amplitude."""

    mean: float
    std: float

    def z(self, value: float, std: float) -> float:
        """Return the distance between a measured value and the prediction, in standard deviations."""
        return abs(value - self.mean) / float(np.hypot(self.std, std))

    def log_density(self, value: float, std: float) -> float:
        """Return the logarithm of the predictive density of a value with a standard uncertainty."""
        spread = float(np.hypot(self.std, std))
        return -0.5 * self.z(value, std) ** 2 - float(np.log(spread * np.sqrt(2 * np.pi)))


@dataclass(frozen=True, slots=True)
class Predictions:
    """Predictive densities of a measured amplitude, in the SI unit of the amplitude."""

    candidates: Mapping[str, Prediction]
    background: Prediction
    """Prediction if the measured effect is not the cause."""
    scale: float
    """Scale c of the amplitude under a cause outside the candidates."""
    largest: float
    """Largest value and largest uncertainty that are accepted."""
    estimate: Interval | None
    """Value that the recordings predict, with its interval, if the measured effect is the cause."""

    def log_densities(self, value: float, std: float) -> dict[str, float]:
        """Return the log predictive density under each candidate and under an outside cause."""
        from scipy.special import voigt_profile  # its import is slow

        densities = {name: prediction.log_density(value, std) for name, prediction in self.candidates.items()}
        broad = float(np.log(voigt_profile(value / self.scale, std / self.scale, 1.0) / self.scale))
        little = self.background.log_density(value, std)
        h = CHECK.elsewhere
        return densities | {NONE_OF_THEM: float(np.logaddexp(np.log1p(-h) + little, np.log(h) + broad))}

    def nearest(self, value: float, std: float) -> float:
        """Return the distance of a measured value from the nearest prediction, in standard deviations."""
        return min(prediction.z(value, std) for prediction in self.candidates.values())


def predictions(diagnosis: Diagnosis, check: AdvisedCheck, names: Iterable[str]) -> Predictions:
    """Return the predictive densities of the amplitude that a check measures, for each candidate.

    Args:
        diagnosis: diagnosis with the fitted sizes
        check: a measurement
        names: the candidates
    """
    typical, estimate = check.amplitudes[0].typical, estimate_of(diagnosis, check)
    size = abs(estimate.value) if estimate else typical
    background = Prediction(0.0, CHECK.background * min(typical, size))
    present = Prediction(0.0, CHECK.broad * typical)
    if estimate:
        low, high = estimate.interval90
        fitted = (high - low) / 2 / NORMAL_Q90
        present = Prediction(estimate.value, float(np.hypot(fitted, CHECK.model_error * estimate.value)))
    largest = max(typical, size)
    return Predictions(
        {name: present if has(name, check.measures, check.amplitudes[0].name) else background for name in names},
        background,
        CHECK.broad * largest,
        CHECK.largest * largest,
        estimate,
    )


def estimate_of(diagnosis: Diagnosis, check: AdvisedCheck) -> Interval | None:
    """Return the amplitude that a check should give if its effect is the cause; None without a fit."""
    if check.expected:
        return check.expected
    fitted = next((effect.parameters for effect in diagnosis.effects if effect.name == check.measures), {})
    names = [amplitude.name for amplitude in check.amplitudes]
    if not {*names} <= {*fitted}:
        return None
    values = np.array([fitted[name].value for name in names])
    ends = [fitted[name].interval90_with_scale or fitted[name].interval90 for name in names]
    half_width = np.array([(high - low) / 2 for low, high in ends])
    return magnitude(values, np.diag(half_width**2))


def excluded_size(diagnosis: Diagnosis, check: AdvisedCheck) -> float | None:
    """Return the excluded size of the measured amplitude, SI; None if the recordings exclude no size."""
    tested = diagnosis.evidence.exclusions if diagnosis.evidence else []
    names = tuple(amplitude.name for amplitude in check.amplitudes)
    sizes = (e.size for e in tested if e.is_excluded and e.effect == check.measures and (e.parameter,) == names)
    return next(sizes, None)


def magnitude(values: Array, covariance: Array) -> Interval | None:
    """Return the root of the sum of squared amplitudes, or a single amplitude; None if the value is zero.

    `covariance` is the covariance of the amplitudes times `NORMAL_Q90` squared, so that the interval covers 90 %.
    """
    if len(values) == 1:
        value, half_width = float(values[0]), float(np.sqrt(covariance[0, 0]))
    else:
        value = float(np.linalg.norm(values))
        slope = values / (value or 1.0)
        half_width = float(np.sqrt(slope @ covariance @ slope))
    return Interval.about(value, half_width) if value else None


def has(name: str, measured: str, amplitude: str) -> bool:
    """Return whether the effect `name` also has the amplitude `amplitude` of the effect `measured`.

    The forms of one effect share their amplitudes, except for the additional amplitude of a richer form.
    """
    if amplitude == EFFECTS[measured].adds and name in EFFECTS[measured].nested:
        return False
    return not {name, *EFFECTS[name].nested}.isdisjoint({measured, *EFFECTS[measured].nested})
