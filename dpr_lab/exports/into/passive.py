"""Generate MuJoCo passive forces for effects that the user's MJCF or URDF file cannot contain.

The module of passive forces is that of `export --to mjcf` (`dpr_lab.exports.mjcf`). Here it acts on the joints of the
user's file. The module only adds torques. It therefore contains neither effects that change inertias nor compliant
arms. MuJoCo holds joints at rest by the Coulomb friction in the file. The joints of the file therefore receive the
Coulomb friction of the added effects, and the module subtracts this friction while a joint moves.
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.step import motion_of
from dpr_lab.effects import EFFECTS, effect_params
from dpr_lab.effects.effect_kernels import AT_RELEASE, STEPPED, active_effects, effect_torques
from dpr_lab.exports.mjcf import EngineFile, passive, rest_friction
from dpr_lab.exports.module_parts import base_of, known_effects
from dpr_lab.identification.model import Model
from dpr_lab.rig import Rig
from dpr_lab.simulator_models.chain import ModelChain

STAGES = ("torque", "load", "timing", "encoder", "play", "play1")
"""Stages of effects that the module contains."""


@dataclass(frozen=True, slots=True)
class PassiveForces:
    """Effects added to a file as passive forces, and the module that applies them."""

    effects: tuple[str, ...] = ()
    friction: tuple[float, float] = (0.0, 0.0)
    """Coulomb friction of the passive effects at rest, at joints 1 and 2, N m."""
    module: str = field(default="", repr=False)
    """Source of the module; empty if there are no effects."""


def passive_forces(
    model: Model, rig: Rig, expressed: Collection[str], chain: ModelChain, file: str, gravity: float | None = None
) -> PassiveForces:
    """Generate the module of passive forces for the effects that a file does not contain.

    Args:
        model: the corrected model
        rig: rig of the model
        expressed: effects that the file contains
        chain: the double pendulum of the file
        file: name of the file
        gravity: gravity for a file that contains no gravity, m/s^2
    """
    known = {name: values for name, values in known_effects(model.effects).items() if name not in expressed}
    added = {n: v for n, v in known.items() if EFFECTS[n].stage in STAGES and not _adds_inertia(n, v, model, rig)}
    if not added:
        return PassiveForces()
    contained = {*expressed, *(set(model.effects) - set(added))}
    inner, outer = chain.rods
    upright = math.pi - inner.direction * inner.hanging, -outer.direction * outer.hanging
    sign = float(inner.direction), float(outer.direction)
    place = EngineFile(file, (inner.joint.name, outer.joint.name), upright, sign, gravity)
    return PassiveForces(tuple(added), rest_friction(added, rig)[1:], passive(model, rig, contained, place))


def _adds_inertia(name: str, values: Mapping[str, float], model: Model, rig: Rig) -> bool:
    """Check whether an effect contributes to the mass matrix."""
    params = effect_params({name: values})
    moving = motion_of(0.1, (0.0, 1.0, 2.0), (0.0, 1.0, -1.0), (0.1, 0.1), (1.0, 1.0), (1.0, -1.0))
    internal = tuple(AT_RELEASE[list(STEPPED)].tolist())
    terms = effect_torques(moving, base_of(model), rig_constants(rig), internal, params, active_effects(params))
    return any((terms.a, terms.b, terms.coupling))
