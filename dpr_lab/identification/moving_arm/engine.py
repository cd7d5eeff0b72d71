"""Convert between moving-arm models and the unknowns of the fitting engine, which can simulate all effects.

The unknowns of the engine are the ratios to b of a rig with both rods, b itself, and p/b. If only the inner rod is
mounted, its motion depends only on a - p, e1 - p g/L1 and c1 (`dpr_lab.dynamics.base`). p = m2 L1^2 is the inertia of
the outer rod's mass at the elbow. The other parameters then have the values of the rig file.
"""

from collections.abc import Mapping

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import BASE, RATIOS, base_parameters, ratios
from dpr_lab.dynamics.moving_arm.swing import SWING_PARAMETERS
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.effects import EFFECTS, effect_params, named_params
from dpr_lab.effects.drive_gain import DRIVE_GAIN
from dpr_lab.effects.free_arm import FREE_ARM
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.fitting.estimate import ON_ELBOW, SCALE
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.identification.moving_arm.setup import drive_gain
from dpr_lab.rig import PARAMETERS, Rig

OF_ARM = (FREE_ARM.name, DRIVE_GAIN.name)
"""Effects of the engine that represent the arm and the gain of its drive in every model, and are not faults."""


def engine_values(model: MovingArmModel, rig: Rig) -> tuple[Array, Array]:
    """Convert a model to the unknowns of the fitting engine.

    Returns:
        (7,) five ratios to b, b and p/b; (SIZE,) effect parameters
    """
    sizes, effects = model.with_arm_effects().sizes, dict(model.with_arm_effects().effects)
    effects[FREE_ARM.name] = {"inertia_kgm2": sizes["A"], "viscous_Nms": sizes["c0"]}
    if model.input and (assumed := drive_gain(rig).value):
        effects[DRIVE_GAIN.name] = {"excess": sizes["gain"] / assumed - 1.0}
    base = base_parameters(rig.nominal, rig.L1, rig.g)
    elbow = float(rig.nominal[PARAMETERS.index("m2")]) * rig.L1**2
    if model.mounted == "both":
        base = np.array([sizes[name] for name in BASE])
    else:
        base *= sizes["a"] / (base[0] - elbow)
        elbow = base[0] - sizes["a"]
        base[[3, 4]] = sizes["e1"] + elbow * rig.g / rig.L1, sizes["c1"]
    return np.array([*ratios(base), base[1], elbow / base[1]]), effect_params(effects)


def engine_constants(model: MovingArmModel, rig: Rig) -> RigConstants:
    """Return the rig constants of the simulation, with the arm length L0 of the model."""
    return rig_constants(rig)._replace(L0=model.sizes["L0"])


def swing_of(unknown: Array, params: Array, mounted: str, driven: bool, rig: Rig) -> tuple[list[float], float]:
    """Convert the unknowns and effects of the engine to `SWING_PARAMETERS`.

    Returns:
        (12,) `SWING_PARAMETERS` divided by the scale; the scale, kg m^2
    """
    effects, b = named_params(params), float(unknown[SCALE])
    whole = dict(zip((name.partition("/")[0] for name in RATIOS), unknown[: len(RATIOS)].tolist(), strict=True))
    elbow = 0.0 if mounted == "both" else float(unknown[ON_ELBOW])
    a, e1 = whole["a"] - elbow, whole["e1"] - elbow * rig.g / rig.L1
    arm = effects.get(FREE_ARM.name, {"inertia_kgm2": 0.0, "viscous_Nms": 0.0})
    excess = effects.get(DRIVE_GAIN.name, {"excess": 0.0})["excess"]
    per = 1.0 if mounted == "both" else a
    scale = b * per
    both_rods = (a, 1.0, whole["d"], e1, whole["c1"], whole["c2"])
    rods = both_rods if mounted == "both" else (1.0, 1.0, 0.0, e1 / a, whole["c1"] / a, 0.0)
    gain = drive_gain(rig).value * (1.0 + excess) if driven else 1.0
    values = (*rods, arm["inertia_kgm2"] / scale, arm["viscous_Nms"] / scale, 0.0, 0.0, gain / scale, rig.L0)
    assert len(values) == len(SWING_PARAMETERS)
    return list(values), scale


def with_engine_values(model: MovingArmModel, unknown: Array, params: Array, rig: Rig) -> MovingArmModel:
    """Return the model with the values (7,) and effect parameters (SIZE,) of the fitting engine."""
    swing, inertia = swing_of(unknown, params, model.mounted, bool(model.input), rig)
    return model.with_swing(swing, inertia).model_copy(update={"effects": named_faults(named_params(params))})


def named_faults(effects: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    """Return the effects without those that represent the arm, and without one-time events."""
    return {name: dict(values) for name, values in effects.items() if name not in OF_ARM and not EFFECTS[name].event}
