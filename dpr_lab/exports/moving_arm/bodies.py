"""The identified rig with a moving arm as rigid bodies on hinges.

Masses follow from those of the rig file, because a swing depends on the base parameters alone. With S = d / L1, the
moment of the outer rod, any m2 > S^2 / b gives l2 = S / m2 and J2 = b - S^2 / m2; likewise for the inner rod. The arm's
own inertia is A - (m1 + m2) L0^2.
"""

from dataclasses import dataclass

from dpr_lab.dynamics.moving_arm.swing import SWING_PARAMETERS
from dpr_lab.errors import ConfigError
from dpr_lab.exports.bodies import Rod
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.rig import Rig


@dataclass(frozen=True, slots=True)
class ArmBodies:
    """Arm and rods; SI."""

    length: float
    """Distance of the rods' plane from the arm's axis, m."""
    inertia: float
    """Inertia of the arm alone, kg m^2."""
    damping: float
    """Viscous friction of the arm, with the back-EMF of a voltage drive, N m s/rad."""
    stiffness: float
    """Stiffness of the arm's spring, N m/rad."""
    friction: float
    """Coulomb friction of the arm, N m."""
    gain: float
    """Torque per input; zero without a drive."""
    gravity: float
    rods: tuple[Rod, ...]
    """The inner rod, and the outer rod if it is mounted."""


def absolute_parameters(model: MovingArmModel) -> dict[str, float]:
    """`SWING_PARAMETERS` at the scale of the model, SI."""
    scale = model.absolute[model.scale].value
    values = dict(zip(SWING_PARAMETERS, model.swing, strict=True))
    return {name: value if name == "L0" else value * scale for name, value in values.items()}


def arm_bodies(model: MovingArmModel, rig: Rig, margin: float = 1.05) -> ArmBodies:
    """Bodies with the motion of the model.

    Args:
        model: the model
        rig: its rig
        margin: smallest mass of a rod, relative to the smallest that its moment and inertia allow

    Raises:
        ConfigError: the recordings determine no inertia of the arm, or no bodies with positive masses have this motion.
    """
    if "A" not in {name.split("/")[0] for name in model.ratios}:
        raise ConfigError(
            "the recordings of this model do not determine the inertia of the arm, which bodies need: identify from"
            " recordings with a free arm, or one that is driven by a torque, current or voltage; or export to python"
        )
    values = absolute_parameters(model)
    both, L1, L0 = model.mounted == "both", model.rig.L1, values["L0"]
    S2 = values["d"] / L1 if both else 0.0
    least2 = S2**2 / values["b"] if both else 0.0
    nominal1, nominal2 = rig.parameters["m1"].nominal, rig.parameters["m2"].nominal if both else 0.0
    for share in (1.0, 0.5, 0.25, 0.0):  # smaller masses of the rods leave a larger inertia for the arm
        m2 = max(share * nominal2, margin * least2)
        S1, about1 = values["e1"] / model.rig.g - m2 * L1, values["a"] - m2 * L1**2
        if about1 <= 0.0:
            continue
        m1 = max(share * nominal1, margin * S1**2 / about1, 1e-6)
        alone = values["A"] - (m1 + m2) * L0**2
        if alone > 0.0:
            inner = _rod(L1, m1, S1, about1, values["c1"])
            outer = (_rod(rig.L2 or 2 * S2 / m2, m2, S2, values["b"], values["c2"]),) if both else ()
            gain = values["gain"] if model.input else 0.0
            return ArmBodies(
                L0, alone, values["c0"], values["k0"], values["f0"], gain, model.rig.g, (inner, *outer)
            )  # fmt: skip
    raise ConfigError("no bodies with positive masses move as this model does: export to python")


def _rod(length: float, mass: float, moment: float, about_joint: float, damping: float) -> Rod:
    centroid = moment / mass
    return Rod(length, mass, centroid, 0.0, about_joint - mass * centroid**2, damping, {})
