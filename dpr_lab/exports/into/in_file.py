"""Compare the effects in the user's simulator file with those of a corrected model."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import ARM
from dpr_lab.exports.bodies import Effects, words_of
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.simulator_models.chain import ChainArm, ChainRod, ModelChain


@dataclass(frozen=True, slots=True)
class ChangeSettings:
    """Tolerances within which a number of the file counts as unchanged."""

    same: float = 0.01
    """Relative difference up to which a number always counts as unchanged. The smoothed friction of a simulator changes
    other estimates by about this amount."""
    stds: float = 3.0
    """Difference of a ratio, in its standard deviations, up to which it counts as unchanged."""
    idle: float = 1e-6
    """Damping that replaces a damping of zero in comparisons, relative to sqrt(inertia x gravity torque) of a rod."""
    required: float = 0.01
    """Relative growth of the mean square error over segments below which an effect keeps the value of the file."""


CHANGE = ChangeSettings()


@dataclass(frozen=True, slots=True)
class ModelCause:
    """A number of the file that differs from its identified value."""

    joint: str
    """Name of the joint in the file."""
    quantity: str
    """Name of the quantity, for example `Coulomb friction` or `centre of mass of the body`."""
    before: float
    """Value in the file, SI."""
    after: float
    """Identified value, SI."""
    unit: str
    """Unit of both values."""
    effect: str = ""
    """Named effect that the number represents; empty for a base parameter."""
    share: float = 0.0
    """Growth of the mean square error over segments if only this cause stays uncorrected, relative to the growth if all
    causes stay uncorrected. All numbers of one body have the same share. The cause with the largest share comes
    first."""


TERMS = {
    "coulomb": ("friction", "torque_Nm", "Coulomb friction", "N m"),
    "rotor_inertia": ("armature", "inertia_kgm2", "rotor inertia (armature)", "kg m^2"),
    "spring": ("stiffness", "stiffness_Nm_per_rad", "spring stiffness", "N m/rad"),
}
"""For each kind of effect: attribute of `ModelJoint`, name of the parameter, description, and unit."""


def hinge(chain: ModelChain, joint: int) -> ChainRod | ChainArm:
    """Return the rod at joint 0 or 1, or the arm for joint -1."""
    if joint != ARM:
        return chain.rods[joint]
    assert chain.arm is not None
    return chain.arm


def _term(name: str) -> tuple[str, str, str, str] | None:
    return TERMS.get(name.rpartition("_joint")[0])


def _joint(name: str) -> int:
    """Return the joint of an effect; the inner joint if the effect acts at several joints."""
    joints = EFFECTS[name].joints
    return joints[0] if len(joints) == 1 else 0


def in_file(chain: ModelChain, name: str) -> dict[str, float]:
    """Return the amplitudes of an effect from the joint attributes in the file.

    The result is empty if no attribute represents the effect.
    """
    term = _term(name)
    if term is None:
        return {}
    part = hinge(chain, _joint(name))
    value = float(getattr(part.joint, term[0]))
    if name.startswith("spring"):
        return {term[1]: value, "constant_Nm": value * part.direction * (part.joint.rest - part.hanging)}
    return {term[1]: value}


def unseen(
    diagnosis: Diagnosis, chain: ModelChain, named: Collection[str], joints: Collection[int]
) -> dict[str, dict[str, float]]:
    """Find effects in the file that are too small to be named by the diagnosis.

    An effect is too small if its size in the file is below the minimum detectable size, or if the recordings cannot
    detect it at any size. The changed file keeps the values of these effects. Only effects of the joints `joints` are
    returned.
    """
    undetectable = {}
    for name in _at(joints):
        term = _term(name)
        assert term is not None
        values, least = in_file(chain, name), diagnosis.detectable.get(name, {}).get(term[1])
        if name not in named and values[term[1]] and (least is None or values[term[1]] < least):
            undetectable[name] = values
    return undetectable


def _at(joints: Collection[int]) -> Iterator[str]:
    """Yield the names of the effects at the given joints that joint attributes of a file can represent."""
    return (name for name, effect in EFFECTS.items() if _term(name) and set(effect.joints) <= set(joints))


def as_in_file(diagnosis: Diagnosis, chain: ModelChain, name: str, values: dict[str, float]) -> dict[str, float]:
    """Return the values of an effect, with values of the file instead of estimates where both are compatible.

    They are compatible if their relative difference is below `CHANGE.same` or the half width of the interval.
    """
    sizes = next((effect.parameters for effect in diagnosis.effects if effect.name == name), {})
    for key, of_file in in_file(chain, name).items():
        half = np.ptp(sizes[key].interval90) / 2 / abs(sizes[key].value) if key in sizes and sizes[key].value else 0.0
        if of_file and abs(values.get(key, 0.0) / of_file - 1) < max(CHANGE.same, half):
            values = {**values, key: of_file}
    return values


def scaled(name: str, values: Mapping[str, float], factor: float) -> dict[str, float]:
    """Return the values of an effect after all torques are multiplied by a factor."""
    powers = {p.name: p.scale_power for p in EFFECTS[name].parameters}
    return {key: value * factor ** powers.get(key, 0) for key, value in values.items()}


def cause(
    chain: ModelChain, joint: int, quantity: str, before: float, after: float, unit: str, effect: str = ""
) -> ModelCause:
    """Describe the change of one number from `before` to `after`.

    The joint is 0 or 1 for the rods, and -1 for the arm.
    """
    return ModelCause(hinge(chain, joint).joint.name, quantity, float(before), float(after), unit, effect)


def effect_rows(
    chain: ModelChain, name: str, values: Mapping[str, float], file: Mapping[str, float]
) -> list[ModelCause]:
    """Describe each number of the file that changes because of an effect."""
    joint, term = _joint(name), _term(name)
    gain, gear = words_of({name: values}).get(name, {}).get("gear"), hinge(chain, joint).gear
    if gain is not None and gear is not None:
        return [cause(chain, joint, "gear of the motor", gear, gear * gain, "", name)] if gain != 1.0 else []
    rows = []
    for key, after in values.items():
        if after != file.get(key, 0.0):
            parameter = next((p for p in EFFECTS[name].parameters if p.name == key), None)
            words, unit = (term[2], term[3]) if term and term[1] == key else (EFFECTS[name].words, "")
            unit = unit or (parameter.unit if parameter else "")
            rows.append(cause(chain, joint, words, file.get(key, 0.0), after, unit, name))
    return rows


def required_effects(effects: Effects, file: Effects, error: Callable[[Effects], float]) -> Effects:
    """Select the effects that the recordings require.

    Other effects keep their values of the file; they are omitted if these values are zero.

    Args:
        effects: identified sizes by name
        file: sizes of the same effects in the file
        error: function that returns the mean square error of the model with given effects
    """
    for name in effects:
        without = {**effects, name: file[name]}
        if error(without) < (1 + CHANGE.required) * error(effects):
            effects = {other: sizes for other, sizes in without.items() if any(sizes.values())}
    return effects


def ranked(
    causes: Sequence[tuple[Sequence[ModelCause], float]], least: float, nothing: float
) -> tuple[ModelCause, ...]:
    """Sort the changed numbers by the share of the error that each number contributes.

    Args:
        causes: numbers of each cause, and the mean square error if these numbers keep their values of the file
        least: mean square error if all causes are corrected
        nothing: mean square error if no cause is corrected
    """
    growths = [max(error - least, 0.0) for _, error in causes]
    whole = max(nothing - least, *growths, 1e-30)
    by_size = sorted(zip(growths, causes, strict=True), key=lambda pair: -pair[0])
    return tuple(replace(row, share=growth / whole) for growth, (rows, _) in by_size for row in rows)
