"""Viscous friction between the outer rod and the ground instead of the inner rod."""

from dpr_lab.effects.effect import BenchQuantity, Effect, EffectParameter
from dpr_lab.effects.quantities import Motion, Terms, torques
from dpr_lab.kernels import inlined


@inlined
def viscous_ground(motion: Motion, friction_Nms: float) -> Terms:
    """Return the friction torque tau2 = -c omega2, N m; c is `friction_Nms`."""
    return torques(0.0, -friction_Nms * motion.omega2)


VISCOUS_GROUND = Effect(
    name="viscous_ground_link2",
    words="viscous friction against ground, outer rod",
    equation="tau2 = -c omega2",
    parameters=(EffectParameter("friction_Nms", "N m s/rad", 1e-4, "positive"),),
    site="joint torque",
    stage="torque",
    kernel=viscous_ground,
    joints=(1,),
    dissipative=True,
    twins=("air_drag_outer", "air_drag_both"),
    quantities=(
        BenchQuantity("viscous friction coefficient of the outer rod relative to the ground", "c", ("friction_Nms",)),
    ),
    symptom="The outer rod loses energy according to its absolute speed, even while joint 2 does not turn.",
    bench_check=(
        "Tape a light card to the outer rod: the air drag becomes several times as large, the friction of the joint"
        " does not change. A release from upright covers the speeds at which linear and quadratic drag differ."
    ),
    source="Stokes' law for slow flow; many models use it by mistake for the friction of joint 2.",
)
