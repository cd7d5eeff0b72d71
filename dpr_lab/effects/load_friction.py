"""Load-dependent friction: proportional to the force that the bearing carries."""

from dpr_lab.effects.effect import BenchQuantity, EffectParameter, pair
from dpr_lab.effects.quantities import Joint
from dpr_lab.kernels import inlined


@inlined
def loaded(joint: Joint, friction_radius_m: float) -> float:
    """Torque -mu r |N| sgn(u) on the rod beyond the joint, N m; |N| the joint force."""
    return -friction_radius_m * joint.force * joint.direction


LOAD_FRICTION = pair(
    "load_friction",
    words="load-dependent friction, joint {j}",
    kernel=loaded,
    equation=(
        "tau = -mu r |N| sgn(u) with N the force that joint {j} carries and u its speed; at rest the torque that"
        " holds it, up to mu r |N|"
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
    bench_check="Clamp a known mass to the rod and repeat: load-dependent friction of joint {j} grows with it.",
    source=(
        "Duclos et al. (2024), BAM: better actuator models, arXiv 2410.08650, load-dependent friction; the joint force"
        " is that of the motion without this friction, which it hardly changes."
    ),
)
