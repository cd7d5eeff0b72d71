"""Conversion of a simulator model to a rig file."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.errors import ConfigError
from dpr_lab.whole_file import write_text
from dpr_lab.workflows.rig_drive import MotorMeasures
from dpr_lab.workflows.rig_file import DRAFT, MEANING, mass_bounds, ranges_of, refuse_rig_file
from dpr_lab.workflows.rig_toml import Bounds, about, rendered

if TYPE_CHECKING:
    from dpr_lab.simulator_models.chain import ChainArm, JointTerm, ModelChain


@dataclass(frozen=True, slots=True)
class RigFromModel:
    """Rig file made from a simulator model, and the parts that it cannot contain."""

    file: Path
    model: str
    format: str
    joints: tuple[str, ...]
    """Names of the joints of inner rod, outer rod and arm that the model has."""
    nominal: dict[str, float]
    """Nominal value of each kinetic parameter and of L1, L2, L0 and g, SI units."""
    arm: dict[str, float]
    """Nominal values of the arm by key of the rig file; empty for a clamped arm."""
    terms: "tuple[JointTerm, ...]"
    """Terms of the joints that are effects in dpr-lab. A diagnosis estimates their sizes."""
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the output of `dpr-lab rig from --json`."""
        return {"schema": 1, **asdict(self)}


def rig_from_model(
    model: Path, file: Path, joints: Sequence[str] = (), name: str | None = None, g: float | None = None
) -> RigFromModel:
    """Write the rig file of a simulator model in MJCF, URDF or SDFormat.

    The model is a double pendulum, or one rod on an arm.

    Args:
        model: the file of the model
        file: the rig file to write, with the suffix .toml
        joints: names of the joints of the inner rod, the outer rod and optionally the arm, or of one rod and its arm;
            empty: detected
        name: name of the rig; None: the name of the model
        g: gravity, m/s^2; None: the value of the model

    Raises:
        ConfigError: the model cannot be read, contains no such rods, or the rig file exists or cannot be written.
    """
    from dpr_lab.rig import parse_rig
    from dpr_lab.simulator_models import read_model
    from dpr_lab.simulator_models.double_pendulum import double_pendulum

    refuse_rig_file(file)
    read = read_model(model)
    try:
        chain = double_pendulum(read, joints, g)
    except ConfigError as error:
        skipped = f" (notes: {'; '.join(read.notes)})" if read.notes else ""
        raise ConfigError(f"{model}: {error}{skipped}") from error
    driven = {actuator.joint: actuator.gear for actuator in read.actuators}
    nominal, notes = _nominal(chain), list(chain.notes)
    text = _text(chain, nominal, name or read.name, driven, notes, f"{read.format} model {model.name!r}")
    try:
        parse_rig(text)
    except ConfigError as error:
        raise ConfigError(f"{model}: its values are not a valid rig: {error}") from error
    write_text(file, text, ConfigError)
    names = tuple(part.joint.name for part in chain.parts)
    arm = _arm_values(chain.arm, _bounds(chain, nominal, [])) if chain.arm else {}
    return RigFromModel(file, read.name, read.format, names, nominal, arm, chain.terms, tuple(notes))


def _nominal(chain: "ModelChain") -> dict[str, float]:
    inner, *outer = chain.rods
    values = chain.parameters | {"L1": inner.length or 2 * inner.centroid, "g": chain.gravity}
    if outer and outer[0].length is not None:
        values["L2"] = outer[0].length
    if chain.arm is not None:
        values["L0"] = chain.arm.length
    return values


def _bounds(chain: "ModelChain", values: dict[str, float], notes: list[str]) -> dict[str, Bounds]:
    """Return the bounds of the parameters, as in `rig new`.

    The bounds are extended if the value of the model is outside. A value that is not positive is replaced by a small
    positive value, and a note is added to `notes`.
    """
    lengths = [rod.length or 2 * rod.centroid for rod in chain.rods]
    ranges = ranges_of(values, lengths, chain.gravity, uncertain=False)
    if "mb" in values:
        ranges["mb"] = mass_bounds(values["mb"]) if values["mb"] > 0 else (5e-7, 1e-6, 2e-6)
    bounds = {}
    for name, (lower, _, upper) in ranges.items():
        value = values[name]
        if not value > 0:
            # J1 and J2 of a point mass are zero
            value = {"mb": 1e-6, "J1": 1e-4 * lower, "J2": 1e-4 * lower}.get(name, lower)
            if value != values[name]:
                notes.append(
                    f"{name} ({MEANING[name]}) is {values[name]:.6g} in the model, but must be positive in a rig file:"
                    f" {value:.3g} is written"
                )
        bounds[name] = min(lower, value / 1.5), value, max(upper, 1.5 * value)
    return bounds


def _text(
    chain: "ModelChain",
    values: dict[str, float],
    name: str,
    driven: dict[str, float],
    notes: list[str],
    source: str,
) -> str:
    """Return the text of the rig file.

    Notes on the import are added to `notes`.
    """
    from dpr_lab.rig_tables import Encoders

    bounds = _bounds(chain, values, notes)
    counts = list(Encoders().counts_per_rev)
    zeros = _zeros(chain, counts[0], notes)
    missing = 2 - len(chain.rods)
    directions = [chain.arm.direction if chain.arm else 1, *(rod.direction for rod in chain.rods), *missing * [1]]
    notes += _reversed(chain)
    motor = _motor(chain.arm, driven) if chain.arm else None
    return rendered(
        "rig_from.toml",
        source=source,
        terms=chain.terms,
        notes=notes,
        name=name,
        values=values,
        meanings=MEANING,
        bounds=bounds,
        digits=12,
        counts=counts,
        zeros=[*zeros, *missing * [0]],
        directions=directions,
        single=bool(missing),
        geared=[j for j, rod in enumerate(chain.rods, 1) if rod.joint.name in driven or rod.joint.armature],
        arm_mode="driven" if motor else "free" if chain.arm else "clamped",
        arm_bounds={key: about(value) for key, value in _arm_values(chain.arm, bounds).items()} if chain.arm else {},
        motor=motor,
        poses=DRAFT.poses_as_one if missing else DRAFT.poses,
    )


def _zeros(chain: "ModelChain", counts: int, notes: list[str], noted: float = 0.01) -> list[int]:
    """Return the encoder counts of the hanging rods, for encoders at the joints.

    If rounding to whole counts changes a reading by more than `noted` counts, a note is added.
    """
    zeros = [0]
    for rod in chain.rods:
        exact = rod.hanging * counts / (2 * math.pi)
        zeros.append(round(exact))
        if abs(excess := exact - round(exact)) > noted:
            notes.append(
                f"joint {rod.joint.name!r} reads {rod.hanging:.6g} rad if the rods hang: zero_counts is rounded to a"
                f" whole count, which is an error of {1e3 * excess * 2 * math.pi / counts:.2g} mrad"
            )
    return zeros


def _reversed(chain: "ModelChain") -> list[str]:
    """Return the notes about joints whose positive direction is opposite to that of dpr-lab."""
    return [
        f"joint {part.joint.name!r} turns opposite to the angle of dpr-lab: its direction in [encoders] is -1, so"
        " recordings of the angle in the model can be used unchanged"
        for part in chain.parts
        if part.direction < 0
    ]


def _arm_values(arm: "ChainArm", bounds: dict[str, Bounds]) -> dict[str, float]:
    """Return the nominal values of the arm by key.

    The key `A` is the inertia about the axis of the arm with the rods at its end, kg m^2.
    """
    mass, joint = sum(bounds[name][1] for name in ("m1", "m2", "mb") if name in bounds), arm.joint
    values = {"A": arm.inertia + mass * arm.length**2, "c0": joint.damping, "k0": joint.stiffness, "f0": joint.friction}
    return {key: value for key, value in values.items() if key == "A" or value > 0}


def _motor(arm: "ChainArm", driven: dict[str, float]) -> MotorMeasures | None:
    """Return the motor of the arm, or None if the model does not drive the arm.

    `driven` maps the name of each driven joint to its gear ratio.
    """
    if arm.joint.name not in driven:
        return None
    gear = abs(driven[arm.joint.name])
    return MotorMeasures("torque", gear=gear if gear > 0 and math.isfinite(gear) else 1.0)
