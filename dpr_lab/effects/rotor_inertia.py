"""Rotor inertia at a joint: motor, gear or encoder disc."""

from collections.abc import Callable
from typing import Any

from dpr_lab.effects.effect import BenchQuantity, Effect, EffectParameter
from dpr_lab.effects.quantities import Terms
from dpr_lab.kernels import inlined


@inlined
def rotor1(inertia_kgm2: float) -> Terms:
    """Return the terms of an inertia J that rotates at omega1."""
    return Terms(inertia_kgm2, 0.0, 0.0, 0.0, 0.0)


@inlined
def rotor2(inertia_kgm2: float) -> Terms:
    """Return the terms of an inertia J that rotates at omega2 - omega1.

    The kinetic energy of this inertia is J (omega2 - omega1)^2 / 2.
    """
    return Terms(inertia_kgm2, inertia_kgm2, -inertia_kgm2, 0.0, 0.0)


def _of_joint(number: int, kernel: Callable[..., Terms], **fields: Any) -> Effect:
    """Return the rotor inertia of joint 1 or 2."""
    return Effect(
        name=f"rotor_inertia_joint{number}",
        words=f"rotor inertia, joint {number}",
        parameters=(EffectParameter("inertia_kgm2", "kg m^2", 1e-4, "positive"),),
        site="joint torque",
        stage="torque",
        kernel=kernel,
        joints=(number - 1,),
        exported=lambda params: {"armature": params["inertia_kgm2"]},
        quantities=(BenchQuantity("inertia of the rotor", "J", ("inertia_kgm2",)),),
        source=(
            "Spong, Hutchinson & Vidyasagar (2006), Robot Modeling and Control, sec. 7.5 (reflected actuator inertia)."
        ),
        **fields,
    )


ROTOR_INERTIA_JOINT1 = _of_joint(
    1,
    rotor1,
    equation="M11 = a + J",
    absorbed_by=("a",),
    symptom="The inner rod swings more slowly than its mass and length predict.",
    bench_check=(
        "Free swings do not distinguish the rotor inertia from the inertia of the inner rod. Swing the inner rod"
        " alone with and without the rotor, and compare the periods."
    ),
)

ROTOR_INERTIA_JOINT2 = _of_joint(
    2,
    rotor2,
    equation="M11 = a + J, M22 = b + J, M12 = d cos(theta1 - theta2) - J",
    symptom="The rods swing more slowly relative to each other than their masses and lengths predict.",
    bench_check=(
        "Clamp the inner rod and swing the outer one with and without the rotor of joint 2 (motor, gear, disc): the"
        " period gives its inertia."
    ),
)
