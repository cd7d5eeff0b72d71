"""Unlogged saturation of a drive: the command exceeds the largest possible torque."""

from dpr_lab.effects.effect import ARM, BenchQuantity, Effect, EffectParameter, shape
from dpr_lab.kernels import inlined


@inlined
def clipped(torque: float, share: float, limit_Nm: float) -> float:
    """Return the difference between acting and known torque, N m.

    Only the part of the known torque above the limit is lost: the difference is minus `share` times the excess.
    """
    return share * (min(max(torque, -limit_Nm), limit_Nm) - torque)


SATURATION_JOINT0 = Effect(
    name="saturation_joint0",
    words="unlogged saturation of the drive, joint 0",
    equation="tau + x (clip(tau, -T, T) - tau) acts on the arm instead of the known torque tau; x = 1: saturated at T",
    parameters=(
        EffectParameter("share", "1", 0.1, "positive", most=1.0, plausible=1.0),
        shape("limit_Nm", "N m", 0.01, tuple(1e-4 * 1.6**k for k in range(20)), draw=(0.005, 0.05), continuous=True),
    ),
    site="drive",
    stage="drive0",
    kernel=clipped,
    joints=(ARM,),
    nested=("torque_scale_joint0",),
    quantities=(BenchQuantity("missing share of the torque above the limit", "x", ("share",)),),
    symptom="At large inputs the arm accelerates less than commanded; at small inputs it follows.",
    bench_check=(
        "Measure the motor's current or voltage at the largest command: with saturation it is smaller than"
        " commanded. Log the output of the drive instead of the command."
    ),
    source="Tao & Kokotovic (1996), Adaptive Control of Systems with Actuator and Sensor Nonlinearities, ch. 2.",
)
