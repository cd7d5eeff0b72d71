"""Convert the identified rig with a moving arm to rigid bodies on hinges.

A swing depends only on the base parameters. The masses can therefore be chosen near those of the rig file. S = d / L1
is the first moment of the outer rod. For any mass m2 > S^2 / b, the distance of the centre of mass is l2 = S / m2, and
the inertia is J2 = b - S^2 / m2 > 0. The inner rod is treated in the same way. The inertia of the arm alone is A - (m1
+ m2) L0^2.
"""

from collections.abc import Mapping

from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.effects.effect import ARM, Words
from dpr_lab.errors import ConfigError
from dpr_lab.exports.rigid_bodies import Arm, Bodies, least_mass, rod_about_joint, words_of_joint
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.rig import Rig


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
    length = model.rig.L1 + sum(words.get("added_length", 0.0) for words in expressed.values())
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
