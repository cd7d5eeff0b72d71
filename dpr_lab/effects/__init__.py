"""Physical effects beyond the base model: one file each, one line in the table.

The order of `EFFECTS` fixes the flat parameter vector.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.coulomb import COULOMB_JOINT1, COULOMB_JOINT2
from dpr_lab.effects.effect import Effect
from dpr_lab.effects.fold import fold, slices

EFFECTS: dict[str, Effect] = {effect.name: effect for effect in (COULOMB_JOINT1, COULOMB_JOINT2)}

SLICES = slices(EFFECTS.values())
"""Name of an effect -> its place in the flat vector."""

SIZE = sum(len(effect.parameters) for effect in EFFECTS.values())

effect_torques = fold(EFFECTS.values())


def effect_vector(values: Mapping[str, Mapping[str, float]]) -> NDArray[np.float64]:
    """The flat vector from named coefficients; what is not named is zero, that is off.

    Args:
        values: effect -> parameter -> value, as in `{"coulomb_joint1": {"torque_Nm": 0.001}}`

    Returns:
        (SIZE,) SI

    Raises:
        ValueError: an unknown effect or parameter.
    """
    vector = np.zeros(SIZE)
    for name, coefficients in values.items():
        if name not in EFFECTS:
            raise ValueError(f"no effect {name!r}; there are: {', '.join(EFFECTS)}")
        known = [parameter.name for parameter in EFFECTS[name].parameters]
        for parameter, value in coefficients.items():
            if parameter not in known:
                raise ValueError(f"effect {name} has no parameter {parameter!r}; it has: {', '.join(known)}")
            vector[SLICES[name].start + known.index(parameter)] = value
    return vector
