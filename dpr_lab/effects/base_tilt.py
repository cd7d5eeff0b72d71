"""Base tilt: the base leans in the plane of the swing."""

from dpr_lab.effects.effect import BenchQuantity, Effect, EffectParameter
from dpr_lab.effects.elementary import sincos
from dpr_lab.effects.quantities import BaseParameters, Motion, Terms, torques
from dpr_lab.kernels import inlined


@inlined
def tilted(motion: Motion, base: BaseParameters, tilt_rad: float) -> Terms:
    """Return the change of both gravity torques e_i sin(theta_i) by the tilt, N m."""
    lean, cosine = sincos(tilt_rad)
    rise = cosine - 1.0
    torque1 = base.e1 * (motion.sin1 * rise + motion.cos1 * lean)
    return torques(torque1, base.e2 * (motion.sin2 * rise + motion.cos2 * lean))


BASE_TILT = Effect(
    name="base_tilt",
    words="base tilt",
    equation="e1 sin(theta1 + tilt), e2 sin(theta2 + tilt) instead of e1 sin(theta1), e2 sin(theta2)",
    parameters=(EffectParameter("tilt_rad", "rad", 5e-3),),
    remedy=lambda params, rig, joint: (
        f"level the base, which tilts by {1e3 * abs(params['tilt_rad']):.3g} mrad, or tilt gravity in the simulator"
    ),
    site="base",
    presumes_still_arm=True,
    common=True,
    stage="torque",
    kernel=tilted,
    exported=lambda params: {"tilt": params["tilt_rad"]},
    twins=("encoder_offset_joint1",),
    quantities=(BenchQuantity("tilt of the base", "tilt", ("tilt_rad",)),),
    symptom="At rest, both rods show the same absolute deviation from hanging; swings to the two sides differ.",
    bench_check=(
        "Put a spirit level on the base along the plane of the swing. Or read encoder 1 with the rods at rest, turn the"
        " base by 180 degrees and read it again: half the change is the tilt; the zero error of the encoder"
        " does not change."
    ),
    source=(
        "The direction of gravity is rotated in the plane of motion: a common fault of Furuta and cart rigs, e.g."
        " arXiv 2202.01424."
    ),
)
