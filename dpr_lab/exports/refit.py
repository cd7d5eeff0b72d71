"""Replace effects that a program cannot express by simpler ones, and refit the model.

If an effect is omitted, parameters that were fitted together with it are no longer correct. For example, a viscous
friction may have been estimated as zero only because of the omitted effect. The ratios, the simpler effects, and all
effects that the program supports are therefore refitted.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import ALONE, RATIOS
from dpr_lab.effects import EFFECTS, effect_params, named_params
from dpr_lab.effects.effect import Effect
from dpr_lab.exports import FORMATS
from dpr_lab.exports.bodies import in_words, words_of
from dpr_lab.exports.corrected import rod_values, with_intervals
from dpr_lab.exports.module_parts import known_effects
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.gauss_newton import Fit, fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.bare_model import fit_bare_model
from dpr_lab.gap.conclusion.ratios import determined, fitted_scale, ratios, unknown_covariance
from dpr_lab.gap.conclusion.uncertainty import whole_covariance
from dpr_lab.gap.hypothesis.hypothesis import free_parameters, hypothesis
from dpr_lab.gap.screen.pieces import in_pieces
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.identification.moving_arm.engine import OF_ARM, engine_values, with_engine_values
from dpr_lab.identification.moving_arm.model import AnyModel, MovingArmModel
from dpr_lab.rig import Rig
from dpr_lab.run import Run

MOVING = ("torque", "load", "arm", "torque0", "drive0", "whole0", "input")
"""Stages of the effects that move the rods. Effects of the other stages act only on the readings."""


def fitted_for(formats: Sequence[str], model: AnyModel, runs: Sequence[Run], rig: Rig) -> dict[str, AnyModel]:
    """Choose the model that is written in each format, by format name.

    The given model is chosen if the format can express it. Otherwise, a simpler model is refitted.

    Args:
        formats: names of `FORMATS`
        model: the corrected model
        runs: the runs to fit; a long record is cut, and its held-out pieces are not fitted
        rig: the rig

    Raises:
        RunError: a run is too short, or no initial state fits a run.
    """
    losses = {name: moving_losses(name, model, rig) for name in formats}
    if not any(losses.values()):
        return dict.fromkeys(formats, model)
    problem, bare = _bare_fit(model, runs, rig)
    refitted: dict[frozenset[str], AnyModel] = {frozenset(): model}
    for name, lost in losses.items():
        if lost not in refitted:
            refitted[lost] = _refitted(model, lost, FORMATS[name].words, problem, bare, rig)
    return {name: refitted[lost] for name, lost in losses.items()}


def fitted_in_words(model: AnyModel, words: frozenset[str], runs: Sequence[Run], rig: Rig) -> AnyModel:
    """Refit a model with only those effects that the given simulator elements can express.

    The model is returned unchanged if the elements can express all of its effects.

    Args:
        model: the corrected model
        words: elements of effects that a format supports
        runs: the runs to fit
        rig: the rig

    Raises:
        RunError: as for `fitted_for`.
    """
    lost = frozenset(moving(model)) - set(in_words(model, rig, words))
    if not lost:
        return model
    return _refitted(model, lost, words, *_bare_fit(model, runs, rig), rig)


def unchanged(model: AnyModel, written: AnyModel) -> set[str]:
    """Return the effects that the simpler, written model contains with all their amplitudes."""
    sizes = known_effects(model.effects)
    return {
        name
        for name, values in known_effects(written.effects).items()
        if all(values.get(p.name) for p in EFFECTS[name].amplitudes if sizes.get(name, {}).get(p.name))
    }


def _starts(bare: Estimate, model: AnyModel, rig: Rig) -> list[tuple[Array, Array]]:
    """Return the initial ratios (7,) and effects (SIZE,) of both fits.

    The fits are those of the bare and the corrected model. Both use the inertia b of the corrected model, because free
    swings determine the sizes of effects only relative to b.
    """
    if not isinstance(model, MovingArmModel):
        of_bare = np.append(bare.ratios[: len(RATIOS)], model.unknowns[len(RATIOS) :])
        return [(of_bare, effect_params({})), (model.unknowns, effect_params({}))]
    unknown, params = engine_values(model, rig)
    return [(bare.ratios, bare.params), (unknown, effect_params(named_params(params, among=OF_ARM)))]


def _refitted(
    model: AnyModel, lost: frozenset[str], words: frozenset[str], problem: Problem, bare: Fit, rig: Rig
) -> AnyModel:
    """Refit a model with simpler effects instead of the effects `lost`, and return the best fit.

    The fit starts from several initial values, because a poor initial value can lead to a local minimum.
    """
    effects, fits = _without(model, lost, words), list[Fit]()
    for start, arm in _starts(bare.estimate, model, rig):
        estimate = Estimate.of(start, effect_params(named_params(arm) | effects), bare.estimate.initial)
        of_rods = [effect for effect in effects if EFFECTS[effect].stage in MOVING]
        free = [
            parameter
            for parameter in free_parameters(estimate, of_rods, problem)
            if parameter.name in effects.get(parameter.effect, {parameter.name})
        ]
        fits.append(fit(problem, estimate, free, iterations=20))
    return _with(model, problem, min(fits, key=lambda candidate: candidate.chi2), rig)


def bare_model(model: AnyModel, runs: Sequence[Run], rig: Rig) -> AnyModel:
    """Refit a model without effects to the same runs.

    See `fitted_for` for arguments and errors.
    """
    return _with(model, *_bare_fit(model, runs, rig), rig)


def moving(model: AnyModel) -> list[str]:
    """Select the effects of a model that act on the rods."""
    return [name for name in model.effects if name in EFFECTS and EFFECTS[name].stage in MOVING]


def moving_losses(name: str, model: AnyModel, rig: Rig) -> frozenset[str]:
    """Return the effects on the rods that a format cannot express."""
    return frozenset(FORMATS[name].lost(model, rig)) & frozenset(moving(model))


def _bare_fit(model: AnyModel, runs: Sequence[Run], rig: Rig) -> tuple[Problem, Fit]:
    fitted, *_ = in_pieces(runs, [])
    recordings = Recordings(tuple(record(run, rig) for run in fitted), rig)
    unknown = engine_values(model, rig)[0] if isinstance(model, MovingArmModel) else model.unknowns
    _, problem, bare = fit_bare_model(recordings, unknown)
    return problem, bare.fit


def _without(model: AnyModel, lost: frozenset[str], words: frozenset[str]) -> dict[str, dict[str, float]]:
    """Replace the effects `lost` of a model by simpler effects."""
    known = {name: _without_zeros(name, values) for name, values in known_effects(model.effects).items()}
    remaining = {name: values for name, values in known.items() if name not in lost}
    reduced = {name: values for name in sorted(lost) if (values := _reduced(name, known[name], words))}
    stand_ins = {name for effect in sorted(lost - set(reduced)) for name in _simpler(EFFECTS[effect], words)}
    return remaining | reduced | {name: _typical(EFFECTS[name]) for name in sorted(stand_ins - set(remaining))}


def _without_zeros(name: str, values: Mapping[str, float]) -> dict[str, float]:
    """Omit amplitudes of zero.

    In a further fit they could become nonzero, and no element of the export represents them.
    """
    amplitudes = {p.name for p in EFFECTS[name].amplitudes}
    return {key: value for key, value in values.items() if value or key not in amplitudes}


def _reduced(name: str, values: Mapping[str, float], words: frozenset[str]) -> dict[str, float]:
    """Omit some amplitudes of an effect, so that the given elements can express it.

    The first amplitude is kept. The result is empty if this is not possible. For example, a spring without its cubic
    term is a linear spring.
    """
    further = [p.name for p in EFFECTS[name].amplitudes if p.name in values][1:]
    for count in range(1, len(further) + 1):
        for omitted in combinations(further, count):
            fewer = {key: value for key, value in values.items() if key not in omitted}
            if words.issuperset(words_of({name: fewer}).get(name, {"": None})):
                return fewer
    return {}


def _simpler(effect: Effect, words: frozenset[str]) -> set[str]:
    """Return the names of simpler forms of an effect that the given elements can express."""
    simpler: set[str] = set()
    for name in effect.nested:
        own_words = words_of({name: _typical(EFFECTS[name])}).get(name, {"": None})
        simpler |= {name} if words.issuperset(own_words) else _simpler(EFFECTS[name], words)
    return simpler


def _typical(effect: Effect) -> dict[str, float]:
    return {p.name: p.default if p.role == "shape" else p.typical for p in effect.parameters}


def _with(model: AnyModel, problem: Problem, refitted: Fit, rig: Rig) -> AnyModel:
    """Replace the ratios and effects of a model by the values of a fit, with their intervals."""
    estimate = refitted.estimate
    effects = named_params(estimate.params)
    hypothesis_of_fit = hypothesis(problem, [name for name in effects if name not in OF_ARM], refitted)
    covariance = whole_covariance(problem, hypothesis_of_fit, rig)
    shown, of_shown = determined(problem, refitted, covariance, rig)
    scale = fitted_scale(problem, refitted, covariance, rig)
    if isinstance(model, MovingArmModel):
        changed = with_engine_values(model, estimate.ratios, estimate.params, rig)
        return with_intervals(changed, shown, of_shown, scale)
    intervals = ratios(problem, hypothesis_of_fit, covariance, rig)
    values = rod_values(
        estimate.ratios,
        unknown_covariance(refitted, covariance),
        intervals,
        scale or model.scale,
        problem.segments.setups,
        rig,
        {name: shown[name] for name in ALONE if name in shown},
    )
    return model.model_copy(update=values | {"effects": effects})
