"""Hard stop of the arm: an end stop, or the end of its cable."""

import math

from dpr_lab.effects.effect import ARM, BenchQuantity, Effect, EffectParameter, Params, shape
from dpr_lab.effects.quantities import Joint
from dpr_lab.kernels import inlined


@inlined
def stopped(joint: Joint, stiffness_Nm_per_rad: float, range_rad: float) -> float:
    """Return the torque of a stiff spring at either end of the range, N m."""
    beyond = max(joint.angle - range_rad, 0.0) + min(joint.angle + range_rad, 0.0)
    return -stiffness_Nm_per_rad * beyond


def within_turns(params: Params, *, most_rad: float = 3 * math.pi) -> bool:
    """Return whether the range ends within one and a half turns.

    If the torque begins only after more turns, it is not caused by a stop.
    """
    return params.get("range_rad", 0.0) <= most_rad


HARD_STOP_JOINT0 = Effect(
    name="hard_stop_joint0",
    words="hard stop of the arm",
    equation="tau = -K (|q| - Q) sgn(q) where the angle q of the arm is beyond the range Q on either side",
    parameters=(
        EffectParameter("stiffness_Nm_per_rad", "N m/rad", 1e-2, "positive", most=100.0),
        shape("range_rad", "rad", 1.0, tuple(0.15 * 1.25**k for k in range(18)), draw=(0.4, 2.0), continuous=True),
    ),
    site="joint torque",
    stage="torque0",
    kernel=stopped,
    joints=(ARM,),
    potential=True,
    possible=within_turns,
    twins=("spring_joint0",),
    remedy=lambda params, rig, joint: (
        f"keep the arm within {params['range_rad']:.3g} rad of its zero, or give the simulator's arm a range"
    ),
    quantities=(BenchQuantity("stiffness of the stop", "K", ("stiffness_Nm_per_rad",)),),
    symptom="The arm stops or bounces back at the same angle each time.",
    bench_check="Turn the arm by hand to either side: it hits the stop, or its cable tightens, at the estimated range.",
    source="Penalty contact: Gilardi & Sharf (2002), Literature survey of contact dynamics modelling, MMT 37.",
)
