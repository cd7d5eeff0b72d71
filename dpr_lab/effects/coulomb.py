"""Coulomb friction in a rod joint."""

from dpr_lab.effects.at_arm import at_arm
from dpr_lab.effects.effect import BenchQuantity, EffectParameter, pair
from dpr_lab.effects.quantities import Joint
from dpr_lab.kernels import inlined


@inlined
def dry(joint: Joint, torque_Nm: float) -> float:
    """Return the friction torque -F sgn(u) of the joint on the following rod, N m.

    F is `torque_Nm` and u is the speed of the joint.
    """
    return -torque_Nm * joint.direction


COULOMB = pair(
    "coulomb",
    words="Coulomb friction, joint {j}",
    kernel=dry,
    exported=lambda params: {"friction": params["torque_Nm"]},
    twins=("hysteresis",),
    equation="tau = -F sgn(u) with u the speed of joint {j}; at rest tau balances the other torques, up to |tau| = F",
    parameters=(EffectParameter("torque_Nm", "N m", 1e-3, "positive"),),
    stage="torque",
    dry=True,
    dissipative=True,
    common=True,
    quantities=(BenchQuantity("Coulomb friction torque", "F", ("torque_Nm",)),),
    symptom=(
        "The amplitude of joint {j} decreases by equal amounts per cycle; small swings end suddenly, often away"
        " from the vertical."
    ),
    bench_check=(
        "Let joint {j} alone swing by a few degrees until it rests: with Coulomb friction the peaks"
        " decrease along a straight line and the rod stops away from the vertical; viscous friction gives a"
        " decaying exponential."
    ),
    source=(
        "Armstrong-Helouvry, Dupont & Canudas de Wit (1994), A survey of models, analysis tools and compensation"
        " methods for the control of machines with friction, Automatica 30(7), 1083-1138."
    ),
)

COULOMB_JOINT0 = at_arm(
    COULOMB[0],
    twins=("hysteresis_joint0", "dead_zone_joint0"),
    symptom="The arm does not follow small torques, and stops abruptly when the input ends.",
    bench_check=(
        "Remove the rods, disconnect the motor, and turn the arm slowly with a spring scale at its tip: force"
        " times length is the Coulomb friction torque, equal in both directions."
    ),
)
