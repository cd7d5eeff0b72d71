"""Named effects with sizes and probabilities, their alternatives, the components they form, and their remedies."""

from collections.abc import Iterable, Mapping, Sequence
from functools import reduce
from typing import Any

import numpy as np

from dpr_lab.effects import EFFECTS, named_params
from dpr_lab.effects.base_tilt import BASE_TILT
from dpr_lab.effects.effect import Effect, Params
from dpr_lab.effects.encoder_drift import ENCODER_DRIFT
from dpr_lab.effects.families import FAMILIES
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.gap.classes.posterior import Alternative, EffectPosterior
from dpr_lab.gap.conclusion.at_rest import NOT_HELD, at_rest
from dpr_lab.gap.conclusion.verdict import VERDICT
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.refits import refit_without
from dpr_lab.gap.result.causes import EffectSize, NamedEffect, NamedFamily, RivalEffect, nameable
from dpr_lab.gap.result.checks import FIXED_MARK, PLUMB_LINE
from dpr_lab.gap.state import Transferred
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.shown import listed

_OF_CAMERA = (
    ((BASE_TILT.name,), "a camera rotated about its optical axis", PLUMB_LINE),
    (tuple(effect.name for effect in ENCODER_DRIFT), "a camera that is not fixed", FIXED_MARK),
)
"""Effects with the signature of an error of a camera, the error, and the check for it."""


def named_effect(state: Transferred, posterior: EffectPosterior, scale: Scale) -> NamedEffect:
    """Describe a selected effect: class, probability, sizes, and unique contribution."""
    selection = state.selection
    values = named_params(selection.chosen.estimate.params).get(posterior.name, {})
    return NamedEffect.model_validate(
        {
            "name": posterior.name,
            "class": list(posterior.members),
            "odds": dict(zip(posterior.members, posterior.odds, strict=False)),
            "forms": list(posterior.forms),
            "probability": posterior.probability,
            "outside": posterior.outside,
            "untested": posterior.untested,
            "parameters": effect_sizes(scale, posterior.name, values, state.intervals),
            "share": selection.unique_share(posterior.name),
        }
    )


def effect_sizes(
    scale: Scale, effect: str, values: Params, half_widths: Mapping[tuple[str, str], float]
) -> dict[str, EffectSize]:
    """Return the fitted and the derived sizes of an effect, with their intervals.

    Args:
        scale: inertia that absolute sizes assume
        effect: name of the effect
        values: fitted value of each parameter
        half_widths: half width of the 90 % interval of each value, by effect and parameter
    """
    errors = {name: half_widths.get((effect, name), 0.0) for name in values}
    sizes = {name: _size(scale, effect, name, value, errors[name]) for name, value in values.items()}
    return sizes | _implied(EFFECTS[effect], values, errors)


def _implied(effect: Effect, values: Params, errors: Params) -> dict[str, Any]:
    """Return derived quantities of an effect, with intervals from independent errors of the parameters.

    The result is empty if the effect defines no derived quantities. A quantity without a finite interval is left out.
    """
    if effect.implied is None:
        return {}
    sizes, squares = effect.implied(values), dict.fromkeys(effect.implied(values), 0.0)
    for name, error in errors.items():
        changed = effect.implied({**values, name: values[name] + error})
        for key in sizes:
            squares[key] += (changed.get(key, np.inf) - sizes[key]) ** 2
    half_widths = {key: float(np.sqrt(square)) for key, square in squares.items() if np.isfinite(square)}
    ends = {key: (sizes[key] - half_width, sizes[key] + half_width) for key, half_width in half_widths.items()}
    return {key: EffectSize(value=sizes[key], interval90=ends[key], interval90_with_scale=ends[key]) for key in ends}


def _size(scale: Scale, effect: str, name: str, value: float, half_width: float) -> EffectSize:
    """Describe the size of a fitted parameter with its intervals."""
    parameter = next(p for p in EFFECTS[effect].parameters if p.name == name)
    floor = 0.0 if parameter.sign == "positive" else -np.inf
    interval, power = (max(value - half_width, floor), value + half_width), parameter.scale_power
    size = EffectSize(value=value, interval90=interval, interval90_with_scale=scale.absolute90(value, interval, power))
    # a clamped elbow determines no ratios to b
    if power == 0 or scale.fixed_by == "data" or scale.sizes90:
        return size
    ratio, *ends = (scale.ratio(x, power) for x in (value, *interval))
    return size.model_copy(update={"ratio": ratio, "ratio_interval90": tuple(ends), "ratio_unit": parameter.ratio_unit})


def rivals(posteriors: Sequence[EffectPosterior], closest: bool) -> list[RivalEffect]:
    """Return the alternatives to the effects of the selected set, most probable first.

    If `closest` is true, no effect is named, and the effects of the selected set precede their alternatives.
    """
    others = [
        _rival(other, (other.name,), other.cosine, posterior.name)
        for posterior in posteriors
        for other in posterior.alternatives
    ]
    others = sorted(others, key=lambda other: (-other.probability, -other.cosine))
    return [*(_rival(posterior, posterior.members, 1.0, "") for posterior in posteriors if closest), *others]


def _rival(cause: EffectPosterior | Alternative, members: Sequence[str], cosine: float, instead_of: str) -> RivalEffect:
    fields = {"name": cause.name, "class": list(members), "probability": cause.probability, "cosine": cosine}
    return RivalEffect.model_validate(fields | {"instead_of": instead_of})


def families(state: Transferred, named: list[NamedEffect]) -> list[NamedFamily]:
    """Return the families to which the named effects belong.

    The probability of a family is the largest probability of its characteristic effects. Friction alone is not evidence
    of a drive, because it may come from a bearing.
    """
    probable = {effect.name: effect.probability for effect in named}
    return [
        NamedFamily(
            name=family.name,
            words=family.words,
            effects=list(parts),
            probability=max(probable[name] for name in parts if name in family.marks),
            share=_share(state, parts),
        )
        for family in FAMILIES
        if (parts := family.among(tuple(probable)))
    ]


def _share(state: Transferred, parts: tuple[str, ...]) -> float:
    """Return the share of the excess chi-square, 0 to 1, that returns if the effects `parts` are removed."""

    def without(model: Hypothesis, name: str) -> Hypothesis:
        return refit_without(state.fitted.problem, model, name, state.selection.bare)

    chosen, total = state.selection.chosen, state.selection.bare.residuals.excess
    returned = reduce(without, parts, chosen).residuals.excess - max(chosen.residuals.excess, 0.0)
    return float(np.clip(returned / total, 0.0, 1.0)) if total > 0 else 0.0


def remedies(
    named: Sequence[NamedEffect], sizes: Mapping[str, Params], rig: RigConstants, held: Mapping[int, float] = NOT_HELD
) -> list[str]:
    """Return the remedies: one sentence per effect with a repair, and one for the simulator.

    No remedy is stated for an effect with a probability below one half, for example if it worsens the free runs.

    Args:
        named: the effects, in order
        sizes: fitted parameters of each effect
        rig: values of the rig file
        held: largest angle from equilibrium at which friction holds each rod, rad, by rod
    """
    sentences: list[str] = []
    for effect in named:
        remedy = EFFECTS[effect.name].remedy
        if remedy is not None and effect.probability >= VERDICT.rather:
            repair = remedy(sizes[effect.name], rig, EFFECTS[effect.name].joints[0])
            sentences.append(
                f"For {effect.name}: {repair}{to_rule_out(effect)}.{at_rest(effect.name, held, fitted=True)}"
            )
    return [*sentences, *to_simulator(named)]


def to_simulator(named: Iterable[NamedEffect]) -> list[str]:
    """Return the sentence on the probable effects that must be added to the simulator; empty if there are none."""
    simulated = [e for e in named if EFFECTS[e.name].remedy is None and e.probability >= VERDICT.rather]
    if not simulated:
        return []
    models = "model.json in the folder of this diagnosis, and the models for other programs, contain"
    return [f"Add {listed([effect.name for effect in simulated])} to the simulator: {models} the fitted sizes."]


def of_camera(named: Sequence[NamedEffect]) -> tuple[list[str], list[str]]:
    """Return warnings and checks for a film, because errors of a camera have the signatures of effects.

    Both lists are empty unless a named effect is, or may be, a base tilt or a drift of an encoder.
    """
    warnings, checks = list[str](), list[str]()
    members = {name for effect in named for name in effect.members}
    for effects, error, check in _OF_CAMERA:
        if names := [name for name in effects if name in members]:
            signature = f"has the same signature as {listed(names)}: check the camera first."
            warnings.append(f"In a film, {error} {signature}")
            checks.append(check)
    return warnings, checks


def to_rule_out(effect: NamedEffect) -> str:
    """Return the parenthesis of a remedy that lists the other members of the class; empty if there are none.

    Members of negligible probability are not listed.
    """
    others = [name for name in nameable(effect.members, effect.odds) if name != effect.name]
    if not others:
        return ""
    if set(others) <= set(effect.only_by_prior):
        has = "has" if len(others) == 1 else "have"
        return f" (these recordings cannot exclude {listed(others)}, which {has} a small prior probability)"
    return f" (first rule out {listed(others)}, which these recordings cannot exclude)"
