"""Fits of other interpretations of recordings, compared with the fit of the given interpretation."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import RATIOS, whole_parameters
from dpr_lab.errors import RunError
from dpr_lab.estimation.noise import noise_floor
from dpr_lab.fitting.estimate import ON_ELBOW, SCALE, alone_share, unknown_ratios
from dpr_lab.fitting.gauss_newton import GAUSS_NEWTON, GaussNewton
from dpr_lab.identification.misread.energy import ENERGY, energy_remedy, energy_rise
from dpr_lab.identification.misread.readings import Misreading, arm_scales, listed_causes, other_zeros, readings
from dpr_lab.identification.preprocess import PreprocessedRun, preprocess
from dpr_lab.identification.ratio_fit import RatioFit, first_fit, short_fit
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.shown import percent


@dataclass(frozen=True, slots=True)
class MisreadSettings:
    """Thresholds for testing other interpretations of recordings."""

    looked_at_s: float = 5.0
    """Duration of the beginning of each run that is examined, s; it suffices to detect a wrong interpretation."""
    tried_s: float = 2.5
    """Duration of each run that is used in the test of other interpretations, s."""
    screened_s: float = 1.0
    """Duration of the part of the first run in a quick test of each interpretation, s.

    All runs are fitted only if the interpretation passes this test.
    """
    worse: float = 3.0
    """Maximum ratio of the reduced chi-square in a quick test to the limit for all runs.

    The ratio is above 1 because the noise of a part is estimated from fewer readings.
    """
    suspicious: float = 0.02
    """Residual, relative to the standard deviation of the angle, above which an interpretation is doubtful.

    With correct interpretations, it is up to 2e-4 for a simulated rig without effects, and was 0.002 and 0.065 for two
    rigs with much friction. With incorrect interpretations of a rig without effects, it is at least 0.05.
    """
    hopeless: float = 0.3
    """Maximum ratio of the residual to the standard deviation of the angle for a fit that follows the swing."""
    better: float = 10.0
    """Minimum factor by which chi2 must be smaller in another interpretation for the recordings to be refused."""
    better_hint: float = 5.0
    """Minimum factor by which another interpretation must reduce the excess of chi2 to be reported as a hint.

    The factor is up to 3 for correctly interpreted rods with an effect.
    """
    explained: float = 20.0
    """Maximum reduced chi-square of another interpretation that is not far better than the given one.

    The limit is needed because an incorrect interpretation may fit better by chance.
    """
    far_better: float = 1000.0
    """Factor by which the reduced chi-square of a far better interpretation is smaller."""
    spare: float = 1.05
    """Factor on the physical limits of the ratios, because fitted ratios are uncertain."""
    slow: float = 2.5
    """Period, relative to that of a point mass at the distance L1, above which a longer part of the run is examined."""
    rate_hz: float = 250.0
    """Sample rate for fits of other interpretations, Hz.

    Their differences are far above the noise, so that fewer samples suffice.
    """
    iterations: int = 20
    """Maximum number of iterations for another interpretation; the right one converges in ten."""
    thorough: int = 40
    """Maximum number of iterations for the given interpretation."""
    out_of_reach: float = 100.0
    """Ratio of the reduced chi-square to its limit above which a fit ends after a step of small reduction."""
    small_reduction: float = 0.1
    """Relative reduction of chi2 that counts as small. Twenty such reductions change chi2 by a factor of 8 only."""
    wrong_inertia: float = 300.0
    """Maximum factor between the inertia b of a fit and its value in the rig file.

    With a larger factor, the known torques are considered contradictory. Incorrect masses and unknown gears cause
    factors up to 100; an incorrect unit causes a factor of 1000.
    """


SETTINGS = MisreadSettings()


@dataclass(frozen=True, slots=True)
class DescriptionCheck:
    """Evidence against the description of recordings.

    The evidence comes from a test of other interpretations and from the energy of the rods.
    """

    tried: Sequence[tuple[Misreading, float]]
    """Other interpretations that explain the recordings better, best first.

    Each is paired with the share of the excess chi2 of the given interpretation that it removes.
    """
    energy_rise: float
    """Impossible increase of passive rods' energy, relative to its range; zero if there are other interpretations."""
    energy_remedy: str = ""
    """Probable cause of this increase on the rig, and how to correct it."""
    causes: str = ""
    """Mistakes that the other interpretations correct."""

    @property
    def sentence(self) -> str:
        """Probable mistake and its correction; empty without evidence against the description."""
        if self.tried:
            return (
                f"With another interpretation of the readings, a model without effects explains"
                f" {percent(self.tried[0][1], 1)} of the excess chi-square: {self.causes}."
            )
        if self.energy_rise < ENERGY.entering:
            return ""
        return (
            f"The energy of the rods rises by {percent(self.energy_rise)} of its range, which is impossible for"
            f" a passive rig with exact readings. {self.energy_remedy}"
        )


def check_description(runs: Sequence[Run], rig: Rig) -> DescriptionCheck:
    """Test other interpretations of recordings that the bare model fits poorly.

    Args:
        runs: runs with the given interpretation
        rig: rig of the recordings
    """
    # all interpretations are compared over the same short time, in which little model error accumulates
    first = min(_chi2(runs, rig, quick=quick) for quick in (False, True))
    before = max(first - 1, 1e-9)
    explained = better_readings(runs, rig, first, 1 + before / SETTINGS.better_hint)
    if not explained and all(_slowness(run, rig) > SETTINGS.slow for run in runs):
        # Segments of a slow motion contain little of the swing, so that unlikely masses fit them nearly as well.
        faster = [reading for reading in readings(rig) if reading.time_factor < 1.0]
        # this is rare, and fitting all other interpretations takes long
        if any(_explaining(faster, runs, rig, first, first)):
            paced = better_readings(runs, rig, first, first)
            explained = [(reading, ratio_fit) for reading, ratio_fit in paced if reading.time_factor < 1.0]
    if explained:
        tried = [(reading, float(1 - max(fit.chi2_per_dof - 1, 0.0) / before)) for reading, fit in explained]
        return DescriptionCheck(tried, 0.0, causes=listed_causes([reading for reading, _ in explained], runs))
    passive = np.isfinite(first) and all(run.inner is None for run in runs)
    rise = energy_rise(_preprocessed(runs, rig, SETTINGS.looked_at_s), rig) if passive else 0.0
    return DescriptionCheck((), rise, energy_remedy(runs, rig))


def _chi2(runs: Sequence[Run], rig: Rig, *, quick: bool) -> float:
    """Return the reduced chi-square of a fit as described, or inf if the runs contain no motion."""
    try:
        ratio_fit = fitted(runs, rig, quick=quick)
    except RunError:
        return np.inf
    return np.inf if ratio_fit is None else ratio_fit.chi2_per_dof


def better_readings(
    runs: Sequence[Run], rig: Rig, chi2_per_dof: float, limit: float
) -> list[tuple[Misreading, RatioFit]]:
    """Find other interpretations that explain the runs far better than the given interpretation, best first.

    An interpretation that is far worse than the best one is omitted.

    The values of chi2 are made comparable in two ways. If an interpretation slows down the times, segments of the same
    length contain less of the swing. The model error then accumulates less, and chi2 falls with the fourth power of the
    time. If an interpretation reduces the angles, the ratio of noise to swing may increase, so that chi2 is too small.
    chi2 is therefore compared at the same ratio of noise to swing.

    Args:
        runs: runs with the given interpretation
        rig: rig of the recordings
        chi2_per_dof: reduced chi-square of the rods with the given interpretation
        limit: reduced chi-square below which an interpretation explains the runs
    """
    good: list[tuple[Misreading, RatioFit]] = []
    # a free zero can also explain these mistakes
    for tried in ((*arm_scales(runs, rig), *readings(rig)), other_zeros(runs, rig)):
        good = good or list(_explaining(tried, runs, rig, chi2_per_dof, limit))
    good = sorted(good, key=lambda pair: pair[1].chi2_per_dof)
    return [pair for pair in good if pair[1].chi2_per_dof < SETTINGS.better * good[0][1].chi2_per_dof]


def _explaining(
    tried: Iterable[Misreading], runs: Sequence[Run], rig: Rig, chi2_per_dof: float, limit: float
) -> Iterator[tuple[Misreading, RatioFit]]:
    """Yield the interpretations `tried` that explain the runs far better, with their fits.

    An interpretation that leaves only noise is accepted even if the noise is large relative to the swing, for example
    with coarse readings of an arm. See `better_readings` for the other arguments.
    """
    better, limit = SETTINGS.better, max(min(SETTINGS.explained, limit), chi2_per_dof / SETTINGS.far_better)
    for reading, other in _otherwise(tried, runs, rig, limit):
        fits = residual(other) < SETTINGS.suspicious or other.chi2_per_dof < 1.0
        if fits and other.chi2_per_dof * _larger_noise(reading, runs, rig) ** 2 < max(limit, chi2_per_dof / better):
            yield reading, other


def _larger_noise(reading: Misreading, runs: Sequence[Run], rig: Rig) -> float:
    """Compute the factor by which a different interpretation increases the ratio of noise to swing.

    The result is the largest factor of all runs, and at least 1.
    """
    factors = [1.0]
    for run in runs:
        other = reading.read(run)
        if other is not None and reading.time_factor == 1.0:
            ratio, changed = _noise_of_swing(run, rig), _noise_of_swing(other, rig)
            factors.append(changed / ratio if ratio > 0.0 else 1.0)
    return max(factors)


def _noise_of_swing(run: Run, rig: Rig) -> float:
    """Return the ratio of the noise of joint 1 to the standard deviation of theta1."""
    spread = float(np.std(run.swing.theta[:, 1]))
    return float(noise_floor(run, rig).std_joint[0]) / max(spread, float(np.finfo(float).tiny))


def impossible(ratios: Array, rig: Rig) -> str:
    """Explain why no positive masses can have the ratios (5,), or return an empty text.

    The mass m2 of the outer rod has its centre of mass at the distance l2, and the mass M >= m2 hangs on the elbow.
    Therefore d = m2 l2 L1 > 0, b >= m2 l2^2, a >= M L1^2 and e1 >= M L1 g. It follows that a/b >= (d/b)^2 and e1/b >=
    (d/b)^2 g/L1.
    """
    a, d, e1, *_ = ratios.tolist()
    least = d * d / SETTINGS.spare
    if not np.isfinite(ratios).all() or min(a, d, e1) <= 0:
        values = ", ".join(f"{name} = {value:.3g}" for name, value in zip(RATIOS, ratios.tolist(), strict=True))
        return f"no positive masses give {values}"
    if a < least:
        return f"no positive masses give both a/b = {a:.3g} and d/b = {d:.3g}"
    if e1 < least * rig.g / rig.L1:
        return f"no positive masses give both e1/b = {e1:.3g} and d/b = {d:.3g} with L1 = {rig.L1:g} m"
    return ""


def impossible_scale(inertia: float, runs: Sequence[Run], rig: Rig) -> str:
    """Explain why the rig cannot have the fitted inertia b, kg m^2.

    The text is empty if the rig can have it. An incorrect unit of known torques changes only b, so the residual does
    not show it. Without known torques, the motion does not determine b, and only the sign of b can contradict the rig.
    """
    nominal = float(unknown_ratios(whole_parameters(rig.nominal, rig.L1, rig.g))[SCALE])
    known = any(run.torques is not None or run.arm_input is not None for run in runs)
    factor = SETTINGS.wrong_inertia if known else np.inf
    if nominal / factor < inertia < nominal * factor:
        return ""
    kind = "a negative" if inertia < 0 else "an impossibly small" if inertia < nominal else "an impossibly large"
    return (
        f"the known torques or masses are compatible only with {kind} inertia (b = {inertia:.3g} kg m^2; rig file:"
        f" {nominal:.3g})"
    )


def impossible_fit(ratio_fit: RatioFit, runs: Sequence[Run], rig: Rig) -> str:
    """Explain why the fitted ratios or the inertia b are impossible; the text is empty if they are possible."""
    unknown = ratio_fit.fit.estimate.ratios
    if all(run.mounting == "inner" for run in runs):
        weight = float(unknown[RATIOS.index("e1/b")] - unknown[ON_ELBOW] * rig.g / rig.L1) / alone_share(unknown)
        if weight < 0:
            return f"the weight of the rod acts upwards (e1/a = {weight:.3g} 1/s^2)"
    return impossible(ratio_fit.ratios, rig) or impossible_scale(float(unknown[SCALE]), runs, rig)


def fitted(
    runs: Sequence[Run], rig: Rig, *, quick: bool = False, worst: float = np.inf, time_factor: float = 1.0
) -> RatioFit | None:
    """Fit the bare model to the beginning of each run.

    The result is None if the fit fails, or if a part of the first run alone has a chi2 far above `worst`. A fit to a
    part of the segments has at most the chi2 of the fit to all segments.

    Args:
        runs: runs in one interpretation
        rig: the recorded rig
        quick: whether to use fewer samples and iterations
        worst: reduced chi-square above which the fit stops after the first segments
        time_factor: factor by which the times were multiplied; slower swings are fitted over a longer time, to the same
            samples
    """
    iterations = SETTINGS.iterations if quick else SETTINGS.thorough
    longer = float(np.clip(time_factor, 1.0, 2.0))
    with np.errstate(all="ignore"):
        try:
            if np.isfinite(worst) and _hopeless(runs, rig, worst, longer):
                return None
            prepared = _preprocessed(runs, rig, longer * (SETTINGS.tried_s if quick else SETTINGS.looked_at_s), quick)
            settings = _ending_early(worst)
            ratio_fit = short_fit(rig.nominal, prepared, rig, iterations=iterations, settings=settings, worst=worst)
        except np.linalg.LinAlgError:
            return None
    return ratio_fit if np.isfinite(ratio_fit.chi2_per_dof) else None


def _hopeless(runs: Sequence[Run], rig: Rig, worst: float, longer: float) -> bool:
    """Check whether a part of the first run suffices to reject an interpretation.

    The interpretation is rejected if the chi-square of this part exceeds the total chi-square that all runs would have
    at the reduced chi-square `worst`.
    """
    try:
        beginning = _preprocessed(runs[:1], rig, longer * SETTINGS.screened_s, thinned=True)
    except RunError:  # the beginning is too short
        return False
    shares = len(runs) * SETTINGS.tried_s / SETTINGS.screened_s
    limit = SETTINGS.worse * shares * worst
    readings = sum(prepared.run.theta[:, 1:].size for prepared in beginning)
    settings = replace(_ending_early(limit), to_beat=limit * readings)
    first = first_fit(rig.nominal, beginning, rig, iterations=SETTINGS.iterations, settings=settings)
    return first.chi2_per_dof > limit


def _ending_early(limit: float) -> GaussNewton:
    """Return settings that end a fit early if its reduced chi-square is unlikely to reach `limit`."""
    return replace(GAUSS_NEWTON, preliminary=SETTINGS.small_reduction, far=SETTINGS.out_of_reach * limit)


def residual(ratio_fit: RatioFit) -> float:
    """Compute the rms residual above the noise, relative to the standard deviation of the angle.

    The larger value of the mounted rods is returned.
    """
    problem, segments = ratio_fit.problem, ratio_fit.problem.segments
    owner = np.repeat(segments.run, np.diff(segments.offsets))
    measured = problem.joints.to_rods(problem.measured)
    spread = np.std(np.concatenate([measured[owner == i] - measured[owner == i].mean(axis=0) for i in set(owner)]), 0)
    noise = [float(np.median(weight[weight > 0])) ** -2 if (weight > 0).any() else 0.0 for weight in problem.weight.T]
    above = np.mean((measured - ratio_fit.predicted) ** 2, axis=0) - problem.joints.to_rods_matrix**2 @ noise
    rms = np.sqrt(np.maximum(above, 0.0))
    both_rods = not all(setup.alone for setup in segments.setups)
    return float(np.max((rms / np.maximum(spread, 1e-12))[: 1 + both_rods]))


def _otherwise(
    tried: Iterable[Misreading], runs: Sequence[Run], rig: Rig, limit: float
) -> Iterator[tuple[Misreading, RatioFit]]:
    for reading in tried:
        read = [reading.read(run) for run in runs]
        if all(run_read is None for run_read in read):
            continue
        reinterpreted, factor = [run_read or run for run_read, run in zip(read, runs, strict=True)], reading.time_factor
        worst = limit / max(factor, 1.0) ** 4
        try:
            other = fitted(reinterpreted, rig, quick=True, worst=worst, time_factor=factor)
        except RunError:  # without motion or samples in this interpretation
            continue
        if other is not None and other.chi2_per_dof < worst and not impossible_fit(other, reinterpreted, rig):
            yield reading, other


def _preprocessed(runs: Sequence[Run], rig: Rig, seconds: float, thinned: bool = False) -> list[PreprocessedRun]:
    slow = [_slowness(run, rig) for run in runs]
    return [
        preprocess(
            _beginning(run, times * seconds),
            rig,
            every=max(1, round(times * run.rate_hz / SETTINGS.rate_hz)) if thinned else 1,
        )
        for run, times in zip(runs, slow, strict=True)
    ]


def _slowness(run: Run, rig: Rig) -> float:
    """Return the ratio of the observed period of theta1 to the period of a point mass at the distance L1.

    A ratio above 1 indicates slow motion. Ratios up to the threshold `slow` are returned as 1, and ratios above 8 as 8.
    The observed half period is the mean time between two passages through the middle of the range. A motion within a
    tenth of the range around its middle is not a passage.
    """
    angle, t = run.swing.theta[:, 1], run.swing.t
    deviation = (angle - 0.5 * (angle.max() + angle.min())) / max(float(np.ptp(angle)), 1e-12)
    sides = np.sign(deviation[np.abs(deviation) > 0.05])
    passages = np.count_nonzero(np.diff(sides))
    slowness = float(np.ptp(t)) / max(passages, 1) / (np.pi * np.sqrt(rig.L1 / rig.g))
    return float(np.clip(slowness, 1.0, 8.0)) if slowness > SETTINGS.slow else 1.0


def _beginning(run: Run, seconds: float) -> Run:
    return run.between(-np.inf, np.max(run.t[:1], initial=0.0) + seconds)
