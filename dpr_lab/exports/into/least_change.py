"""Find the fewest changes that make a simulator file move like the corrected model.

A free swing determines only ratios of the base parameters. The common scale s of all masses, inertias and torques is
therefore free, unless recordings or measured values determine the scale. s is chosen such that as many base parameters
of the file as possible are unchanged. u are the estimated base parameters at b = 1, and x are the base parameters of
the file. x_i is unchanged if |s u_i / x_i - 1| is below the tolerance of x_i, and s is one of the values x_i / u_i.

If only known torques determine the scale, these torques were computed with the gears of the file. Multiplying all
torques by s / b is then equivalent to dividing all masses, inertias and frictions by s / b. Each gear changes by the
factor s / b (1 + x_j), where x_j is the error of the torque constant of joint j. The gears therefore count as further
numbers of the file, and s is one of x_i / u_i, b and b / (1 + x_j).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.dynamics.base import BASE, base_parameters, ratios
from dpr_lab.errors import ConfigError
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.exports.bodies import words_of
from dpr_lab.exports.into.in_file import (
    CHANGE,
    Effects,
    ModelCause,
    as_in_file,
    cause,
    effect_rows,
    in_file,
    ranked,
    required_effects,
    scaled,
    unseen,
)
from dpr_lab.exports.rigid_bodies import added_length
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.identification.compare import compare_run
from dpr_lab.identification.model import Model, ParameterValue
from dpr_lab.identification.moving_arm.model import AnyModel, MovingArmModel
from dpr_lab.rig import PARAMETERS, Rig
from dpr_lab.run import Run
from dpr_lab.simulator_models.chain import ModelChain

BODY_TERMS = (("a", "e1"), ("b", "d"))
"""For each rod, the base parameters that the inertia and the centre of mass of its body determine."""

Values = Mapping[str, float]
"""Base parameters, or `SWING_PARAMETERS` of a moving arm, by name, SI."""


@dataclass(frozen=True, slots=True)
class LeastChange:
    """Corrected model that keeps all compatible numbers of the file, and the changed numbers.

    The changes are sorted by their share.
    """

    model: AnyModel
    causes: tuple[ModelCause, ...]
    unnamed: tuple[str, ...]
    """Named effects that no attribute of a body or joint can represent."""


def least_change(diagnosis: Diagnosis, model: Model, rig: Rig, chain: ModelChain, runs: Sequence[Run]) -> LeastChange:
    """Find the smallest set of changed numbers that the recordings require.

    Args:
        diagnosis: the diagnosis, for the intervals of its effects
        model: corrected model of the diagnosis
        rig: rig that was made from the simulator file
        chain: the double pendulum of the file
        runs: the diagnosed runs, to rank the causes

    Raises:
        ConfigError: the rotor of joint 1 in the file is too large.
    """
    effects: Effects = model.effects
    longer = added_length(words_of(effects))
    of_file = _base_of(chain, longer)
    in_order = np.array(list(of_file.values()))
    # of the base parameters, only a contains the armature
    rotor = np.array([chain.rods[0].joint.armature, 0.0, 0.0, 0.0, 0.0, 0.0])
    gears = _gear_factors(effects, diagnosis, runs)
    base = _base(in_order, rotor, model, diagnosis, np.array(list(gears.values())))
    refuse_rotor(chain, base[0])
    values = with_own_numbers(chain, dict(zip(BASE, base.tolist(), strict=True)), of_file, longer)
    factor = values["b"] / model.base["b"].value
    effects = {name: as_in_file(diagnosis, chain, name, scaled(name, v, factor)) for name, v in effects.items()}
    effects = {name: values for name, values in effects.items() if name not in gears}
    effects |= _changed_gears(gears, factor, diagnosis)
    effects |= unseen(diagnosis, chain, effects, (0, 1))

    def error(tried: Model) -> float:
        return float(np.mean([np.mean(compare_run(run, rig, tried).segment_rms_rad ** 2) for run in runs]))

    numbers = values, _base_of(chain, 0.0)
    uncorrected = list(changed_rods(chain, values, of_file, longer))
    return ranked_change(chain, partial(_with, model, chain), error, numbers, effects, uncorrected)


ModelKind = TypeVar("ModelKind", Model, MovingArmModel)


def ranked_change(
    chain: ModelChain,
    model_with: Callable[[Values, Effects], ModelKind],
    error: Callable[[ModelKind], float],
    numbers: tuple[Values, Values],
    effects: Effects,
    uncorrected: Sequence[tuple[list[ModelCause], Values]],
) -> LeastChange:
    """Rank the changed numbers by the error that results if they stay uncorrected.

    Args:
        chain: rods and arm of the file
        model_with: function that returns the model with given numbers and effects
        error: function that returns the mean square error of a model over segments, rad^2
        numbers: corrected numbers, and numbers of the file
        effects: identified sizes of effects by name
        uncorrected: changed numbers of bodies and joints, each with a copy of all numbers in which they are uncorrected
    """
    corrected, of_file = numbers
    file = {name: {key: 0.0 for key in sizes} | in_file(chain, name) for name, sizes in effects.items()}
    effects = required_effects(effects, file, lambda tried: error(model_with(corrected, tried)))
    least = model_with(corrected, effects)
    causes: list[tuple[list[ModelCause], ModelKind]] = [
        (rows, model_with(corrected, {**effects, name: file[name]}))
        for name, sizes in effects.items()
        if (rows := effect_rows(chain, name, sizes, file[name]))
    ]
    causes += [(rows, model_with(without, effects)) for rows, without in uncorrected]
    nothing = model_with(of_file, {name: file[name] for name in effects})
    errors = [(rows, error(without)) for rows, without in causes]
    unnamed = tuple(name for name, sizes in effects.items() if not words_of({name: sizes}))
    return LeastChange(least, ranked(errors, error(least), error(nothing)), unnamed)


def changed_rods(
    chain: ModelChain, values: Values, of_file: Values, longer: float
) -> Iterator[tuple[list[ModelCause], Values]]:
    """Yield the changed numbers of the rods.

    Each change is yielded with a copy of all values, in which the changed numbers are those of the file. `longer` is
    the increase of the length of the inner rod, m.
    """
    for number, terms in enumerate(BODY_TERMS[: len(chain.rods)]):
        if any(values[name] != of_file[name] for name in terms):
            rows = _body_rows(chain, values, of_file, number, longer)
            yield rows, {**values, **{name: of_file[name] for name in terms}}
        damping = f"c{number + 1}"
        if values[damping] != of_file[damping]:
            row = cause(chain, number, "damping", of_file[damping], values[damping], "N m s/rad")
            yield [row], {**values, damping: of_file[damping]}


def _base_of(chain: ModelChain, longer: float) -> dict[str, float]:
    """Return the base parameters of the file if its inner rod is longer by `longer`, m."""
    values, length = chain.parameters, (chain.rods[0].length or 0.0) + longer
    base = base_parameters([values[name] for name in PARAMETERS], length, chain.gravity)
    return dict(zip(BASE, base.tolist(), strict=True))


def _gear_factors(
    effects: Mapping[str, Mapping[str, float]], diagnosis: Diagnosis, runs: Sequence[Run]
) -> dict[str, float]:
    """Return the ratio of acting to known torque of each drive at the estimated b.

    The keys are the names of the effects `torque_scale`. The result is empty unless known torques determine the scale.
    """
    driven = [run.torques for run in runs if run.torques is not None]
    weighed = any(run.added_mass is not None for run in runs)
    if not driven or weighed or diagnosis.scale is None or diagnosis.scale.fixed_by != "data":
        return {}
    names = {j: f"torque_scale_joint{j + 1}" for j in (0, 1) if any(np.any(torques[:, j]) for torques in driven)}
    return {name: 1.0 + effects.get(name, {}).get("excess", 0.0) for name in names.values()}


def _changed_gears(gears: Mapping[str, float], factor: float, diagnosis: Diagnosis) -> dict[str, dict[str, float]]:
    """Return the torque constant errors of the file after scaling all masses.

    Negligible errors are omitted.
    """
    excess = {name: float(factor * gain - 1) for name, gain in gears.items()}
    return {name: {"excess": x} for name, x in excess.items() if abs(x) >= _same_gear(diagnosis)}


def _base(of_file: Array, rotor: Array, model: Model, diagnosis: Diagnosis, gears: Array) -> Array:
    """Return base parameters (6,): values of the file where they agree with the estimates, otherwise the estimates.

    A scale that is unknown, or known only from torques, is chosen so that as many values of the file as possible are
    kept.

    Args:
        of_file: (6,) base parameters of the file, without rotors
        rotor: (6,) contribution of the rotors of the file, which the estimates contain
        model: the corrected model
        diagnosis: the diagnosis
        gears: result of `_gear_factors`
    """
    u = np.insert(model.ratio_values, 1, 1.0)
    std = np.insert(np.sqrt(np.diag(np.array(diagnosis.ratio_covariance))), 1, 0.0)
    tolerance = np.maximum(CHANGE.same, CHANGE.stds * std / u)
    floor = CHANGE.idle * np.sqrt(of_file[1] * of_file[3])  # a file may contain no damping; sqrt(b e1) is in N m s
    x = np.where(of_file > 0, of_file, floor) + rotor
    b, scale = model.base["b"].value, diagnosis.scale
    scales: list[float] = [] if scale is not None and scale.known and not len(gears) else (x / u)[:4].tolist()
    scales += [] if scale is None or not scale.known else [b, *(b / gears).tolist()]

    def stays(s: float) -> Flags:
        return np.abs(s * u / x - 1) < tolerance

    def unchanged(s: float) -> int:
        return int(np.sum(stays(s)) + np.sum(np.abs(s / b * gears - 1) < _same_gear(diagnosis)))

    s = max(scales, key=lambda scale: (unchanged(scale), -np.abs(np.log(scale * u / x)[:4]).sum()))
    return np.where(stays(s), of_file, s * u - rotor)


def _same_gear(diagnosis: Diagnosis) -> float:
    """Return the relative difference up to which a gear counts as unchanged."""
    low, high = diagnosis.scale.interval90 if diagnosis.scale else (1.0, 1.0)
    return max(CHANGE.same, CHANGE.stds * float(np.log(high / low)) / (2 * NORMAL_Q90))


def refuse_rotor(chain: ModelChain, a: float) -> None:
    """Check that the rotor of joint 1 leaves a positive inertia a, kg m^2, of the rods.

    Raises:
        ConfigError: the armature in the file is larger than the identified inertia.
    """
    joint = chain.rods[0].joint
    if a <= 0:
        raise ConfigError(
            f"armature {joint.armature:g} kg m^2 of joint {joint.name!r} is larger than the identified inertia about"
            f" this joint, {a + joint.armature:.4g} kg m^2: correct the armature in the file"
        )


def with_own_numbers(chain: ModelChain, values: Values, of_file: Values, longer: float) -> dict[str, float]:
    """Adapt base parameters so that slightly changed bodies keep their numbers.

    The centre of mass or the inertia of a body keeps its value of the file if the base parameters change it only
    slightly.
    """
    length, carried = (chain.rods[0].length or 0.0) + longer, sum(r.mass for r in chain.rods[1:]) + chain.elbow_mass
    changed = dict(values)
    for number, terms in enumerate(BODY_TERMS[: len(chain.rods)]):
        if all(values[name] == of_file[name] for name in terms):
            continue
        file, estimated = (_bodies(chain, numbers, longer)[number] for numbers in (of_file, values))
        centroid, inertia = (
            in_file if abs(other / in_file - 1) < CHANGE.same else other
            for in_file, other in zip(file, estimated, strict=True)
        )
        mass = chain.rods[number].mass
        inertia_about_joint = inertia + mass * centroid**2
        if number:
            changed |= {"b": inertia_about_joint, "d": mass * length * centroid}
        else:
            moment = (mass * centroid + carried * length) * chain.gravity
            changed |= {"a": inertia_about_joint + carried * length**2, "e1": moment}
    return changed


def _with(model: Model, chain: ModelChain, values: Values, effects: Effects) -> Model:
    """Replace base parameters and effects of a model, and use the masses of the file."""
    inner, outer = chain.rods
    known = {"m1": inner.mass, "m2": outer.mass, "mb": chain.elbow_mass, "l1": inner.centroid, "l2": outer.centroid}
    known |= {"J1": inner.inertia, "J2": values["b"] - outer.mass * outer.centroid**2}
    nine = {
        name: value.model_copy(update={"value": known.get(name, value.value)})
        for name, value in model.parameters.items()
    }
    absolute = {
        name: ParameterValue(value=values[name], std=entry.std, fixed_by=entry.fixed_by)
        for name, entry in model.base.items()
    }
    p_over_b = outer.mass * (inner.length or 0.0) ** 2 / values["b"]
    effects = {name: dict(values) for name, values in effects.items()}
    update = {"parameters": nine, "base": absolute, "p_over_b": p_over_b, "effects": effects}
    of_base = ratios(np.array([values[name] for name in BASE]))
    return model.with_ratios(of_base.tolist()).model_copy(update=update)


def _body_rows(chain: ModelChain, values: Values, of_file: Values, number: int, longer: float) -> list[ModelCause]:
    """List the changes of the centre of mass and inertia of a body.

    The mass of the body is kept.
    """
    before, after = (_bodies(chain, numbers, longer)[number] for numbers in (of_file, values))
    names = (
        ("centre of mass of the body along the rod", "m"),
        ("inertia of the body about its centre of mass", "kg m^2"),
    )
    return [
        cause(chain, number, words, old, new, unit)
        for (words, unit), old, new in zip(names, before, after, strict=True)
        if abs(new - old) > 1e-9 * abs(old)
    ]


def _bodies(chain: ModelChain, values: Values, longer: float) -> list[tuple[float, float]]:
    """Compute centre of mass, m, and inertia, kg m^2, of each rod from base parameters and the masses of the file."""
    inner, *outer = chain.rods
    a, b, d, e1 = (values[name] for name in ("a", "b", "d", "e1"))
    length, carried = (inner.length or 0.0) + longer, sum(rod.mass for rod in outer) + chain.elbow_mass
    first = (e1 / chain.gravity - carried * length) / inner.mass
    bodies = [(first, a - carried * length**2 - inner.mass * first**2)]
    for rod in outer:
        second = d / (rod.mass * length)
        bodies.append((second, b - rod.mass * second**2))
    return bodies
