"""Corrected model of a diagnosis: the identified rods with the named effects.

An amplitude is insignificant if its interval contains zero. Insignificant amplitudes z are set to zero. For example, a
spring with an insignificant cubic term becomes a linear spring, which every format with springs can represent. The
other values x are then replaced by their conditional means x - C_xz C_zz^-1 z in the joint normal distribution, where C
is the covariance. If all amplitudes of a named effect are insignificant, they are kept. Effects that are fitted to
every rig of this kind are omitted if they are neither significant nor named.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import Any, Literal

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import ALONE, RATIOS
from dpr_lab.effects import EFFECTS, effect_params
from dpr_lab.effects.free_arm import FREE_ARM
from dpr_lab.estimation.noise import NORMAL_Q90, noise_floor
from dpr_lab.estimation.usable_runs import refuse_other_rigs
from dpr_lab.exports.ensemble.sampled import with_permitted_signs
from dpr_lab.fitting.estimate import ON_ELBOW, SCALE, UNKNOWN_RATIOS, alone_share, visible_ratios
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.posterior import PosteriorComponent
from dpr_lab.gap.result.saved import Interval
from dpr_lab.gap.result.subject import refuse_other_subject
from dpr_lab.identification.model import (
    Covariance,
    EstimatedValue,
    FitSummary,
    Model,
    RigFacts,
    RunUsed,
    SearchRecord,
    ratios_alone,
)
from dpr_lab.identification.moving_arm.engine import named_faults, swing_of
from dpr_lab.identification.moving_arm.model import AnyModel, ArmFitSummary, MovingArmModel, moved_ratios
from dpr_lab.identification.moving_arm.problem import reading_std
from dpr_lab.identification.moving_arm.scale import ArmScale, absolute_values, stated_scale
from dpr_lab.identification.moving_arm.unknowns import parameter_of
from dpr_lab.identification.preprocess import rms_noise
from dpr_lab.identification.prior_update import clamped_cosine, posterior_of
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.setup import Setup, only_inner
from dpr_lab.version import __version__

AXES = {"joint1": "theta1", "joint2": "theta2"}


def corrected_model(diagnosis: Diagnosis, runs: Sequence[Run], rig: Rig) -> AnyModel:
    """Build the corrected model of a diagnosis, as `diagnose --out` writes it.

    Args:
        diagnosis: ratios, covariance and effects
        runs: the diagnosed runs, without held-out runs
        rig: measured values and bounds of the nine parameters

    Returns:
        `MovingArmModel` if the arm of the runs was free or driven, otherwise `Model`; `effects` contains the effects

    Raises:
        RunError: a run belongs to another rig, or the diagnosis belongs to other runs.
        ConfigError: the diagnosis was made with another description of the rig.
    """
    refuse_other_rigs(runs, rig)
    if diagnosis.evidence is not None:  # None in a file of an older version
        refuse_other_subject(diagnosis, runs, rig)
    if has_moving_arm(diagnosis):
        return corrected_arm_model(diagnosis, *significant_values(diagnosis), runs, rig)
    return corrected_rods(diagnosis, runs, rig)


def corrected_rods(diagnosis: Diagnosis, runs: Sequence[Run], rig: Rig) -> Model:
    """Build the corrected model for a clamped or prescribed arm.

    See `corrected_model` for the arguments.
    """
    unknown, effects = significant_values(diagnosis)
    covariance = _covariance(diagnosis)
    alone = {name: diagnosis.determined[name] for name in ALONE if diagnosis.fitted and name in diagnosis.determined}
    values = rod_values(
        unknown, covariance, diagnosis.all_ratios, diagnosis.scale, [run.setup for run in runs], rig, alone
    )
    std = np.sqrt(np.diag(covariance))[: len(RATIOS)]
    return Model(
        **values,
        rig=RigFacts.of(rig),
        cramer_rao_std={} if diagnosis.fitted else dict(zip(RATIOS, std.tolist(), strict=True)),
        fit=_fit_summary(diagnosis, rms_noise(noise_floor(run, rig) for run in runs)),
        search=SearchRecord(
            algorithm="diagnosis",
            objective="segments",
            seed=0,
            evaluations=0,
            seconds=diagnosis.seconds,
            generations=0,
            best={},
            best_cost=0.0,
            history={},
        ),
        runs=[RunUsed.of(run, samples=len(run.t), torque_kind=run.torque_kind) for run in runs],
        p_over_b=diagnosis.p_over_b,
        effects={name: parameters for name, parameters in effects.items() if not EFFECTS[name].event},
        warnings=[] if diagnosis.verdict in ("named", "no_gap") else [diagnosis.sentence],
        version=__version__,
    )


def _fit_summary(diagnosis: Diagnosis, noise: Array) -> FitSummary:
    """Return the residual and the noise of a single reading, as an identification states them.

    The noise floor of the diagnosis is that of averaged readings, so it is smaller.
    """
    noise_rad = dict(zip(AXES.values(), noise.tolist(), strict=True))
    after = {AXES[joint]: rms for joint, rms in diagnosis.gap.after_rad.items()}
    return FitSummary(
        rms_rad={rod: float(np.hypot(rms, noise_rad[rod])) for rod, rms in after.items()},
        noise_rad=noise_rad,
        segments=diagnosis.segments,
        chi2_per_dof=diagnosis.chi2_per_dof,
        iterations=0,
        longest_segment_s=0.5,
    )


def rod_values(
    unknown: Array,
    covariance: Array,
    intervals: Mapping[str, Interval],
    scale: Scale | None,
    setups: Sequence[Setup],
    rig: Rig,
    alone: Mapping[str, Interval] | None = None,
) -> dict[str, Any]:
    """Return the values of a model with their intervals: `ratios`, `covariance`, `parameters`, `base` and `scale`.

    Args:
        unknown: (7,) ratios, b and p/b
        covariance: (7, 7) covariance of `unknown`; zero for values that the recordings do not determine
        intervals: the five ratios with their 90 % intervals, which are moved to the values in `unknown`
        scale: scale of the absolute values; None: the scale that follows from the rig file
        setups: setup of each run
        rig: measured values and bounds
        alone: intervals of e1/a and c1/a, if only the inner rod is mounted
    """
    single, fitted_b = only_inner(setups), scale is not None and scale.fixed_by == "data"
    visible = [i for i in visible_ratios(setups, fitted_b) if i != ON_ELBOW or covariance[i, i] > 0.0]
    if scale is not None and fitted_b:
        covariance = covariance.copy()  # the lower end of the interval may be clipped, to stay positive
        covariance[SCALE, SCALE] = (unknown[SCALE] * (scale.interval90_of_sizes[1] / scale.b - 1.0) / NORMAL_Q90) ** 2
    of_visible = covariance[np.ix_(visible, visible)]
    posterior = posterior_of(unknown, rig, visible, of_visible, alone=single, clamped=clamped_cosine(setups))
    scale = scale or posterior.scale(float(unknown[SCALE]))
    scale = scale.as_inertia("b", float(unknown[SCALE]) / scale.b)
    ratios = {
        name: _estimated(intervals[name], value, float(std))
        for name, value, std in zip(RATIOS, unknown.tolist(), np.sqrt(np.diag(covariance)), strict=False)
    }
    nine, base = posterior.parameters(scale, ratios)
    shown = ratios_alone([*ratios.values()], float(unknown[ON_ELBOW]), rig.g / rig.L1) if single else ratios
    shown |= {
        name: _estimated(interval, shown[name].value, shown[name].std) for name, interval in (alone or {}).items()
    }
    return {
        "ratios": shown,
        "fitted": [*ratios.values()] if single else [],
        "covariance": Covariance(order=list(RATIOS), matrix=covariance[: len(RATIOS), : len(RATIOS)].tolist()),
        "parameters": nine,
        "base": base,
        "scale": scale.as_inertia("a", alone_share(unknown)) if single else scale,
    }


def _estimated(interval: Interval, value: float, std: float) -> EstimatedValue:
    """Return a value with the interval of another value, shifted by the difference.

    The standard deviation is at least `std`, that of the fit alone. It is larger if the interval also contains the
    uncertainty of ratios that the recordings do not determine.
    """
    std = max(std, (interval.interval90[1] - interval.value) / NORMAL_Q90)
    return EstimatedValue(value=interval.value, std=std, interval90=interval.interval90).moved(value)


def significant_values(diagnosis: Diagnosis) -> tuple[Array, dict[str, dict[str, float]]]:
    """Return the (7,) ratios, b and p/b, and the effects without insignificant amplitudes."""
    unknown = diagnosis.unknowns
    fitted = dict(zip(UNKNOWN_RATIOS, unknown.tolist(), strict=True)) | {
        f"{name}.{key}": value
        for name, parameters in diagnosis.model_effects.items()
        for key, value in parameters.items()
    }
    absent = _insignificant_effects(diagnosis, fitted)
    values = _without_insignificant(diagnosis, fitted, absent)
    return np.array([values[name] for name in UNKNOWN_RATIOS]), {
        name: {key: values[f"{name}.{key}"] for key in parameters}
        for name, parameters in diagnosis.model_effects.items()
        if name not in absent
    }


def _covariance(diagnosis: Diagnosis) -> Array:
    """Return the (7, 7) covariance of the ratios, b and p/b; zero where the diagnosis does not state it."""
    covariance, posterior = np.zeros((len(UNKNOWN_RATIOS), len(UNKNOWN_RATIOS))), _posterior(diagnosis)
    if posterior is not None:
        names = [name for name in UNKNOWN_RATIOS if name in posterior.free]
        places, columns = ([order.index(name) for name in names] for order in ([*UNKNOWN_RATIOS], posterior.free))
        covariance[np.ix_(places, places)] = np.array(posterior.covariance)[np.ix_(columns, columns)]
    covariance[: len(RATIOS), : len(RATIOS)] = diagnosis.ratio_covariance
    return covariance


def _posterior(diagnosis: Diagnosis) -> PosteriorComponent | None:
    """Return the posterior component with the effects of the corrected model, or None."""
    return next((part for part in diagnosis.posterior if set(part.effects) == set(diagnosis.model_effects)), None)


def _insignificant_effects(diagnosis: Diagnosis, fitted: Mapping[str, float]) -> set[str]:
    """Find effects that are omitted from the corrected model.

    These effects are fitted to every rig of this kind, are not named, and have intervals that all contain zero.
    """
    posterior = _posterior(diagnosis)
    if posterior is None or has_moving_arm(diagnosis):
        return set()
    std = dict(zip(posterior.free, np.sqrt(np.diag(posterior.covariance)).tolist(), strict=True))
    named = {effect.name for effect in diagnosis.effects}
    amplitudes = {name: [f"{name}.{p.name}" for p in EFFECTS[name].amplitudes] for name in diagnosis.model_effects}
    return {
        name
        for name, keys in amplitudes.items()
        if name not in named and all(key in std and abs(fitted[key]) <= NORMAL_Q90 * std[key] for key in keys)
    }


def _without_insignificant(
    diagnosis: Diagnosis, fitted: Mapping[str, float], absent: Collection[str] = ()
) -> dict[str, float]:
    """Return values of ratios and of effects (`effect.parameter`) without insignificant amplitudes.

    The amplitudes of the effects `absent` are also set to zero.
    """
    zero = [f"{effect.name}.{key}" for effect in diagnosis.effects for key in effect.insignificant]
    zero += [f"{name}.{p.name}" for name in absent for p in EFFECTS[name].amplitudes]
    posterior, values = _posterior(diagnosis), dict(fitted)
    if zero and posterior is not None and set(zero) <= set(posterior.free):
        places = [posterior.free.index(name) for name in zero]
        covariance = np.array(posterior.covariance)
        gain = covariance[:, places] @ np.linalg.pinv(covariance[np.ix_(places, places)], hermitian=True)
        steps = gain @ np.array([fitted[name] for name in zero])
        changes = dict(zip(posterior.free, steps.tolist(), strict=True))
        # parameters whose estimate is zero are not in `fitted`
        values |= {name: fitted[name] - changes[name] for name in changes.keys() & fitted.keys()}
    return with_permitted_signs(values | dict.fromkeys(zero, 0.0))


def has_moving_arm(diagnosis: Diagnosis) -> bool:
    """Check whether the arm of the diagnosed recordings was free or driven.

    An arm with a prescribed acceleration does not count as driven.
    """
    return FREE_ARM.name in diagnosis.model_effects


def corrected_arm_model(
    diagnosis: Diagnosis,
    unknown: Array,
    effects: Mapping[str, Mapping[str, float]],
    runs: Sequence[Run],
    rig: Rig,
) -> MovingArmModel:
    """Build the corrected model of a diagnosis with a free or driven arm.

    Args:
        diagnosis: ratios with their intervals
        unknown: (7,) ratios to b, b and p/b
        effects: all effects, including the arm
        runs: the diagnosed runs
        rig: rig of the recordings
    """
    driven = any(run.arm_mode == "driven" for run in runs)
    mounted: Literal["both", "inner"] = "both" if rig.rods.mounted == "both" else "inner"
    swing, inertia = swing_of(unknown, effect_params(effects), mounted, driven, rig)
    setups, assumed = [run.setup for run in runs], diagnosis.scale
    if assumed is None:  # a diagnosis of an earlier version
        of_rig = posterior_of(unknown, rig, alone=only_inner(setups), clamped=clamped_cosine(setups))
        assumed = of_rig.scale(float(unknown[SCALE]))
    scale = assumed.as_inertia("b" if mounted == "both" else "a", inertia / assumed.b)
    kind = rig.input if driven else ""
    std = np.sqrt(np.mean([reading_std(run, rig) ** 2 for run in runs], axis=0)).tolist()
    read = sorted(joint for joint, floor in diagnosis.gap.floor_rad.items() if floor > 0.0)
    noise = {joint: std[int(joint[-1])] for joint in read}
    return MovingArmModel(
        **_arm_values(diagnosis.determined, np.array(diagnosis.determined_covariance), swing, kind, scale),
        rig=RigFacts.of(rig),
        mounted=mounted,
        input=kind,
        scale=scale.inertia,
        swing=swing,
        effects=named_faults(effects),
        fit=ArmFitSummary(
            rms_rad={
                f"joint {name[-1]}": float(np.hypot(diagnosis.gap.after_rad[name], floor))
                for name, floor in noise.items()
            },
            noise_rad={f"joint {name[-1]}": floor for name, floor in noise.items()},
            segments=diagnosis.segments,
            segment_s=0.5,
            chi2_per_dof=diagnosis.chi2_per_dof,
            converged=True,
        ),
        runs=[RunUsed.of(run, samples=len(run.t)) for run in runs],
        warnings=[] if diagnosis.verdict in ("named", "no_gap") else [diagnosis.sentence],
        version=__version__,
    )


def with_intervals(
    model: MovingArmModel, determined: Mapping[str, Interval], covariance: Array, fitted: Scale | None
) -> MovingArmModel:
    """Replace the ratios and absolute values of a model by those of a new fit.

    Args:
        model: a model with the `SWING_PARAMETERS` of this fit
        determined: the ratios with their intervals
        covariance: (n, n) covariance of these ratios
        fitted: inertia b of this fit; None: the scale of the model remains
    """
    assumed = model.absolute[model.scale]
    if fitted is not None:
        scale = fitted.as_inertia(model.scale, assumed.value / fitted.b)
        return model.model_copy(update=_arm_values(determined, covariance, model.swing, model.input, scale))
    scale = stated_scale(assumed, model.scale, assumed.fixed_by)
    values = _arm_values(determined, covariance, model.swing, model.input, scale)
    unchanged = {"absolute": {**values["absolute"], model.scale: assumed}, "scale_sentence": model.scale_sentence}
    return model.model_copy(update=values | unchanged)


def _arm_values(
    determined: Mapping[str, Interval], covariance: Array, swing: Sequence[float], kind: str, scale: Scale
) -> dict[str, Any]:
    """Return the values of a model with their intervals, as `rod_values` does for a clamped arm.

    The standard deviations of absolute values include the standard deviation of the scale.

    Args:
        determined: the ratios with their intervals, which are moved to the values in `swing`
        covariance: (n, n) covariance of these ratios; empty: independent, with the errors of their intervals
        swing: (12,) `SWING_PARAMETERS`, divided by the scale
        kind: kind of the input of the arm; empty without an input
        scale: scale of absolute values
    """
    if not covariance.size:  # a diagnosis of an earlier version
        ends = np.array([interval.interval90 for interval in determined.values()]).reshape(-1, 2)
        covariance = np.diag((np.diff(ends)[:, 0] / (2 * NORMAL_Q90)) ** 2)
    std = np.sqrt(np.diag(covariance)).tolist()
    estimates = {
        name: EstimatedValue(value=interval.value, std=error, interval90=interval.interval90)
        for (name, interval), error in zip(determined.items(), std, strict=True)
    }
    ratios = moved_ratios(estimates, swing, kind, scale.inertia)
    values = {parameter_of(name, kind, scale.inertia): ratio.value for name, ratio in ratios.items()}
    return {
        "ratios": ratios,
        "undetermined": {},
        "covariance": covariance.tolist(),
        "unknowns": list(ratios),
        "absolute": absolute_values(values, np.diag(np.diag(covariance)), ArmScale.of(scale), scale.inertia, kind),
        "scale_sentence": scale.sentence,
    }
