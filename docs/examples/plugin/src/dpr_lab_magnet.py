"""Eddy-current damper: a magnet at the hanging position brakes a rod of metal that passes it."""

import math

from dpr_lab.effects.effect import Effect, EffectParameter, shape
from dpr_lab.effects.quantities import Joint
from dpr_lab.kernels import inlined


@inlined
def magnet(joint: Joint, damping_Nms: float, width_rad: float) -> float:
    """Braking torque: -c omega exp((cos q - 1) / w^2), N m."""
    return -damping_Nms * joint.speed * math.exp((math.cos(joint.angle) - 1.0) / (width_rad * width_rad))


MAGNETS = tuple(
    Effect(
        name=f"magnet_joint{j}",
        words=f"magnetic damper, joint {j}",
        equation="tau = -c omega exp((cos q - 1) / w^2), with q the angle of the joint from hanging",
        parameters=(
            EffectParameter("damping_Nms", "N m s/rad", 2e-3, "positive"),
            shape("width_rad", "rad", 0.3, (0.15, 0.3, 0.6), continuous=True),
        ),
        site="joint torque",
        stage="torque",
        kernel=magnet,
        joints=(j - 1,),
        dissipative=True,
        symptom=f"The rod after joint {j} loses energy only near its hanging position.",
        bench_check=f"Take away magnets and iron near the hanging position of joint {j}, and record again.",
        source="Eddy currents at low speed: the force is proportional to the speed. Griffiths (2017), Introduction to"
        " Electrodynamics, section 7.1.",
    )
    for j in (1, 2)
)
