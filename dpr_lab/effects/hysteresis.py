"""Presliding (Dahl) friction: elastic deflection of a bearing or cable before it slides."""

from dpr_lab.effects.at_arm import at_arm
from dpr_lab.effects.effect import BenchQuantity, EffectParameter, InternalState, pair, shape
from dpr_lab.effects.elementary import exp, tanh
from dpr_lab.effects.quantities import SMOOTHING, Joint
from dpr_lab.kernels import inlined


@inlined
def deflected(presliding: float, displacement: float, length_rad: float) -> float:
    """Return the presliding state after a displacement in one direction.

    The state is the exact solution of Dahl's equation, stable for any displacement.
    """
    side = 1.0 if displacement > 0.0 else -1.0
    return side + (presliding - side) * exp(-abs(displacement) / length_rad)


@inlined
def dahl(joint: Joint, presliding: float, torque_Nm: float, length_rad: float) -> float:
    """Return the friction torque -F z on the following rod, N m.

    F is `torque_Nm` and z is the presliding state after the displacement.
    """
    return -torque_Nm * deflected(presliding, joint.displacement, length_rad)


@inlined
def sliding(speed: float) -> float:
    """Return the presliding state after long sliding, with the sign of the speed."""
    return tanh(speed / SMOOTHING)


HYSTERESIS = pair(
    "hysteresis",
    words="presliding (Dahl) friction, joint {j}",
    kernel=dahl,
    exported=lambda params: {"presliding": (params["torque_Nm"], params["length_rad"])},
    internal=(InternalState("presliding", "1", after=deflected, sliding=sliding),),
    nested=("coulomb",),
    twins=("coulomb",),
    equation="tau = -F z, dz/dx = (1 - z sgn(dx)) / length with x the angle of joint {j}",
    parameters=(
        EffectParameter("torque_Nm", "N m", 5e-4, "positive"),
        shape("length_rad", "rad", 0.03, (0.01, 0.03, 0.1, 0.3), draw=(0.01, 0.2), continuous=True),
    ),
    stage="torque",
    dissipative=True,
    quantities=(BenchQuantity("friction torque at which presliding ends", "F", ("torque_Nm",)),),
    symptom=(
        "The frequency of the last swings increases as their amplitude decreases; after a light push at rest, joint {j}"
        " springs back."
    ),
    bench_check=(
        "Record the last small swings until joint {j} rests: with presliding the frequency increases as the"
        " amplitude decreases, and the rod oscillates before it stops; after a light push at rest it springs back."
    ),
    source="Dahl (1968), A solid friction model, Aerospace Corporation TOR-0158(3107-18)-1, with exponent 1.",
)

HYSTERESIS_JOINT0 = at_arm(
    HYSTERESIS[0],
    symptom=(
        "After a light push the arm springs back. At reversals, its friction torque changes gradually instead of"
        " suddenly."
    ),
    bench_check=(
        "Disconnect the motor, push the arm lightly and let it go: with presliding it springs back, and only a"
        " stronger push moves it permanently. With Coulomb friction alone it stays where it is."
    ),
)
