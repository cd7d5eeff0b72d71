"""Sample corrected models from the posterior of parameters and causes, for domain randomisation.

First, a set of effects is drawn with its posterior probability. Then the values of the parameters are drawn from their
joint normal distribution for a further recording. The covariance is that of the fit plus the covariance between
recordings (`dpr_lab.gap.conclusion.scatter`). The distribution is truncated: a draw is repeated if a quantity that must
be positive is negative, or if the inertias are physically impossible. Negative values are not set to zero, because this
would break the correlations. For example, a large Coulomb friction is drawn together with a negative viscous friction.
With zero viscous friction instead, the total friction would be too large.

If the recordings determine the scale b, it is drawn together with the other values, because under a known torque tau
the motion depends on tau / b. A free swing does not determine b. In this case, b is drawn from a log-normal
distribution that has the interval of b. All masses, inertias and torques are proportional to b.

A model with a moving arm of an identification is drawn from the covariance of its ratios.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from typing import TypeVar

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import RATIOS, base_from_ratios
from dpr_lab.dynamics.moving_arm.swing import SWING_PARAMETERS
from dpr_lab.effects import EFFECTS, effect_params
from dpr_lab.effects.drive_gain import DRIVE_GAIN
from dpr_lab.errors import ConfigError, RunError
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.exports.bodies import arm_bodies
from dpr_lab.exports.ensemble.scatter import RatioScatter
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.posterior import PosteriorComponent
from dpr_lab.identification.model import Model
from dpr_lab.identification.moving_arm.engine import engine_values, with_engine_values
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.identification.moving_arm.unknowns import parameter_of
from dpr_lab.rig import Rig

Drawn = TypeVar("Drawn")

KNOWN_TORQUE = ("torque", "current")
"""Kinds of inputs of the arm with which the recordings determine the absolute scale of torques and inertias."""


def sampled_models(model: Model, components: Sequence[PosteriorComponent], n: int, seed: int) -> list[Model]:
    """Draw models from a posterior.

    Args:
        model: the corrected model
        components: posterior of the model
        n: number of models
        seed: seed of the random numbers

    Raises:
        RunError: too few random models lie within the bounds.
    """
    rng = np.random.default_rng(seed)
    weights = np.array([component.probability for component in components])
    chosen = rng.choice(len(components), size=n, p=weights / weights.sum())
    models = []
    for component in [components[index] for index in chosen.tolist()]:
        values = first_possible(lambda component=component: drawn_values(component, rng), _possible)
        models.append(_with_values(model, component, values, rng))
    return models


def ensemble_posterior(
    model: Model, diagnosis: Diagnosis | None, scatter: RatioScatter | None = None
) -> list[PosteriorComponent]:
    """Return the posterior of a diagnosis; without a diagnosis, a posterior from the covariance of the ratios.

    Args:
        model: the model
        diagnosis: diagnosis of the model; None if there is none
        scatter: scatter of the ratios between recordings, for a model without a diagnosis

    Raises:
        RunError: the diagnosis was written by an older version, without a posterior.
    """
    if diagnosis is not None:
        return diagnosed_posterior(diagnosis)
    free = [name for name in model.covariance.order if name in (*RATIOS, "b")]
    places = [model.covariance.order.index(name) for name in free]
    spread = np.array(model.covariance.matrix)[np.ix_(places, places)]
    ratios = {name: estimate.value for name, estimate in model.all_ratios.items()}
    if "b" in free:
        ratios["b"] = model.base["b"].value
    between, left_out = np.zeros_like(spread), np.zeros((0, len(free)))
    if scatter is not None:
        common = [name for name in free if name in scatter.names]
        places, columns = ([names.index(name) for name in common] for names in (free, list(scatter.names)))
        between[np.ix_(places, places)] = scatter.between[np.ix_(columns, columns)]
        left_out = np.repeat([[ratios[name] for name in free]], len(scatter.left_out), axis=0)
        left_out[:, places] = scatter.left_out[:, columns]
    return [
        PosteriorComponent(
            probability=1.0,
            ratios=ratios,
            effects=model.effects,
            free=free,
            covariance=spread.tolist(),
            between=between.tolist(),
            left_out=left_out.tolist(),
        )
    ]


def diagnosed_posterior(diagnosis: Diagnosis) -> list[PosteriorComponent]:
    """Return the posterior of a diagnosis.

    Raises:
        RunError: the diagnosis was written by an older version, without a posterior.
    """
    if not diagnosis.posterior:
        raise RunError("the diagnosis has no joint covariance of its parameters: diagnose the recordings again")
    return diagnosis.posterior


def drawn_values(component: PosteriorComponent, rng: np.random.Generator, tries: int = 1000) -> dict[str, float]:
    """Draw ratios and effect parameters (`effect.parameter`) for one set of effects.

    If no draw has only permitted signs, negative values are replaced by zero.
    """
    values = dict(component.ratios) | {
        f"{name}.{key}": value for name, parameters in component.effects.items() for key, value in parameters.items()
    }
    mean = np.array([values.get(name, 0.0) for name in component.free])  # effects of size zero are not listed
    positive = np.array([name in _positive() for name in component.free], dtype=np.bool_)
    steps = rng.standard_normal((tries, len(mean))) @ square_root(component.predictive).T
    allowed = (mean + steps >= 0.0) | ~positive
    step = steps[int(np.argmax(allowed.all(axis=1)))]
    return with_permitted_signs(values | dict(zip(component.free, (mean + step).tolist(), strict=True)))


@cache
def _positive() -> frozenset[str]:
    """Return the names of the values that cannot be negative."""
    effects = (
        f"{name}.{p.name}" for name, effect in EFFECTS.items() for p in effect.parameters if p.sign == "positive"
    )
    return frozenset(("c1/b", "c2/b", "b", *effects))


def first_possible(draw: Callable[[], Drawn], possible: Callable[[Drawn], bool], tries: int = 1000) -> Drawn:
    """Draw repeatedly, and return the first draw that is physically possible.

    Raises:
        RunError: no draw is possible.
    """
    drawn = next(filter(possible, (draw() for _ in range(tries))), None)
    if drawn is None:
        raise RunError(
            "almost no sample of the posterior is physically possible: these recordings do not determine the model"
        )
    return drawn


def square_root(covariance: Array) -> Array:
    """Compute a matrix square root of a covariance, which may be singular."""
    scale = np.sqrt(np.maximum(np.diag(covariance), np.finfo(np.float64).tiny))
    eigen, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return scale[:, None] * vectors * np.sqrt(np.maximum(eigen, 0.0))


def with_permitted_signs(values: Mapping[str, float]) -> dict[str, float]:
    """Replace negative values of quantities that cannot be negative by zero."""
    return {name: max(value, 0.0) if name in _positive() else value for name, value in values.items()}


def _possible(values: Mapping[str, float]) -> bool:
    """Check whether rigid bodies with these ratios exist."""
    a, d = values["a/b"], values["d/b"]
    return a > d * d and d > 0 and values["e1/b"] > 0


def scaled_effects(
    component: PosteriorComponent, values: Mapping[str, float], interval: tuple[float, float], rng: np.random.Generator
) -> tuple[float, dict[str, dict[str, float]]]:
    """Draw the scale, and convert the drawn effects to this scale.

    Args:
        component: the drawn set of effects
        values: drawn values of the ratios and of the parameters
        interval: 90 % interval of the scale, relative to its value, if the scale is not in the posterior
        rng: random numbers

    Returns:
        the ratio of the drawn scale to the scale of the posterior, and the effects at the drawn scale
    """
    if "b" in component.free:
        factor, powers = values["b"] / component.ratios["b"], {}
    else:
        z, (low, high) = float(rng.standard_normal()), (float(np.log(end)) / NORMAL_Q90 for end in interval)
        factor = float(np.exp(z * (high if z > 0 else -low)))
        powers = {f"{name}.{p.name}": p.scale_power for name, effect in EFFECTS.items() for p in effect.parameters}
    return factor, {
        name: {key: values[f"{name}.{key}"] * factor ** powers.get(f"{name}.{key}", 0) for key in parameters}
        for name, parameters in component.effects.items()
        if name in EFFECTS and not EFFECTS[name].event
    }


def _with_values(
    model: Model, component: PosteriorComponent, values: Mapping[str, float], rng: np.random.Generator
) -> Model:
    b, scale = model.base["b"].value, model.scale
    low, high = (end / scale.b for end in scale.interval90_of_sizes) if scale else (1.0, 1.0)
    factor, effects = scaled_effects(component, values, (low, high), rng)
    base = b * factor * base_from_ratios(np.array([values[name] for name in RATIOS]))
    sampled = model.with_ratios([values[name] for name in RATIOS]).with_base(base.tolist())
    return sampled.model_copy(update={"effects": effects})


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

    return [first_possible(draw, partial(_has_bodies, rig)).with_arm_effects() for _ in range(n)]


def widened_model(model: MovingArmModel, factor: float) -> MovingArmModel:
    """Multiply the standard deviations of a model's ratios and scale by a factor."""
    covariance = (factor**2 * np.array(model.covariance)).tolist()
    scale = model.absolute[model.scale]
    absolute = dict(model.absolute) | {model.scale: scale.model_copy(update={"std": factor * scale.std})}
    return model.model_copy(update={"covariance": covariance, "absolute": absolute})


def _has_bodies(rig: Rig, model: MovingArmModel) -> bool:
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
    return model.with_swing(swing.tolist(), float(scale.value * factor))


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
