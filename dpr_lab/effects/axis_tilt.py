"""Tilt of the arm's axis, which makes gravity torques depend on the arm angle."""

from dpr_lab.effects.effect import ARM, BenchQuantity, Effect, EffectParameter
from dpr_lab.effects.elementary import sincos
from dpr_lab.effects.quantities import BaseParameters, Motion
from dpr_lab.kernels import inlined


@inlined
def leaning(
    motion: Motion, base: BaseParameters, along_rad: float, across_rad: float, along_Nm: float, across_Nm: float
) -> tuple[float, float, float]:
    """Return the torques on theta0, theta1 and theta2 to first order in the tilt, N m.

        tau0 = K_t - (e1 sin(theta1) + e2 sin(theta2)) p_r,    tau_i = e_i cos(theta_i) p_t

    The component of gravity perpendicular to the axis is p g. The part p_r of p is along the arm, and p_t is across it.
    K_t is the component across the arm of K = S g p, where S is the first moment of arm and rods about the axis. S also
    depends on a counterweight, so K is fitted.
    """
    sin0, cos0 = sincos(motion.theta0)
    radial, tangential = along_rad * cos0 + across_rad * sin0, across_rad * cos0 - along_rad * sin0
    torque0 = across_Nm * cos0 - along_Nm * sin0 - (base.e1 * motion.sin1 + base.e2 * motion.sin2) * radial
    return torque0, base.e1 * motion.cos1 * tangential, base.e2 * motion.cos2 * tangential


AXIS_TILT_JOINT0 = Effect(
    name="axis_tilt_joint0",
    words="tilt of the arm's axis",
    equation=(
        "Y cos(q) - X sin(q) - (e1 sin(theta1) + e2 sin(theta2)) p_r acts on the arm and e_i cos(theta_i) p_t on"
        " theta_i, with p_r = x cos(q) + y sin(q), p_t = y cos(q) - x sin(q) and q the angle of the arm"
    ),
    parameters=(
        EffectParameter("along_rad", "rad", 5e-3),
        EffectParameter("across_rad", "rad", 5e-3),
        EffectParameter("along_Nm", "N m", 2e-3),
        EffectParameter("across_Nm", "N m", 2e-3),
    ),
    site="base",
    stage="whole0",
    kernel=leaning,
    joints=(ARM,),
    remedy=lambda params, rig, joint: (
        f"align the arm's axis with the vertical: it is tilted by {1e3 * params['along_rad']:.3g} mrad along"
        f" the arm at its zero, and by {1e3 * params['across_rad']:.3g} mrad across it; or tilt gravity in the"
        " simulator"
    ),
    quantities=(
        BenchQuantity(
            "tilt of the arm's axis", "sqrt(x^2 + y^2)", ("along_rad", "across_rad"), "angle to the vertical"
        ),
    ),
    symptom="Without an input the arm drifts from any initial angle to the same angle, at which the rods are lowest.",
    bench_check=(
        "Put a spirit level on the arm and rotate the arm by half a turn: if the axis is tilted, the bubble moves."
        " Without a motor, the arm comes to rest where the rods are lowest."
    ),
    source="Gravity in the frame of a tilted base, Spong, Hutchinson & Vidyasagar (2006), ch. 7: potential energy.",
)
