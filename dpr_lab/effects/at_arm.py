"""Effects at the joint of the arm, derived from effects at rod joints."""

from dataclasses import replace
from typing import Any

from dpr_lab.effects.effect import ARM, Effect
from dpr_lab.effects.stages import StageName

ARM_STAGES: dict[StageName, StageName] = {
    "torque": "torque0",
    "drive": "drive0",
    "encoder": "encoder0",
    "timing": "timing0",
}
"""Stages of effects at the arm, by the stage of the same effect at a joint of the rods."""


def at_arm(effect: Effect, *, bench_check: str, symptom: str = "", equation: str = "", **fields: Any) -> Effect:
    """Derive an effect at joint 0, the arm, from the same effect at a rod joint.

    Args:
        effect: effect at joint 1 or 2
        bench_check: check at the arm
        symptom: symptom at the arm
        equation: equation at the arm; empty: the equation of `effect` with the joint number 0
        fields: other fields of `Effect` that differ
    """
    (joint,) = effect.joints

    def renamed(text: str) -> str:
        for word in ("_joint", "joint ", "encoder ", "q"):
            text = text.replace(f"{word}{joint + 1}", f"{word}0")
        return text

    return replace(
        effect,
        **{
            "name": renamed(effect.name),
            "words": renamed(effect.words),
            "equation": equation or renamed(effect.equation),
            "joints": (ARM,),
            "stage": ARM_STAGES[effect.stage],
            "twins": tuple(map(renamed, effect.twins)),
            "nested": tuple(map(renamed, effect.nested)),
            "symptom": symptom,
            "bench_check": bench_check,
            **fields,
        },
    )
