"""Torque constant error: known torques were computed with a wrong torque constant."""

from dataclasses import replace

from dpr_lab.effects.at_arm import at_arm
from dpr_lab.effects.effect import BenchQuantity, EffectParameter, Params, Words, pair
from dpr_lab.kernels import inlined


@inlined
def rescaled(torque: float, excess: float) -> float:
    """Return the difference between acting and known torque, N m.

    It is `excess` times the known torque.
    """
    return excess * torque


def gear(params: Params) -> Words:
    """Return the gain of the drive as the element `gear`: acting torque divided by known torque."""
    return {"gear": 1.0 + params["excess"]}


_JOINT1, _JOINT2 = pair(
    "torque_scale",
    words="torque constant error, joint {j}",
    kernel=rescaled,
    exported=gear,
    equation="(1 + x) tau acts at joint {j}, with tau the known torque",
    parameters=(EffectParameter("excess", "1", 0.05, most=0.9),),
    site="drive",
    stage="drive",
    quantities=(
        BenchQuantity(
            "gain error of the torque", "x", ("excess",), definition="acting torque divided by known torque, minus 1"
        ),
    ),
    symptom="The residual of joint {j} is proportional to the torque of its drive, and vanishes in free swings.",
    bench_check=(
        "Hold the rod after joint {j} horizontal against a spring scale and command a torque: force times"
        " lever arm is the torque of the drive. Or attach a known mass: it determines the scale of all torques"
        " without the drives."
    ),
    source="Swevers, Verdonck & De Schutter (2007), Dynamic model identification for industrial robots, IEEE CSM 27.",
)

TORQUE_SCALE = [replace(_JOINT1, twins=(_JOINT2.name,)), replace(_JOINT2, twins=(_JOINT1.name,))]
"""Torque constant errors of joints 1 and 2; the two effects are indistinguishable alternatives.

An equal error of both joints only changes the common scale of the rig. Only the ratio of the two gains 1 + x is
therefore identifiable.
"""

TORQUE_SCALE_JOINT0 = at_arm(
    _JOINT1,
    twins=(),
    equation="(1 + x) tau acts on the arm, with tau the known torque",
    symptom="The residual of the arm is proportional to the input, and vanishes without an input.",
    bench_check=(
        "Hold the arm's tip against a spring scale and command a steady input: force times length divided by the input"
        " is the gain. With a voltage drive measure the winding's resistance too: the gain is kt gear / R."
    ),
)
