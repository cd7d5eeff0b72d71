"""Rotor inertia at a joint: motor, gear or encoder disc."""

from dpr_lab.effects.effect import BenchQuantity, Effect, EffectParameter, Params, Words
from dpr_lab.effects.quantities import Terms
from dpr_lab.kernels import inlined


@inlined
def rotor1(inertia_kgm2: float) -> Terms:
    """Return the terms of an inertia J that rotates with joint 1, at omega1."""
    return Terms(inertia_kgm2, 0.0, 0.0, 0.0, 0.0)


@inlined
def rotor2(inertia_kgm2: float) -> Terms:
    """Return the contribution of an inertia J that rotates at omega2 - omega1.

    The kinetic energy of this inertia is J (omega2 - omega1)^2 / 2.
    """
    return Terms(inertia_kgm2, inertia_kgm2, -inertia_kgm2, 0.0, 0.0)


def armature(params: Params) -> Words:
    """Return the inertia of the rotor as an element of rigid-body programs."""
    return {"armature": params["inertia_kgm2"]}


_SOURCE = "Spong, Hutchinson & Vidyasagar (2006), Robot Modeling and Control, sec. 7.5 (reflected actuator inertia)."

ROTOR_INERTIA_JOINT1 = Effect(
    name="rotor_inertia_joint1",
    words="rotor inertia, joint 1",
    equation="M11 = a + J",
    parameters=(EffectParameter("inertia_kgm2", "kg m^2", 1e-4, "positive"),),
    site="joint torque",
    stage="torque",
    kernel=rotor1,
    joints=(0,),
    exported=armature,
    absorbed_by=("a",),
    quantities=(BenchQuantity("inertia of the rotor", "J", ("inertia_kgm2",)),),
    symptom="The inner rod swings more slowly than its mass and length predict.",
    bench_check=(
        "Free swings do not distinguish the rotor inertia from the inertia of the inner rod. Swing the inner rod"
        " alone with and without the rotor, and compare the periods."
    ),
    source=_SOURCE,
)

ROTOR_INERTIA_JOINT2 = Effect(
    name="rotor_inertia_joint2",
    words="rotor inertia, joint 2",
    equation="M11 = a + J, M22 = b + J, M12 = d cos(theta1 - theta2) - J",
    parameters=(EffectParameter("inertia_kgm2", "kg m^2", 1e-4, "positive"),),
    site="joint torque",
    stage="torque",
    kernel=rotor2,
    joints=(1,),
    exported=armature,
    quantities=(BenchQuantity("inertia of the rotor", "J", ("inertia_kgm2",)),),
    symptom="The rods swing more slowly relative to each other than their masses and lengths predict.",
    bench_check=(
        "Clamp the inner rod and swing the outer one with and without the rotor of joint 2 (motor, gear, disc): the"
        " period gives its inertia."
    ),
    source=_SOURCE,
)
