"""Error of the length of the inner rod or of gravity: only their quotient acts on the rods."""

from dpr_lab.effects.effect import BenchQuantity, Effect, EffectParameter
from dpr_lab.effects.quantities import BaseParameters, Motion, RigConstants, Terms, torques
from dpr_lab.kernels import inlined


@inlined
def longer(motion: Motion, base: BaseParameters, constants: RigConstants, added_m: float) -> Terms:
    """Return the change of the gravity torque of the outer rod, N m.

    With the length error x, e2 is d g / (L1 + x) instead of d g / L1. The base parameters absorb all other consequences
    of x.
    """
    return torques(0.0, base.e2 * (constants.L1 / (constants.L1 + added_m) - 1.0) * motion.sin2)


WRONG_LENGTH = Effect(
    name="wrong_length_L1",
    words="error of length L1 or gravity",
    equation="e2 = d g / (L1 + x) instead of e2 = d g / L1",
    parameters=(EffectParameter("added_m", "m", 2e-3, most=0.1),),
    site="geometry",
    stage="torque",
    kernel=longer,
    exported=lambda params: {"added_length": params["added_m"]},
    twins=("clock_rate",),
    corrects="L1",
    universal=True,
    common=True,
    remedy=lambda params, rig, joint: (
        "measure L1 again, look up g, and correct the wrong value in the rig file: these recordings determine only"
        f" their ratio, L1 = {rig.L1 + params['added_m']:.5g} m with g = {rig.g:.5g} m/s^2, or"
        f" g = {rig.g * rig.L1 / (rig.L1 + params['added_m']):.5g} m/s^2 with L1 = {rig.L1:.5g} m"
    ),
    quantities=(
        BenchQuantity("error of the length L1", "x", ("added_m",), definition="true L1 minus L1 of the rig file"),
    ),
    symptom=("The period of the outer rod and its coupling to the inner rod contradict each other in every recording."),
    bench_check=(
        "Measure L1 between the axes of the joints with a calliper and look up the local gravity; the clock error of"
        " a crystal is at most 0.01 %, so a larger error is due to the length (or gravity)."
    ),
    source="Equation (1): d, e2, g and L1 occur together only in e2 = d g / L1.",
)
