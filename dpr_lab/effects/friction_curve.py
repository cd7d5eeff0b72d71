"""Free-form friction curve: friction torque that increases piecewise linearly with speed.

The friction at rest may differ between the two directions, as for a skewed seal or a preloaded bearing.
"""

from dpr_lab.effects.at_arm import at_arm
from dpr_lab.effects.effect import BenchQuantity, EffectParameter, pair
from dpr_lab.effects.quantities import Joint
from dpr_lab.kernels import inlined

_LABELS = {
    "forward": "forward",
    "backward": "backward",
    "rise1": "rise (0 to 0.3 rad/s)",
    "rise2": "rise (0.3 to 1 rad/s)",
    "rise3": "rise (1 to 3 rad/s)",
    "rise4": "rise (3 to 8 rad/s)",
}


@inlined
def _ramp(speed: float, low: float, high: float) -> float:
    return min(max((speed - low) / (high - low), 0.0), 1.0)


@inlined
def curve(
    joint: Joint,
    forward_Nm: float,
    backward_Nm: float,
    rise1_Nm: float,
    rise2_Nm: float,
    rise3_Nm: float,
    rise4_Nm: float,
) -> float:
    """Return the friction torque on the following rod, N m.

    Its magnitude is a constant plus a linear rise between each pair of the speeds 0, 0.3, 1, 3, 8 rad/s. Above 8 rad/s
    it is constant.
    """
    speed = joint.speed * joint.direction
    size = forward_Nm if joint.direction > 0.0 else backward_Nm
    size += rise1_Nm * _ramp(speed, 0.0, 0.3)
    size += rise2_Nm * _ramp(speed, 0.3, 1.0)
    size += rise3_Nm * _ramp(speed, 1.0, 3.0)
    size += rise4_Nm * _ramp(speed, 3.0, 8.0)
    return -size * joint.direction


FRICTION_CURVE = pair(
    "friction_curve",
    words="free-form friction curve, joint {j}",
    kernel=curve,
    nested=("coulomb",),
    adds="rise1_Nm",
    twins=("stribeck",),
    equation=(
        "tau = -sgn(u) (F + sum_k rise_k ramp_k(|u|)), F = forward for u > 0 and backward for u < 0, each ramp_k going"
        " from 0 to 1 between two of the speeds 0, 0.3, 1, 3, 8 rad/s of joint {j}; at rest tau balances the other"
        " torques, up to |tau| = F"
    ),
    parameters=tuple(
        EffectParameter(f"{name}_Nm", "N m", 5e-4, "positive", label=label) for name, label in _LABELS.items()
    ),
    stage="torque",
    dry=True,
    dissipative=True,
    quantities=(
        BenchQuantity("friction torque at low speed, forward", "F forward", ("forward_Nm",)),
        BenchQuantity("friction torque at low speed, backward", "F backward", ("backward_Nm",)),
        BenchQuantity("rise of the friction torque from 0 to 0.3 rad/s", "rise_1", ("rise1_Nm",)),
    ),
    symptom=(
        "Coulomb and viscous friction together do not fit both large and small swings: the friction torque of"
        " joint {j} is another function of the speed, or differs between the directions."
    ),
    bench_check=(
        "Drive joint {j} at constant speeds with a falling weight, or compare the decay of swings of"
        " different amplitudes: the energy loss at each speed gives the curve directly."
    ),
    source=(
        "Isotonic (monotone) regression, Robertson, Wright & Dykstra (1988), Order Restricted Statistical Inference;"
        " the application to a bearing is not from this source."
    ),
)

FRICTION_CURVE_JOINT0 = at_arm(
    FRICTION_CURVE[0],
    twins=("stribeck_joint0", "air_drag_joint0"),
    symptom=(
        "The torque that keeps the arm at a constant speed is not a linear function of the speed, or differs between"
        " the directions."
    ),
    bench_check="Remove the rods and drive the arm at constant speeds: the torque at each speed is the curve.",
)
