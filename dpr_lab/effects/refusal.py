"""Check of a plugin's effect: stage, joints, kernel arguments, and parameters."""

import math
from collections.abc import Iterator

from dpr_lab.effects.effect import Effect
from dpr_lab.effects.fold import arguments
from dpr_lab.effects.kernel_check import compile_errors
from dpr_lab.effects.rig_scales import LIMITS
from dpr_lab.effects.stages import STAGES, StageName


def refusal(effect: Effect) -> str:
    """Describe why an effect is refused; the text is empty if it is accepted."""
    return "; ".join(list(_reasons(effect)) or compile_errors(effect))


def _reasons(effect: Effect) -> Iterator[str]:
    if not (effect.name.isidentifier() and effect.name.isascii()):
        yield "the name of an effect must be an identifier, such as magnet_joint1"
    if effect.stage not in StageName.__args__:
        yield f"no stage {effect.stage!r}; the stages are: {', '.join(StageName.__args__)}"
        return
    if effect.stage in ("play", "play1", "play0", "arm", "input"):
        yield f"the stage {effect.stage!r} is reserved for one effect of dpr-lab"
    if not effect.joints or not set(effect.joints) <= {0, 1}:
        yield f"joints = {effect.joints}: joints are 0 and 1"
    names = [*(state.name for state in effect.internal), *(parameter.name for parameter in effect.parameters)]
    offered = [*STAGES[effect.stage].quantities, *names]
    if unknown := [name for name in arguments(effect.kernel) if name not in offered]:
        yield f"the kernel needs {', '.join(unknown)}; the stage {effect.stage!r} provides: {', '.join(offered)}"
    if not effect.amplitudes:
        yield "an effect needs at least one amplitude, which is zero if the effect is absent"
    for parameter in effect.parameters:
        if not parameter.name.isidentifier() or not math.isfinite(parameter.typical) or parameter.typical <= 0:
            yield (
                f"parameter {parameter.name!r}: its name must be an identifier, and its typical size positive and"
                " finite"
            )
    for parameter in effect.amplitudes:
        limit = parameter.limit or parameter.unit
        if limit not in LIMITS and not math.isfinite(parameter.most):
            yield f"parameter {parameter.name!r}: no limit for {limit!r}: give `most`, or one of: {', '.join(LIMITS)}"
