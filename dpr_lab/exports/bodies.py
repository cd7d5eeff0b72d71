"""Convert the corrected model to rigid bodies on hinges.

The effects are represented by elements that simulators have in common (`Words`).

With a moving arm, a swing depends only on the base parameters. The masses can therefore be chosen near those of the rig
file. S = d / L1 is the first moment of the outer rod. For any mass m2 > S^2 / b, the distance of the centre of mass is
l2 = S / m2, and the inertia is J2 = b - S^2 / m2 > 0. The inner rod is treated in the same way. The inertia of the arm
alone is A - (m1 + m2) L0^2.
"""

import json
from collections.abc import Collection, Mapping

from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.effects import EFFECTS, effect_params
from dpr_lab.effects.effect import ARM, Words
from dpr_lab.effects.effect_kernels import active_effects, arm_model
from dpr_lab.effects.quantities import HELD_ARM
from dpr_lab.errors import ConfigError
from dpr_lab.exports.module_parts import base_of, constants_of, known_effects
from dpr_lab.exports.rigid_bodies import Arm, Bodies, added_length, least_mass, rod_about_joint, words_of_joint
from dpr_lab.identification.model import Model
from dpr_lab.identification.moving_arm.model import AnyModel, MovingArmModel
from dpr_lab.rig import Rig

Effects = Mapping[str, Mapping[str, float]]
"""Sizes of effects by effect and parameter, SI."""


def words_of(effects: Effects) -> dict[str, Words]:
    """Map each effect to simulator elements; omit effects that these elements do not represent completely."""
    expressed = {}
    for name, values in effects.items():
        effect = EFFECTS.get(name)
        known = {p.name: values.get(p.name, p.default) for p in effect.parameters} if effect else {}
        if effect is not None and effect.exported is not None and (words := effect.exported(known)):
            expressed[name] = words
    return expressed


def in_words(model: AnyModel, rig: Rig, known: frozenset[str]) -> dict[str, Words]:
    """Map each effect that a program can express to simulator elements.

    `known` contains the elements that the program supports.
    """
    expressed = {name: words for name, words in words_of(model.effects).items() if known.issuperset(words)}
    # In a simulator, tilted gravity acts in all directions; this effect acts only in the plane of the rods.
    if isinstance(model, MovingArmModel):
        return {name: words for name, words in expressed.items() if not {"arm", "tilt"} & set(words)}
    return {name: words for name, words in expressed.items() if "arm" not in words or arm_of(model, rig) is not None}


def left_out(model: AnyModel, expressed: Collection[str], program: str) -> dict[str, str]:
    """Return the effects that a program cannot express, with a reason for each."""
    return {name: _reason(name, model.effects[name], program) for name in model.effects if name not in expressed}


def _reason(name: str, values: Mapping[str, float], program: str) -> str:
    if name not in EFFECTS:
        return "unknown effect in this version of dpr-lab"
    if EFFECTS[name].driven:
        return "the inputs of the model are the acting torques, without drives"
    if words := words_of({name: values}).get(name):
        return f"{program} has no element for {' and '.join(words)}"
    if EFFECTS[name].stage in ("timing", "timing0", "encoder", "encoder0", "play", "play1", "play0"):
        return f"{program} describes bodies, but not encoder readings"
    for parameter in EFFECTS[name].amplitudes[1:]:
        if words_of({name: {**values, parameter.name: 0.0}}):
            return f"{program} has no element for its parameter {parameter.name}"
    return f"{program} has no element for this effect"


def bodies(model: AnyModel, rig: Rig, expressed: Mapping[str, Words]) -> Bodies:
    """Construct rigid bodies that move according to equation (1) of docs/theory.md.

    The bodies include the effects that a format can express. The motion depends only on the base parameters. The bodies
    have the masses of the model, at the scale of its base parameters, if all inertias are then positive.

    Raises:
        ConfigError: no rigid bodies can represent the model with a moving arm.
    """
    if isinstance(model, MovingArmModel):
        return arm_bodies(model, rig, expressed)
    a, b, d, e1, _, c1, c2 = base_of(model)
    values, constants = list(expressed.values()), constants_of(model, rig)
    length = model.rig.L1 + added_length(expressed)
    length2 = rig.L2 or 2 * model.parameters["l2"].value
    m1, m2, mb = _masses(model, length)
    moment1, inertia1 = e1 / model.rig.g - (m2 + mb) * length, a - (m2 + mb) * length**2
    inner, outer = (words_of_joint(expressed, joint) for joint in range(2))
    rods = [rod_about_joint(length, m1, moment1, inertia1, c1, constants.m1, inner)]
    if not model.fitted:
        rods.append(rod_about_joint(length2, m2, d / length, b, c2, constants.m2, outer))
    tilt = sum(words.get("tilt", 0.0) for words in values)
    arm = arm_of(model, rig) if any("arm" in words for words in values) else None
    return Bodies(tuple(rods), mb, model.rig.g, tilt, arm)


def _masses(model: Model, length: float) -> tuple[float, float, float]:
    """Return m1, m2 and mb at the scale of the base parameters, kg.

    A mass that would lead to a negative inertia of a rod is changed. `length` is the length of the inner rod, m. If
    only the inner rod is mounted, m1 includes the parts at joint 2.
    """
    z = {name: parameter.value for name, parameter in model.parameters.items()}
    scale = model.base["b"].value / (z["J2"] + z["m2"] * z["l2"] ** 2)
    m1, m2, mb = (scale * z[name] for name in ("m1", "m2", "mb"))
    a, b, d, e1, *_ = base_of(model)
    if model.fitted:
        return max(m1 + mb, least_mass(e1 / model.rig.g, a)), 0.0, 0.0
    most = 0.99 * a / length**2  # a larger mass at joint 2 would leave no inertia for the inner rod
    m2 = max(min(m2, most), least_mass(d / length, b))
    mb = max(min(mb, most - m2), 0.0)
    tip = m2 + mb
    return max(m1, least_mass(e1 / model.rig.g - tip * length, a - tip * length**2)), m2, mb


def notes(model: AnyModel, corrected: Bodies, lost: Mapping[str, str]) -> list[str]:
    """Describe an exported model: scale, omitted effects, and drive torque."""
    omitted = [f"omitted effects: {json.dumps(dict(lost), ensure_ascii=False)}"] if lost else []
    arm = corrected.arm
    drive = [f"joint0: torque = {arm.gain!r} N m per unit of {arm.input}"] if arm is not None and arm.input else []
    return [model.scale_sentence, *omitted, *drive]


def arm_of(model: Model, rig: Rig) -> Arm | None:
    """Return the compliant arm that an effect describes.

    The result is None without such an effect, or if the inertia of the effect does not exceed that of the rods at the
    end of the arm.
    """
    params = effect_params(known_effects(model.effects))
    held = arm_model(constants_of(model, rig), HELD_ARM, params.tolist(), active_effects(params))
    alone = held.inertia - sum(_masses(model, model.rig.L1)) * rig.rig.L0**2
    if held is HELD_ARM or not 0.0 < alone < float("inf"):
        return None
    return Arm(rig.rig.L0, alone, held.friction, {"stiffness": held.stiffness, "rest_angle": 0.0})


def arm_bodies(model: MovingArmModel, rig: Rig, expressed: Mapping[str, Words]) -> Bodies:
    """Build rigid bodies that move like the model, with the effects of a format.

    Args:
        model: the model
        rig: rig of the model
        expressed: simulator elements of each effect

    Raises:
        ConfigError: the recordings determine no inertia of the arm, or no bodies with positive masses have this motion.
    """
    if f"A/{model.scale}" not in model.ratios:
        raise ConfigError(
            "the recordings of this model do not determine the inertia of the arm, which a format of rigid"
            " bodies requires: identify from recordings with a free arm, or one that is driven by a torque,"
            " current or voltage; or export to python"
        )
    values, both_rods, constants = model.sizes, model.mounted == "both", rig_constants(rig)
    length = model.rig.L1 + added_length(expressed)
    L0, S2 = values["L0"], values["d"] / length if both_rods else 0.0
    least2 = least_mass(S2, values["b"]) if both_rods else 0.0
    nominal1, nominal2 = rig.parameters["m1"].nominal, rig.parameters["m2"].nominal if both_rods else 0.0
    for share in (1.0, 0.5, 0.25, 0.0):  # smaller masses of the rods leave a larger inertia for the arm
        m2 = max(share * nominal2, least2)
        S1, about1 = values["e1"] / model.rig.g - m2 * length, values["a"] - m2 * length**2
        if about1 <= 0.0:
            continue
        m1 = max(share * nominal1, least_mass(S1, about1), 1e-6)
        alone = values["A"] - (m1 + m2) * L0**2
        if alone > 0.0:
            words = [words_of_joint(expressed, joint) for joint in (0, 1)]
            rods = [rod_about_joint(length, m1, S1, about1, values["c1"], constants.m1, words[0])]
            if both_rods:
                length2 = rig.L2 or 2 * S2 / m2
                rods.append(rod_about_joint(length2, m2, S2, values["b"], values["c2"], constants.m2, words[1]))
            held_by = words_of_joint(expressed, ARM)
            arm = Arm(L0, alone, values["c0"], held_by, model.input, values["gain"] if model.input else 0.0)
            return Bodies(tuple(rods), 0.0, model.rig.g, 0.0, arm)
    raise ConfigError("no bodies with positive masses have the motion of this model: export to python")
