"""Offset of the centre of mass from a rod's axis, for example of a bent rod.

The centre of mass lies at l (sin t, cos t) + y (cos t, -sin t) from its pivot, where t is the angle of the rod. For the
outer rod, with p = m2 L1 y and the difference angle D = t1 - t2, the kinetic energy increases by p sin(D) w1 w2 and (m2
y^2 / 2) w2^2.
"""

from dpr_lab.effects.effect import BenchQuantity, Effect, EffectParameter
from dpr_lab.effects.quantities import Motion, RigConstants, Terms
from dpr_lab.kernels import inlined


@inlined
def inner(motion: Motion, constants: RigConstants, offset_m: float) -> Terms:
    """Return the gravity torque m1 g y cos(theta1) and inertia m1 y^2 of the offset y."""
    moment = constants.m1 * offset_m
    return Terms(moment * offset_m, 0.0, 0.0, moment * constants.g * motion.cos1, 0.0)


@inlined
def outer(motion: Motion, constants: RigConstants, offset_m: float) -> Terms:
    """Return the terms of an offset of the outer rod's centre of mass.

    The terms are inertia, coupling inertia, gravity torque and centrifugal torques.
    """
    moment = constants.m2 * offset_m
    sin12 = motion.sin1 * motion.cos2 - motion.cos1 * motion.sin2
    cos12 = motion.cos1 * motion.cos2 + motion.sin1 * motion.sin2
    carried = moment * constants.L1
    whirl = carried * cos12
    return Terms(
        0.0,
        moment * offset_m,
        carried * sin12,
        whirl * motion.omega2 * motion.omega2,
        moment * constants.g * motion.cos2 - whirl * motion.omega1 * motion.omega1,
    )


_SOURCE = "Lagrange's equations of a rod whose centre of mass is not on the line of its pivots; derived here."

COM_OFFSET_LINK1 = Effect(
    name="com_offset_link1",
    words="offset of the centre of mass, inner rod",
    equation="tau1 = m1 g y cos(theta1), M11 = a + m1 y^2",
    parameters=(EffectParameter("offset_m", "m", 2e-3),),
    site="geometry",
    stage="torque",
    kernel=inner,
    exported=lambda params: {"offset": params["offset_m"]},
    joints=(0,),
    twins=("detent_joint1",),
    quantities=(BenchQuantity("offset of the centre of mass across the inner rod", "y", ("offset_m",)),),
    symptom="The inner rod rests away from the vertical although its encoder is zeroed correctly.",
    bench_check=(
        "Mount the inner rod alone and compare its rest position with a plumb line. Remove the motor of joint 1 and"
        " repeat: a deflection caused by cogging vanishes, a deflection caused by the centre of mass remains."
    ),
    source=_SOURCE,
)

COM_OFFSET_LINK2 = Effect(
    name="com_offset_link2",
    words="offset of the centre of mass, outer rod",
    equation=(
        "M12 = d cos(D) + p sin(D), M22 = b + m2 y^2, tau1 = p cos(D) omega2^2,"
        " tau2 = m2 g y cos(theta2) - p cos(D) omega1^2, p = m2 L1 y, D = theta1 - theta2"
    ),
    parameters=(EffectParameter("offset_m", "m", 2e-3),),
    site="geometry",
    stage="torque",
    kernel=outer,
    exported=lambda params: {"offset": params["offset_m"]},
    joints=(1,),
    twins=("encoder_offset_joint2",),
    quantities=(BenchQuantity("offset of the centre of mass across the outer rod", "y", ("offset_m",)),),
    symptom=(
        "The outer rod rests away from the vertical although its encoder is zeroed correctly. If the rod is turned by"
        " 180 degrees about its long axis, it rests on the other side."
    ),
    bench_check=(
        "Remove the outer rod and balance it on a knife edge parallel to its axis: it tips to the side of the centre of"
        " mass."
    ),
    source=_SOURCE,
)
