"""Sample models with a moving arm from a posterior (diagnosis) or a covariance (identification)."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.dynamics.moving_arm.swing import SWING_PARAMETERS
from dpr_lab.effects import effect_params
from dpr_lab.effects.drive_gain import DRIVE_GAIN
from dpr_lab.errors import ConfigError
from dpr_lab.exports.ensemble.sampled import drawn_values, first_possible, scaled_effects, square_root
from dpr_lab.exports.moving_arm.bodies import arm_bodies
from dpr_lab.exports.moving_arm.corrected import with_engine_values, with_swing
from dpr_lab.gap.result.posterior import PosteriorComponent
from dpr_lab.identification.moving_arm.engine import engine_values
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.identification.moving_arm.unknowns import parameter_of
from dpr_lab.rig import Rig

KNOWN_TORQUE = ("torque", "current")
"""Input quantities that determine the absolute scale of torques and inertias."""


def sampled_arm_models(
    model: MovingArmModel, components: Sequence[PosteriorComponent], rig: Rig, n: int, seed: int
) -> list[MovingArmModel]:
    """Draw models with a moving arm from a posterior.

    Args:
        model: a model of `identify` or of a diagnosis
        components: the posterior of the diagnosis; empty: the covariance of the model is used
        rig: rig of the model
        n: number of models
        seed: seed of the random numbers

    Raises:
        RunError: almost no random model is physically possible.
    """
    rng = np.random.default_rng(seed)

    def draw() -> MovingArmModel:
        return _of_posterior(model, components, rig, rng) if components else _of_covariance(model, rng)

    return [first_possible(draw, partial(_possible, rig)).with_arm_effects() for _ in range(n)]


def widened_model(model: MovingArmModel, factor: float) -> MovingArmModel:
    """Multiply the standard deviations of a model's ratios and scale by a factor."""
    covariance = (factor**2 * np.array(model.covariance)).tolist()
    scale = model.absolute[model.scale]
    absolute = dict(model.absolute) | {model.scale: scale.model_copy(update={"std": factor * scale.std})}
    return model.model_copy(update={"covariance": covariance, "absolute": absolute})


def _possible(rig: Rig, model: MovingArmModel) -> bool:
    """Check whether rigid bodies can have the values of a model.

    The result is always True if the inertia of the arm is not determined.
    """
    if f"A/{model.scale}" not in model.ratios:
        return True
    try:
        arm_bodies(model, rig, {})
    except ConfigError:
        return False
    return True


def _of_covariance(model: MovingArmModel, rng: np.random.Generator) -> MovingArmModel:
    """Draw a model from the covariance of the ratios of an identification."""
    names = [parameter_of(name, model.input, model.scale) for name in model.unknowns]
    places, swing = [SWING_PARAMETERS.index(name) for name in names], np.array(model.swing)
    size = len(places)
    swing[places] += square_root(np.reshape(model.covariance, (size, size))) @ rng.standard_normal(size)
    losses = [SWING_PARAMETERS.index(name) for name in ("c1", "c2", "c0", "k0", "f0")]
    swing[losses] = np.maximum(swing[losses], 0.0)
    scale, place = model.absolute[model.scale], SWING_PARAMETERS.index("gain")
    spread, factor = scale.std / scale.value, 1.0
    if model.input in KNOWN_TORQUE and "gain" in names:
        of_ratio = model.covariance[names.index("gain")][names.index("gain")] / model.swing[place] ** 2
        spread, factor = max(spread**2 - of_ratio, 0.0) ** 0.5, model.swing[place] / swing[place]
    factor *= np.exp(rng.standard_normal() * spread)
    return with_swing(model, swing.tolist(), float(scale.value * factor))


def _of_posterior(
    model: MovingArmModel, components: Sequence[PosteriorComponent], rig: Rig, rng: np.random.Generator
) -> MovingArmModel:
    """Draw a model from a posterior: a set of effects, then its values."""
    weights = np.array([component.probability for component in components])
    component = components[int(rng.choice(len(components), p=weights / weights.sum()))]
    drawn = drawn_values(component, rng)
    scale = model.absolute[model.scale]
    interval = (scale.interval90[0] / scale.value, scale.interval90[1] / scale.value)
    factor, effects = scaled_effects(component, drawn, interval, rng)
    # only the ratio of the gain to the scale is determined
    if DRIVE_GAIN.name in effects and "b" not in component.free:
        (excess,) = effects[DRIVE_GAIN.name].values()
        effects[DRIVE_GAIN.name] = {DRIVE_GAIN.amplitudes[0].name: (1.0 + excess) * factor - 1.0}
    unknown, _ = engine_values(model, rig)
    unknown[: len(RATIOS)] = [drawn[name] for name in RATIOS]
    unknown[len(RATIOS)] *= factor
    return with_engine_values(model, unknown, effect_params(effects), rig)
