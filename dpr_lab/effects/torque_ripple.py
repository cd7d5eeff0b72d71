"""Torque ripple: the torque constant of a drive depends on the angle of its rotor."""

from dpr_lab.effects.at_arm import at_arm
from dpr_lab.effects.effect import BenchQuantity, EffectParameter, pair, shape
from dpr_lab.effects.elementary import sincos
from dpr_lab.effects.quantities import Joint
from dpr_lab.kernels import inlined


@inlined
def rippled(torque: float, joint: Joint, cos_share: float, sin_share: float, order: float) -> float:
    """Return the difference between acting and known torque, N m.

    The difference is proportional to the torque and periodic in the joint angle.
    """
    sin, cos = sincos(order * joint.angle)
    return torque * (cos_share * cos + sin_share * sin)


TORQUE_RIPPLE = pair(
    "torque_ripple",
    words="torque ripple, joint {j}",
    kernel=rippled,
    equation="tau (1 + A cos(N q) + B sin(N q)) acts at joint {j}, with tau the known torque and q the"
    " angle of the joint",
    parameters=(
        EffectParameter("cos_share", "1", 0.05),
        EffectParameter("sin_share", "1", 0.05),
        shape("order", "1", 6.0, tuple(float(order) for order in range(1, 41)), draw=(3.0, 24.0), whole=True),
    ),
    site="drive",
    stage="drive",
    quantities=(
        BenchQuantity("peak torque ripple", "A", ("cos_share", "sin_share"), definition="share of the torque"),
    ),
    symptom=(
        "Under a constant torque the acceleration varies periodically with the angle of joint {j}; without torque it"
        " does not."
    ),
    bench_check=(
        "Turn joint {j} slowly under a constant command against a spring scale: ripple varies with the"
        " angle and increases with the command; cogging remains without a command."
    ),
    source=(
        "Jahns & Soong (1996), Pulsating torque minimization techniques for permanent magnet AC motor drives, IEEE"
        " Trans. Ind. Electron. 43(2): torque that does not increase with the current is cogging (detent)."
    ),
)

TORQUE_RIPPLE_JOINT0 = at_arm(
    TORQUE_RIPPLE[0],
    equation="tau (1 + A cos(N q) + B sin(N q)) acts on the arm, with tau the known torque and q the angle of the arm",
    symptom=(
        "Under a constant input the acceleration of the arm varies periodically with its angle; without an input it"
        " does not."
    ),
    bench_check=(
        "Turn the arm slowly under a constant command against a spring scale: ripple varies with the angle and"
        " increases with the command; cogging remains without a command."
    ),
)
