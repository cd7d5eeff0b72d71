"""Corrected model of a diagnosis with a moving arm, and its update from another fit."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.moving_arm.swing import SWING_PARAMETERS
from dpr_lab.effects import EFFECTS, effect_params, named_params
from dpr_lab.effects.free_arm import FREE_ARM
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.estimate import SCALE
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.saved import Interval
from dpr_lab.identification.model import EstimatedValue, RigFacts, RunUsed
from dpr_lab.identification.moving_arm.engine import OF_ARM, swing_of
from dpr_lab.identification.moving_arm.model import ArmFitSummary, MovingArmModel
from dpr_lab.identification.moving_arm.problem import reading_std
from dpr_lab.identification.moving_arm.scale import ArmScale, absolute_values, stated_scale
from dpr_lab.identification.moving_arm.unknowns import parameter_of
from dpr_lab.identification.prior_update import posterior_of
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.version import __version__


def has_moving_arm(diagnosis: Diagnosis) -> bool:
    """Check whether the arm of the diagnosed recordings was free or driven.

    A drive by an acceleration does not count: it prescribes the motion of the arm.
    """
    return FREE_ARM.name in diagnosis.model_effects


def corrected_arm_model(
    diagnosis: Diagnosis,
    unknown: Array,
    effects: Mapping[str, Mapping[str, float]],
    runs: Sequence[Run],
    rig: Rig,
) -> MovingArmModel:
    """Build the corrected model for `model.json`, with its effects in the table `effects`.

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
    assumed = diagnosis.scale or posterior_of(unknown, rig).scale(float(unknown[SCALE]))
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
        effects=_named(effects),
        fit=ArmFitSummary(
            rms_rad={
                _joint(name): float(np.hypot(diagnosis.gap.after_rad[name], floor)) for name, floor in noise.items()
            },
            noise_rad={_joint(name): floor for name, floor in noise.items()},
            segments=diagnosis.segments,
            segment_s=0.5,
            chi2_per_dof=diagnosis.chi2_per_dof,
            converged=True,
        ),
        runs=[RunUsed.of(run, samples=len(run.t)) for run in runs],
        warnings=[] if diagnosis.verdict in ("named", "no_gap") else [diagnosis.sentence],
        version=__version__,
    )


def with_engine_values(model: MovingArmModel, unknown: Array, params: Array, rig: Rig) -> MovingArmModel:
    """Return the model with the values (7,) and effect parameters (SIZE,) of the fitting engine."""
    swing, inertia = swing_of(unknown, params, model.mounted, bool(model.input), rig)
    changed = with_swing(model, swing, inertia)
    return changed.model_copy(update={"effects": _named(named_params(params))})


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
    low, high = scale.interval90
    if not covariance.size:  # a diagnosis of an earlier version
        ends = np.array([interval.interval90 for interval in determined.values()]).reshape(-1, 2)
        covariance = np.diag((np.diff(ends)[:, 0] / (2 * NORMAL_Q90)) ** 2)
    std = np.sqrt(np.diag(covariance)).tolist()
    estimates = {
        name: EstimatedValue(value=interval.value, std=error, interval90=interval.interval90)
        for (name, interval), error in zip(determined.items(), std, strict=True)
    }
    ratios = _with_values(estimates, swing, kind, scale.inertia)
    of_scale = float(np.arcsinh((high - low) / (2 * scale.b))) / NORMAL_Q90  # exact for a lognormal interval
    values = {parameter_of(name, kind, scale.inertia): ratio.value for name, ratio in ratios.items()}
    source = ArmScale(scale.b, of_scale, by_gain=False, known=scale.known)
    return {
        "ratios": ratios,
        "undetermined": {},
        "covariance": covariance.tolist(),
        "unknowns": list(ratios),
        "absolute": absolute_values(values, np.diag(np.diag(covariance)), source, scale.inertia, kind),
        "scale_sentence": scale.sentence,
    }


def with_swing(model: MovingArmModel, swing: Sequence[float], inertia: float) -> MovingArmModel:
    """Replace the `SWING_PARAMETERS` and the scale of a model, whose relative uncertainty is unchanged.

    `swing` contains the `SWING_PARAMETERS` (12,) divided by the scale, and `inertia` is the scale, kg m^2.
    """
    assumed = model.absolute[model.scale]
    factor = inertia / assumed.value
    low, high = assumed.interval90
    update = {"value": inertia, "std": factor * assumed.std, "interval90": (factor * low, factor * high)}
    absolute = dict(model.absolute) | {model.scale: assumed.model_copy(update=update)}
    ratios = _with_values(model.ratios, swing, model.input, model.scale)
    return model.model_copy(update={"swing": list(swing), "ratios": ratios, "absolute": absolute})


def _with_values(
    ratios: Mapping[str, EstimatedValue], swing: Sequence[float], kind: str, letter: str
) -> dict[str, EstimatedValue]:
    """Replace the values of the ratios by the values of `SWING_PARAMETERS`; their intervals are moved."""
    return {
        name: ratio.moved(swing[SWING_PARAMETERS.index(parameter_of(name, kind, letter))])
        for name, ratio in ratios.items()
    }


def _joint(name: str) -> str:
    return name.replace("joint", "joint ")


def _named(effects: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    """Return the effects except for the arm itself and one-time events."""
    return {name: dict(values) for name, values in effects.items() if name not in OF_ARM and not EFFECTS[name].event}
