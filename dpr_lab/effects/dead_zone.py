"""Dead zone of a drive: small commands cause no torque."""

from dpr_lab.effects.effect import ARM, BenchQuantity, Effect, EffectParameter
from dpr_lab.kernels import inlined


@inlined
def missing_torque(torque: float, width_Nm: float) -> float:
    """Return the difference between acting and known torque, N m.

    Inside the zone, the difference is minus the known torque. Outside, it is half the width of the zone, with the sign
    opposite to the torque.
    """
    return -min(max(torque, -width_Nm), width_Nm)


DEAD_ZONE_JOINT0 = Effect(
    name="dead_zone_joint0",
    words="dead zone of the drive, joint 0",
    equation="tau - clip(tau, -x, x) acts on the arm instead of the known torque tau",
    parameters=(EffectParameter("width_Nm", "N m", 1e-3, "positive"),),
    site="drive",
    stage="drive0",
    kernel=missing_torque,
    joints=(ARM,),
    twins=("coulomb_joint0",),
    quantities=(BenchQuantity("half width of the dead zone", "x", ("width_Nm",), definition="torque on the arm"),),
    symptom="The arm does not respond to inputs below a threshold; each reversal of the input causes a short pause.",
    bench_check=(
        "Measure the motor's current while the command rises slowly from zero: the command at which the"
        " current starts is the half width of the dead zone. With friction, in contrast, the current flows but"
        " the arm does not move."
    ),
    source="Tao & Kokotovic (1996), Adaptive Control of Systems with Actuator and Sensor Nonlinearities, ch. 2.",
)
