"""Free or driven arm: part of every model with a moving arm, not a fault."""

from dpr_lab.effects.effect import ARM, BenchQuantity, Effect, EffectParameter
from dpr_lab.effects.quantities import ArmModel, RigConstants
from dpr_lab.kernels import inlined


@inlined
def arm(constants: RigConstants, inertia_kgm2: float, viscous_Nms: float) -> ArmModel:
    """Return the arm model: total inertia, L0 / g, viscous friction, and zero stiffness."""
    return ArmModel(inertia_kgm2, constants.L0 / constants.g, viscous_Nms, 0.0)


FREE_ARM = Effect(
    name="free_arm",
    words="moving arm",
    equation=(
        "equation of three coordinates (`dpr_lab.dynamics.arm`) with A = J0 + (m1 + m2 + mb) L0^2 and viscous friction"
        " c0, to which the back-EMF of a voltage drive adds ke kt gear^2 / R"
    ),
    parameters=(
        EffectParameter("inertia_kgm2", "kg m^2", 1e-4, "positive", most=100.0),
        EffectParameter("viscous_Nms", "N m s/rad", 1e-4, "positive", most=100.0),
    ),
    site="base",
    stage="free_arm",
    kernel=arm,
    joints=(ARM,),
    quantities=(
        BenchQuantity("total inertia about the arm's axis", "A", ("inertia_kgm2",)),
        BenchQuantity("viscous friction of the arm with back-EMF", "c0", ("viscous_Nms",)),
    ),
    symptom=(
        "The arm turns against the rods, although the rig file describes it as clamped; the rods swing faster than"
        " simulated."
    ),
    bench_check=(
        "Accelerate the arm by a known weight on a string over a pulley and measure the time: torque divided by"
        " acceleration is A."
    ),
    source="Lagrange's equations of the whole rig, `dpr_lab.dynamics.arm`.",
)
