"""Build the model of a rig from fitted ratios, with the interval and source of each value."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import RATIOS
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.estimate import FRICTION, ON_ELBOW, SCALE
from dpr_lab.identification.identifiability import identifiability, summary
from dpr_lab.identification.misread.tried import check_description
from dpr_lab.identification.model import (
    Covariance,
    EstimatedValue,
    FitSummary,
    Identifiable,
    Model,
    ParameterValue,
    RigFacts,
    RunUsed,
    SearchRecord,
    ratios_alone,
)
from dpr_lab.identification.preprocess import PreprocessedRun, rms_noise
from dpr_lab.identification.prior_update import Posterior, clamped_cosine, posterior_of, prior_ratio_std
from dpr_lab.identification.profile import profile90
from dpr_lab.identification.ratio_fit import RatioFit, predictable_until
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.identification.uncertainty import RatioUncertainty, uncertainty
from dpr_lab.rig import Rig
from dpr_lab.run import Run, truncation
from dpr_lab.setup import only_inner
from dpr_lab.shown import percent
from dpr_lab.version import __version__


@dataclass(frozen=True, slots=True)
class IdentifySettings:
    """Thresholds of the warnings and limits of an identification."""

    gap_warning: float = 3.0
    """Reduced chi-square above which the model is clearly incomplete."""
    doubted: float = 20.0
    """Reduced chi-square above which other interpretations of the readings are tested."""
    hardly_seen: float = 0.5
    """Maximum relative standard deviation of a well determined unknown."""
    unseen: float = 1e3
    """Maximum standard deviation of an unknown of a moving arm, relative to the larger of its value and 1.

    A fit that failed gives larger standard deviations; the recordings then do not determine the unknown.
    """
    of_prior: float = 0.5
    """Maximum variance of a ratio that the runs determine, relative to the variance of the prior.

    Above it, the bounds of the rig file determine the ratio.
    """


SETTINGS = IdentifySettings()

FRICTION_NAMES = tuple(RATIOS[i] for i in FRICTION)


def identified_model(
    ratio_fit: RatioFit, runs: Sequence[PreprocessedRun], rig: Rig, search: SearchRecord, profile: bool
) -> Model:
    """Build the model of a rig from a fit of its ratios.

    Args:
        ratio_fit: the fit
        runs: the fitted runs
        rig: bounds and measured values, for the parameters that free swings do not determine
        search: record of the global search
        profile: whether to compute the interval of each ratio by profile likelihood as well

    Raises:
        IdentificationError: the runs do not determine the ratios.
    """
    ratio_uncertainty = uncertainty(ratio_fit)
    noise = rms_noise(prepared.noise for prepared in runs)
    measured = np.concatenate([prepared.run.theta[:, 1:] for prepared in runs])
    rms = np.sqrt(np.mean((measured - ratio_fit.predicted) ** 2, axis=0))
    ratios = {name: _ratio(ratio_fit, ratio_uncertainty, rig, name, profile) for name in RATIOS}
    setups, unknown = [prepared.run.setup for prepared in runs], ratio_fit.fit.estimate.ratios
    alone, clamped = only_inner(setups), clamped_cosine(setups)
    posterior = posterior_of(unknown, rig, ratio_fit.visible, ratio_uncertainty.of_runs, alone=alone, clamped=clamped)
    # parts that are not mounted have no influence on a and on ratios to a
    mounted_alone = replace(ratio_uncertainty, assumed=0.0) if alone else ratio_uncertainty
    scale = _scale(ratio_fit, mounted_alone, posterior)
    parameters, base = posterior.parameters(scale, ratios)
    p_over_b = float(unknown[ON_ELBOW])
    std = dict.fromkeys(RATIOS, 0.0) | _of_ratios(ratio_uncertainty.names, ratio_uncertainty.cramer_rao_std)
    share = float(unknown[RATIOS.index("a/b")]) - p_over_b
    shown = {name: _ratio(ratio_fit, mounted_alone, rig, name, profile) for name in RATIOS} if alone else ratios
    return Model(
        rig=RigFacts.of(rig),
        ratios=ratios_alone([*shown.values()], p_over_b, rig.g / rig.L1) if alone else ratios,
        fitted=[*ratios.values()] if alone else [],
        covariance=Covariance(order=list(ratio_uncertainty.names), matrix=ratio_uncertainty.covariance.tolist()),
        cramer_rao_std={"e1/a": std["e1/b"] / share, "c1/a": std["c1/b"] / share} if alone else std,
        p_over_b=p_over_b if any(prepared.run.setup.alone for prepared in runs) else None,
        parameters=parameters,
        base=base,
        scale=scale.as_inertia("a", share) if alone else scale,
        identifiability=_identifiable(ratio_fit, ratio_uncertainty, posterior),
        fit=FitSummary(
            rms_rad=dict(zip(("theta1", "theta2"), rms.tolist(), strict=True)),
            noise_rad=dict(zip(("theta1", "theta2"), noise.tolist(), strict=True)),
            segments=ratio_fit.segments,
            chi2_per_dof=ratio_fit.chi2_per_dof,
            iterations=ratio_fit.fit.iterations,
            longest_segment_s=ratio_fit.longest_s,
        ),
        search=search,
        runs=[_used(i, runs[i], ratio_fit) for i in range(len(runs))],
        warnings=_of_alone(_warnings(ratio_fit, mounted_alone), alone)
        + _beyond_bounds(parameters, rig)
        + truncation(prepared.run.name for prepared in runs if not prepared.run.complete),
        failures=_of_alone(_failures(ratio_fit, mounted_alone), alone)
        + _misread(ratio_fit, [prepared.run for prepared in runs], rig),
        version=__version__,
    )


def _of_alone(sentences: list[str], alone: bool) -> list[str]:
    """Adapt sentences on ratios to a rig with only the inner rod.

    The ratios then refer to the inertia a. Sentences about the ratio a/b are omitted.
    """
    if not alone:
        return sentences
    remaining = [sentence for sentence in sentences if "do not determine a/b" not in sentence]
    return [sentence.replace("e1/b", "e1/a").replace("c1/b", "c1/a") for sentence in remaining]


def _of_ratios(names: Sequence[str], values: Array) -> dict[str, float]:
    return {name: value for name, value in zip(names, values.tolist(), strict=True) if name in RATIOS}


def _ratio(
    ratio_fit: RatioFit, ratio_uncertainty: RatioUncertainty, rig: Rig, name: str, profile: bool
) -> EstimatedValue:
    value = float(ratio_fit.ratios[RATIOS.index(name)])
    if name not in ratio_uncertainty.names:
        std = prior_ratio_std(rig)[RATIOS.index(name)]
        reach = NORMAL_Q90 * std
        interval = (max(value - reach, 0.0), value + reach)
        return EstimatedValue(value=value, std=std, interval90=interval, fixed_by="bound")
    i = ratio_uncertainty.names.index(name)
    return EstimatedValue(
        value=value,
        std=float(ratio_uncertainty.std[i]),
        interval90=ratio_uncertainty.interval90(i),
        profile90=_profile(ratio_fit, ratio_uncertainty, i) if profile else None,
        fixed_by="bound"
        if ratio_uncertainty.of_prior[i] > SETTINGS.of_prior or name in ratio_uncertainty.at_zero
        else "data",
    )


def _scale(ratio_fit: RatioFit, ratio_uncertainty: RatioUncertainty, posterior: Posterior) -> Scale:
    """Return the scale of absolute sizes (the inertia b), which the runs or the rig file determine.

    Bounds of the rig file may shift b away from the estimate of the runs. The interval then contains both values.
    """
    if SCALE not in ratio_fit.visible or posterior.clamped is not None:
        return posterior.scale()
    b = posterior.b
    low, high = ratio_uncertainty.interval90(list(ratio_fit.visible).index(SCALE))
    return Scale(b=b, interval90=(max(min(low, b), 1e-3 * b), max(high, b)), fixed_by="data")


def _profile(ratio_fit: RatioFit, ratio_uncertainty: RatioUncertainty, index: int) -> tuple[float | None, float | None]:
    low, high = profile90(ratio_fit, ratio_uncertainty, index)
    return low if np.isfinite(low) else None, high if np.isfinite(high) else None


def _identifiable(ratio_fit: RatioFit, ratio_uncertainty: RatioUncertainty, posterior: Posterior) -> Identifiable:
    of_runs = ratio_uncertainty.information / ratio_fit.noise_factor
    analysis = identifiability(of_runs, posterior.rig, posterior, lengths=False)
    return Identifiable.model_validate(summary(analysis))


def _misread(ratio_fit: RatioFit, runs: Sequence[Run], rig: Rig) -> list[str]:
    """Return a note, as a list, if another interpretation of the columns fits better; otherwise an empty list."""
    look = check_description(runs, rig) if ratio_fit.chi2_per_dof > SETTINGS.doubted else None
    return [look.sentence] if look and look.sentence else []


def _used(index: int, prepared: PreprocessedRun, ratio_fit: RatioFit) -> RunUsed:
    run, segments = prepared.run, np.flatnonzero(ratio_fit.problem.segments.run == index)
    return RunUsed.of(
        run,
        samples=len(run.t),
        duration_s=run.duration,
        chi2_per_dof=float(ratio_fit.fit.linear.chi2_by_segment[segments].sum())
        / int(ratio_fit.problem.evidence_by_segment[segments].sum()),
        segments=len(segments),
        horizon_s=predictable_until(ratio_fit, int(segments[0]), run.t),
        torque_kind=run.torque_kind,
        zeros_rad=ratio_fit.fit.estimate.zeros[index].tolist() if ratio_fit.problem.rezeroed else [],
    )


def _warnings(ratio_fit: RatioFit, ratio_uncertainty: RatioUncertainty) -> list[str]:
    warnings = []
    if ratio_fit.chi2_per_dof > SETTINGS.gap_warning:
        warnings.append(
            f"the root of the reduced chi-square is {ratio_fit.chi2_per_dof**0.5:.1f} over segments of"
            f" {ratio_fit.longest_s:.2g} s (noise alone: 1): the model lacks an effect of this rig"
        )
    warnings += [
        f"{name} is fixed at zero: its unconstrained estimate is negative" for name in ratio_uncertainty.at_zero
    ]
    warnings += [
        f"{name} is poorly determined by these runs: its standard deviation exceeds half its value"
        for name, value, std in ratio_uncertainty.estimates
        if name in FRICTION_NAMES and value > 0 and std > SETTINGS.hardly_seen * value
    ]
    hardly = [
        name
        for name, share in zip(ratio_uncertainty.names, ratio_uncertainty.of_prior, strict=True)
        if share > SETTINGS.of_prior
    ]
    if hardly:
        warnings.append(
            f"these runs only poorly determine {', '.join(hardly)}: value and interval depend on the nominal"
            " values and bounds of the rig file; record longer and larger swings, or both rods free"
        )
    unseen = [name for name in RATIOS if name not in ratio_uncertainty.names]
    if unseen:
        warnings.append(
            f"these runs do not determine {', '.join(unseen)}, so the values of the rig file are used; record swings"
            " of both rods to determine these ratios"
        )
    return warnings


def _beyond_bounds(parameters: Mapping[str, ParameterValue], rig: Rig) -> list[str]:
    lower, upper = rig.bounds
    return [
        f"{name} = {value.value:.4g} is outside its bounds {lower[i]:.4g} .. {upper[i]:.4g}, as a result of"
        f" the data and the measured values: check the bounds, the measured values, L1 and g"
        for i, (name, value) in enumerate(parameters.items())
        if rig.searched[i] and not 0.999 * lower[i] <= value.value <= 1.001 * upper[i]
    ]


def _failures(ratio_fit: RatioFit, ratio_uncertainty: RatioUncertainty) -> list[str]:
    failures = []
    if not ratio_fit.fit.converged:
        failures.append(
            f"the local solver did not converge in {ratio_fit.fit.iterations} iterations: start from tighter bounds"
        )
    failures += [
        f"{name} is not identifiable from these runs: its standard deviation is {percent(std / value)} of its value"
        for name, value, std in ratio_uncertainty.estimates
        if name in RATIOS and name not in FRICTION_NAMES and not std / value < SETTINGS.hardly_seen
    ]
    return failures
