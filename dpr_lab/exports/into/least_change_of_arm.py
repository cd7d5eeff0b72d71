"""Find the smallest set of changes in a simulator file with a moving arm.

`least_change` does the same for a clamped arm. All inertias, frictions and gravity torques, and the torque per input of
the drive, are determined only up to a common factor s. u are the estimated `SWING_PARAMETERS`, divided by the scale,
and x are the `SWING_PARAMETERS` of the file. x_i is unchanged if |s u_i / x_i - 1| is below the tolerance of x_i. s is
one of the values x_i / u_i. If the torque per input is unchanged, s is the scale that known torques determine. If most
other parameters are unchanged instead, the gear of the motor changes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from dpr_lab.dynamics.base import BASE, base_parameters
from dpr_lab.dynamics.moving_arm.swing import SWING_PARAMETERS
from dpr_lab.effects.effect import ARM
from dpr_lab.errors import RunError
from dpr_lab.exports.into.in_file import (
    CHANGE,
    Effects,
    ModelCause,
    as_in_file,
    cause,
    scaled,
    unseen,
)
from dpr_lab.exports.into.least_change import (
    LeastChange,
    Values,
    changed_rods,
    ranked_change,
    refuse_rotor,
    with_own_numbers,
)
from dpr_lab.exports.replay import follow_with_arm
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.identification.moving_arm.setup import drive_gain
from dpr_lab.identification.moving_arm.unknowns import parameter_of
from dpr_lab.rig import PARAMETERS, Rig
from dpr_lab.run import Run
from dpr_lab.simulator_models.chain import ChainArm, ModelChain


@dataclass(frozen=True, slots=True)
class RankSettings:
    """Settings of the simulations that rank the causes."""

    segment_s: float = 0.5
    """Length of segments, s."""
    lost_rad: float = 3.0
    """Error assigned to a model that cannot follow a recording, rad: about the difference of unrelated angles."""


RANK = RankSettings()


def least_change_of_arm(
    diagnosis: Diagnosis, model: MovingArmModel, rig: Rig, chain: ModelChain, runs: Sequence[Run]
) -> LeastChange:
    """Find the smallest set of changed numbers that the recordings require.

    Args:
        diagnosis: the diagnosis, for the intervals of its effects
        model: corrected model of the diagnosis
        rig: rig that was made from the simulator file
        chain: rods and arm of the file
        runs: the diagnosed runs, to rank the causes

    Raises:
        ConfigError: the rotor of joint 1 in the file is too large.
    """
    assert chain.arm is not None
    model = model.with_arm_effects()
    of_file = numbers_of_file(chain, chain.arm, rig, model)
    values, factor = kept_numbers(of_file, model, chain)
    effects = {n: as_in_file(diagnosis, chain, n, scaled(n, v, factor)) for n, v in model.effects.items()}
    effects |= unseen(diagnosis, chain, effects, (ARM, *range(len(chain.rods))))
    uncorrected = list(_changed(chain, chain.arm, values, of_file))
    return ranked_change(
        chain, partial(_with, model), lambda tried: _error(tried, runs, rig), (values, of_file), effects, uncorrected
    )


def numbers_of_file(chain: ModelChain, arm: ChainArm, rig: Rig, model: MovingArmModel) -> dict[str, float]:
    """Return the `SWING_PARAMETERS` of the file.

    Spring and Coulomb friction of the arm are set to zero, because they count as effects.
    """
    numbers = {name: 0.0 for name in PARAMETERS} | chain.parameters
    values = base_parameters([numbers[name] for name in PARAMETERS], chain.rods[0].length or 1.0, chain.gravity)
    of_rods = dict(zip(BASE, values.tolist(), strict=True))
    if model.scale == "a":
        of_rods |= {"b": of_rods["a"], "d": 0.0, "c2": 0.0}
    A = arm.inertia + _carried(chain) * arm.length**2
    drive = drive_gain(rig).value if model.input else 1.0
    return of_rods | {"A": A, "c0": arm.joint.damping, "k0": 0.0, "f0": 0.0, "gain": drive, "L0": arm.length}


def _carried(chain: ModelChain) -> float:
    return sum(rod.mass for rod in chain.rods) + chain.elbow_mass


def kept_numbers(of_file: Values, model: MovingArmModel, chain: ModelChain) -> tuple[dict[str, float], float]:
    """Return the `SWING_PARAMETERS` at one scale: values of the file if compatible, otherwise estimates.

    The second result is the ratio of this scale to that of the model. The estimate of a contains the rotor of joint 1,
    which the file contains as armature.
    """
    u: dict[str, float] = dict(zip(SWING_PARAMETERS, model.swing, strict=True))
    tolerance = _tolerances(model)
    floor = CHANGE.idle * np.sqrt(of_file["a"] * of_file["e1"])  # a file may contain no damping
    rotor = {"a": chain.rods[0].joint.armature}
    x = {name: (of_file[name] or floor) + rotor.get(name, 0.0) for name in tolerance}

    def stays(name: str, s: float) -> bool:
        return abs((1.0 if name == "L0" else s) * u[name] / x[name] - 1) < tolerance[name]

    scales = [x[name] / u[name] for name in ("a", "b", "d", "e1", "A", "gain") if name in tolerance]

    def agreement(s: float) -> tuple[int, float]:
        away = sum(abs(np.log(s * u[name] / x[name])) for name in ("a", "e1", "A") if name in tolerance)
        return sum(stays(name, s) for name in tolerance), -float(away)

    s = max(scales, key=agreement)
    values = dict(of_file)
    for name in tolerance:
        if not stays(name, s):
            values[name] = u[name] * (1.0 if name == "L0" else s) - rotor.get(name, 0.0)
    refuse_rotor(chain, values["a"])
    values = with_own_numbers(chain, values, of_file, 0.0)
    factor = (values[model.scale] + rotor.get(model.scale, 0.0)) / model.absolute[model.scale].value
    return values | ({"b": values["a"]} if model.scale == "a" else {}), factor


def _tolerances(model: MovingArmModel) -> dict[str, float]:
    """Return the relative difference up to which each number of the file is kept.

    Only determined parameters are included.
    """
    scale = model.absolute[model.scale]
    tolerances = {model.scale: CHANGE.same}
    if model.input and scale.fixed_by == "data":  # the scale, divided by the known torque per input
        tolerances["gain"] = max(CHANGE.same, CHANGE.stds * scale.std / scale.value)
    for name, ratio in model.ratios.items():
        relative = ratio.std / abs(ratio.value) if ratio.value else np.inf
        tolerances[parameter_of(name, model.input, model.scale)] = max(CHANGE.same, CHANGE.stds * relative)
    return tolerances


def _changed(
    chain: ModelChain, arm: ChainArm, values: Values, of_file: Values
) -> Iterator[tuple[list[ModelCause], Values]]:
    """Yield the changed numbers of rods and arm, as `changed_rods` does for the rods."""
    yield from changed_rods(chain, values, of_file, 0.0)
    gear = (arm.gear or 1.0) / of_file["gain"]
    of_rods = _carried(chain) * values["L0"] ** 2, _carried(chain) * of_file["L0"] ** 2
    numbers = [
        ("A", "inertia of the arm about its axis", 1.0, of_rods, "kg m^2"),
        ("c0", "damping", 1.0, (0.0, 0.0), "N m s/rad"),
        ("gain", "gear of the motor", gear, (0.0, 0.0), ""),
        ("L0", "distance of the rods from the axis of the arm", 1.0, (0.0, 0.0), "m"),
    ]
    for name, quantity, unit_factor, (after, before), unit in numbers:
        if values[name] != of_file[name]:
            ends = unit_factor * of_file[name] - before, unit_factor * values[name] - after
            yield [cause(chain, ARM, quantity, *ends, unit)], {**values, name: of_file[name]}


def _with(model: MovingArmModel, values: Values, effects: Effects) -> MovingArmModel:
    """Replace the parameters and the effects of the model."""
    scale = values[model.scale]
    swing = [values[name] / (1.0 if name == "L0" else scale) for name in SWING_PARAMETERS]
    sizes_of = {name: dict(sizes) for name, sizes in effects.items()}
    return model.with_swing(swing, scale).model_copy(update={"effects": sizes_of})


def _error(model: MovingArmModel, runs: Sequence[Run], rig: Rig) -> float:
    """Return the mean square error of a model over segments, rad^2.

    The result is `RANK.lost_rad` squared for a model that cannot follow a recording.
    """
    try:
        followed = [follow_with_arm(run, rig, model, RANK.segment_s) for run in runs]
    except RunError:
        return RANK.lost_rad**2
    return float(np.mean([np.nanmean((swing.measured - swing.simulated) ** 2) for swing in followed]))
