"""Stribeck friction: dry friction that is larger near zero speed than at higher speeds."""

from dpr_lab.effects.at_arm import at_arm
from dpr_lab.effects.effect import BenchQuantity, EffectParameter, pair, shape
from dpr_lab.effects.elementary import exp
from dpr_lab.effects.quantities import Joint
from dpr_lab.kernels import inlined


@inlined
def stribeck(joint: Joint, torque_Nm: float, extra_at_rest_Nm: float, speed_rad_per_s: float) -> float:
    """Return the friction torque -(F + S exp(-(u / u_s)^2)) sgn(u), N m.

    It acts on the following rod. F is `torque_Nm`, S is `extra_at_rest_Nm`, u_s is `speed_rad_per_s`, and u is the
    speed of the joint.
    """
    ratio = joint.speed / speed_rad_per_s
    return -(torque_Nm + extra_at_rest_Nm * exp(-ratio * ratio)) * joint.direction


STRIBECK = pair(
    "stribeck",
    words="Stribeck friction, joint {j}",
    kernel=stribeck,
    nested=("coulomb",),
    adds="extra_at_rest_Nm",
    twins=("friction_curve",),
    equation=(
        "tau = -(F + S exp(-(u / u_s)^2)) sgn(u) with u the speed of joint {j}; at rest tau balances the"
        " other torques, up to |tau| = F + S"
    ),
    parameters=(
        EffectParameter("torque_Nm", "N m", 1e-3, "positive"),
        EffectParameter("extra_at_rest_Nm", "N m", 1e-3, "positive"),
        shape("speed_rad_per_s", "rad/s", 0.3, (0.1, 0.3, 1.0, 3.0), draw=(0.2, 2.0), continuous=True),
    ),
    stage="torque",
    dry=True,
    dissipative=True,
    quantities=(
        BenchQuantity("Coulomb friction torque while sliding", "F", ("torque_Nm",)),
        BenchQuantity("extra friction torque at rest", "S", ("extra_at_rest_Nm",)),
    ),
    symptom=(
        "Joint {j} sticks at its turning points and breaks loose suddenly; the last small swings end earlier than"
        " with Coulomb friction."
    ),
    bench_check=(
        "Pull rod {j} slowly with a spring scale (torque = force times distance from joint {j}): the torque at which it"
        " breaks loose, minus the torque while it slides, is the extra friction at rest."
    ),
    source="Armstrong-Helouvry, Dupont & Canudas de Wit (1994), Automatica 30(7), 1083-1138 (Gaussian form).",
)

STRIBECK_JOINT0 = at_arm(
    STRIBECK[0],
    symptom="The arm starts with a jerk when the input rises slowly, and sticks at reversals.",
    bench_check=(
        "Pull the arm's tip with a spring scale (torque = force times distance from the joint): the torque at which it"
        " breaks loose, minus the torque while it slides, is the extra friction at rest."
    ),
)
