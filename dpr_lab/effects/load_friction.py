"""Load-dependent friction: Coulomb friction proportional to the force on the bearing."""

from dpr_lab.effects.effect import BenchQuantity, EffectParameter, pair
from dpr_lab.effects.quantities import Joint
from dpr_lab.kernels import inlined


@inlined
def loaded(joint: Joint, friction_radius_m: float) -> float:
    """Return the friction torque -mu r |N| sgn(u) on the following rod, N m.

    mu r is the friction radius, |N| the magnitude of the joint force, and u the speed of the joint.
    """
    return -friction_radius_m * joint.force * joint.direction


LOAD_FRICTION = pair(
    "load_friction",
    words="load-dependent friction, joint {j}",
    kernel=loaded,
    equation=(
        "tau = -mu r |N| sgn(u) with N the force on joint {j} and u its speed; at rest tau balances the other"
        " torques, up to |tau| = mu r |N|"
    ),
    parameters=(EffectParameter("friction_radius_m", "m", 1e-4, "positive"),),
    stage="load",
    dry=True,
    dissipative=True,
    quantities=(
        BenchQuantity(
            "friction radius", "mu r", ("friction_radius_m",), definition="friction coefficient times bearing radius"
        ),
    ),
    symptom=(
        "Fast swings lose more than Coulomb friction explains, because the centripetal force loads the bearing of"
        " joint {j}."
    ),
    bench_check="Attach a mass to the rod and repeat: load-dependent friction of joint {j} increases with the mass.",
    source=(
        "Duclos et al. (2024), BAM: better actuator models, arXiv 2410.08650, load-dependent friction; the"
        " joint force is computed without this friction, whose influence on it is small."
    ),
)
