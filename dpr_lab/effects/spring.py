"""Cable spring: elastic torque of a cable across a joint, with any rest angle."""

import math

from dpr_lab.effects.at_arm import at_arm
from dpr_lab.effects.effect import BenchQuantity, EffectParameter, Params, Words, pair
from dpr_lab.effects.quantities import Joint
from dpr_lab.kernels import inlined


@inlined
def elastic(joint: Joint, stiffness_Nm_per_rad: float, cubic_Nm_per_rad3: float, constant_Nm: float) -> float:
    """Return the torque C - k q - k3 q^3 on the following rod, N m, at the joint angle q.

    A spring -K (q - q0) - K3 (q - q0)^3 has C = K q0 + K3 q0^3, k = K + 3 K3 q0^2 and k3 = K3. The remaining term 3 K3
    q0 q^2 is neglected, so that the torque is linear in all amplitudes. For a twisted hose, only C differs from zero.
    """
    return constant_Nm - (stiffness_Nm_per_rad + cubic_Nm_per_rad3 * joint.angle * joint.angle) * joint.angle


def rest_angle(params: Params, *, most_rad: float = math.pi, iterations: int = 20) -> Params:
    """Return the angle, rad from hanging, at which the torque of the spring is zero.

    The result is {} if the angle is beyond half a turn, where the torque is practically constant, or if the stiffness
    is zero. Newton's method starts from C / k, the rest angle without the cubic term, or from half a turn if that is
    less.
    """
    k, cubic, constant = (params.get(name, 0.0) for name in _NAMES)
    if k <= 0.0:
        return {}
    q = min(max(constant / k, -most_rad), most_rad)
    for _ in range(iterations):
        slope = k + 3.0 * cubic * q * q
        q = q - (k * q + cubic * q * q * q - constant) / slope if slope > 0.0 else math.inf
    return {"rest_angle_rad": q} if abs(q) <= most_rad else {}


def is_one_spring(params: Params, tolerance: float = 0.5, small_rad: float = 0.5) -> bool:
    """Return whether a single spring can have these sizes.

    C = K q0 + K3 q0^3 and k = K + 3 K3 q0^2 with K >= 0 imply k >= 3/2 (4 K3 C^2)^(1/3). A stiffness below the fraction
    `tolerance` of this bound is rejected; an example is a constant torque with a hardening term but no stiffness. The
    tolerance allows for the neglected term and for the error of the fit. The torque of a softening spring must be
    restoring at the deflection `small_rad`, apart from a tenth of the constant torque, which counts as an error of the
    fit.
    """
    k, cubic, constant = (params.get(name, 0.0) for name in _NAMES)
    least = tolerance * 1.5 * math.cbrt(4.0 * max(cubic, 0.0) * constant**2)
    pushes = -cubic * small_rad**2 - 0.1 * abs(constant) / small_rad
    return k >= max(least, pushes)


def linear(params: Params, negligible: float = 1e-3) -> Words:
    """Return the stiffness and rest angle of a linear spring.

    The result is {} if the spring has no rest angle, or if its cubic term is not negligible. A cubic term is negligible
    below the fraction `negligible` of the linear torque at half a turn.
    """
    rest, stiffness = rest_angle(params), params.get("stiffness_Nm_per_rad", 0.0)
    if abs(params.get("cubic_Nm_per_rad3", 0.0)) * math.pi**2 > negligible * stiffness or not rest:
        return {}
    return {"stiffness": stiffness, "rest_angle": rest["rest_angle_rad"]}


_NAMES = ("stiffness_Nm_per_rad", "cubic_Nm_per_rad3", "constant_Nm")

SPRING = pair(
    "spring",
    words="cable spring, joint {j}",
    kernel=elastic,
    implied=rest_angle,
    derived=(EffectParameter("rest_angle_rad", "rad", 0.1),),
    exported=linear,
    possible=is_one_spring,
    twins=("encoder_scale",),
    nested=("torque_offset",),
    adds="stiffness_Nm_per_rad",
    equation=(
        "tau = C - k q - k3 q^3 with q the angle of joint {j} from hanging, including full turns; the rest"
        " angle is where tau = 0"
    ),
    parameters=(
        EffectParameter("stiffness_Nm_per_rad", "N m/rad", 1e-3, "positive"),
        EffectParameter("cubic_Nm_per_rad3", "N m/rad^3", 2e-5, one_way=True),
        EffectParameter("constant_Nm", "N m", 4e-4),
    ),
    stage="torque",
    potential=True,
    quantities=(
        BenchQuantity("stiffness of the spring", "k", ("stiffness_Nm_per_rad",)),
        BenchQuantity("constant torque of the spring", "C", ("constant_Nm",)),
    ),
    symptom=(
        "The rest angle or the period of rod {j} differs from its value under gravity alone, and may depend on the"
        " number of whole turns by which the cable is wound up."
    ),
    bench_check=(
        "Remove the cable of joint {j} (or add a second one) and repeat: its torque vanishes (or doubles). Or hold rod"
        " {j} horizontally: if its reading is not 90 degrees from hanging, the angle has a wrong scale or zero, which"
        " imitates a spring."
    ),
    source="Elastic restoring torque with Duffing's cubic term, e.g. Nayfeh & Mook (1979), Nonlinear Oscillations.",
)

SPRING_JOINT0 = at_arm(
    SPRING[0],
    twins=("encoder_scale_joint0", "encoder_offset_joint0", "hard_stop_joint0"),
    equation="tau = C - k q - k3 q^3 with q the angle of the arm including full turns; the rest angle is where tau = 0",
    symptom=(
        "With the motor off the arm returns towards one angle, or the rest angle depends on how far the cable is"
        " wound up."
    ),
    bench_check=(
        "Turn the arm by hand to several angles and let it go with the motor off: a cable pulls it back."
        " Remove the cable, or route it along the axis, and repeat."
    ),
)
