"""Drift of viscous friction during a swing, for example of warming grease."""

from dpr_lab.effects.effect import BenchQuantity, EffectParameter, pair
from dpr_lab.effects.quantities import Joint
from dpr_lab.kernels import inlined


@inlined
def drifting(joint: Joint, rate_Nm_per_rad: float) -> float:
    """Return the torque -r t u on the following rod, N m.

    Here r is the rate, t the time since the release, and u the speed of the joint.
    """
    return -rate_Nm_per_rad * joint.t * joint.speed


FRICTION_DRIFT = pair(
    "friction_drift",
    words="viscous friction drift, joint {j}",
    kernel=drifting,
    equation="tau = -r t u: c{j}(t) = c{j} + r t, with t the time since the release",
    parameters=(
        EffectParameter(
            "rate_Nm_per_rad",
            "N m/rad",
            2e-5,
            one_way=True,
            limit="damping per second",
            negative="viscous friction decreases during the swing, for example because grease warms up",
        ),
    ),
    stage="torque",
    quantities=(BenchQuantity("drift rate of the viscous friction coefficient", "r", ("rate_Nm_per_rad",)),),
    symptom=(
        "Late swings of a recording are damped more, or less, than earlier swings of the same amplitude, for example"
        " because the grease warms up."
    ),
    bench_check=(
        "After the last release, let the rods hang for ten minutes and repeat the first release: if the friction of"
        " joint {j} drifts, the two recordings differ by more than their scatter."
    ),
    source="Viscosity of lubricants against temperature: Stachowiak & Batchelor (2013), Engineering Tribology, ch. 2.",
)
