"""Search for interpretations of a table that agree better with the energy or the accelerations of the swing."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import without_turns
from dpr_lab.identification.misread.balance import EnergyFit, energy_fit, energy_zeros
from dpr_lab.identification.misread.torque_balance import TorqueBalance, torque_balance
from dpr_lab.storage.tables.angles import Values
from dpr_lab.storage.tables.columns import AXES, TO_RADIANS, TO_SECONDS, UNIT_IN_NAME
from dpr_lab.storage.tables.interpreted import InterpretedTable, TableQuestion
from dpr_lab.storage.tables.options import ImportOptions


@dataclass(frozen=True, slots=True)
class InterpretationSettings:
    """Limits beyond which a different interpretation of a table is proposed."""

    right: float = 0.15
    """Maximum energy residual of a correct interpretation. It is 0.01 in simulations, 0.02 to 0.12 on real rigs, and
    above 0.2 with one wrong option."""
    better: float = 4.0
    """Minimum factor by which another interpretation must reduce the energy residual."""
    sure: float = 0.1
    """Maximum energy residual of a proposed interpretation."""
    zero_rad: float = 0.02
    """Minimum change of a proposed zero, rad. A diagnosis fits smaller errors as encoder offsets."""
    zero_std_rad: float = 0.005
    """Minimum stated uncertainty of a proposed zero, rad. The zeros of energy and accelerations differ by at most 0.007
    on 10 recordings of real rigs with ball bearings, by 0.03 to 0.09 with geared joints or a hand."""
    usual_zero_rad: float = np.pi / 12
    """Angle of which the zero error of an encoder is usually a multiple, rad."""
    alike: float = 2.0
    """Maximum ratio of two residuals for which the interpretations count as equally good. The one with fewer changes is
    then preferred."""
    balanced: float = 0.05
    """Torque residual below which no other interpretation is tried. It is 0.01 to 0.17 for free swings, up to 0.4 for
    driven geared joints, and 0.1 or more with one wrong option."""
    near_balance: float = 0.15
    """Maximum torque residual for which only zeros near the given ones are tried. Distant zeros have larger
    residuals."""
    better_balance: float = 2.0
    """Minimum factor by which another interpretation must reduce the torque residual. For a correct table no other
    interpretation reduces it by more than a third."""
    sure_balance: float = 0.25
    """Maximum torque residual of a proposed interpretation."""
    alike_balance: float = 1.1
    """Maximum ratio of two torque residuals for which the interpretations are equally good; see `alike`."""
    wrong_zero_rad: float = 0.15
    """Distance from the given zero to the zero with the smallest torque residual, rad. Above this limit a warning is
    given even if noise hides the reduction of the residual. The distance is at most 0.08 for 21 correct recordings of
    real rigs, and 0.17 for a zero with an error of 10 degrees."""
    better_zero: float = 1.1
    """Minimum factor by which a zero beyond `wrong_zero_rad` must reduce the torque residual."""


READ = InterpretationSettings()
BROKEN = "the energy of the swing is not conserved, but it is"


@dataclass(frozen=True, slots=True)
class Interpretation:
    """Another interpretation of a table."""

    causes: tuple[str, ...]
    """Descriptions of the differences from the given interpretation."""
    words: tuple[str, ...]
    """Command-line options that select this interpretation, except `--scale`; empty if the correction is not
    certain."""
    values: Values
    options: ImportOptions
    time_factor: float = 1.0
    scale: tuple[float, float] = (1.0, 1.0)
    """Additional factors of the option `--scale` for the two rods."""
    offset: tuple[float, float] = (0.0, 0.0)
    """Offsets added to the two rods after scaling, in the unit of the table."""

    @property
    def mend(self) -> tuple[str, ...]:
        """Options that select this interpretation; empty if the correction is uncertain."""
        zeros = {**dict.fromkeys(AXES[1:], 0.0), **self.options.offset}
        scale, offset = dict(self.options.scale), dict(zeros)
        for axis, factor, added in zip(AXES[1:], self.scale, self.offset, strict=True):
            scale[axis] = scale.get(axis, 1.0) * factor
            offset[axis] = offset[axis] * factor + added
        words = self.words if self.scale == (1.0, 1.0) else (*self.words, *_per_rod("--scale", scale, 1.0))
        return words if offset == zeros else (*words, *_per_rod("--offset", offset, 0.0))

    @property
    def sentence(self) -> str:
        """Description of the interpretation and of the options that select it."""
        return " and ".join(self.causes) + (f" ({' '.join(self.mend)})" if self.mend else "")

    @property
    def mirrored(self) -> "Interpretation":
        """Interpretation with mirrored rods; the energy of the rods is the same."""
        turned = {axis: -self.values[axis] for axis in AXES[1:]}
        signs, offset = (-self.scale[0], -self.scale[1]), (-self.offset[0], -self.offset[1])
        causes = self.causes if signs == (-1.0, 1.0) else (*self.causes, "both angles have the opposite sign")
        return replace(self, causes=causes, values={**self.values, **turned}, scale=signs, offset=offset)


def energy_residual(read: InterpretedTable, other: Interpretation) -> float:
    """Return the energy residual of an interpretation; infinite if the rods hardly move."""
    fit = energy_fit(read.t * other.time_factor, read.rods(other.values, other.options), read.torques, read.rig)
    return np.inf if fit is None else fit.residual


def better_interpretations(fit: EnergyFit, read: InterpretedTable) -> list[Interpretation]:
    """List interpretations with a clearly smaller energy residual than `fit`.

    Of interpretations with similar residuals, only those with the fewest differences are listed.
    """
    if fit.residual <= READ.right:
        return []
    slower = [_slower(read, fit.time_scale)] if np.isfinite(fit.time_scale) else []
    residuals = ((energy_residual(read, reading), reading) for reading in (*other_interpretations(read), *slower))
    limit = min(READ.sure, fit.residual / READ.better)
    tried = [(residual, reading) for residual, reading in residuals if residual < limit]
    free = read.torques is None and not read.drive
    if not tried and free and (moved := _as_counts(read) or _with_other_zeros(read)):
        return [moved]
    best = min((residual for residual, _ in tried), default=np.inf)
    return fewest_changes([reading for residual, reading in tried if residual <= READ.alike * best])


def fewest_changes(readings: Sequence[Interpretation]) -> list[Interpretation]:
    """Select the interpretations with the fewest differences from the given one."""
    fewest = min((len(reading.causes) for reading in readings), default=0)
    return [reading for reading in readings if len(reading.causes) == fewest]


def read_otherwise(broken: str, others: list[Interpretation], read: InterpretedTable) -> TableQuestion:
    """Compose the warning about an inconsistency, with the interpretations of the table without it.

    `broken` describes the inconsistency. If there is only one such interpretation, the warning contains its options as
    the correction, and the uncertainty of proposed zeros.
    """
    causes = "; or ".join(other.sentence for other in others)
    if len(others) == 1 and any(others[0].offset):
        uncertain = max(READ.zero_std_rad, _distance_of_zeros(read, others[0]))
        unit = others[0].options.unit or "rad"
        about = f"{uncertain / TO_RADIANS[unit]:.1g} {'degrees' if unit == 'deg' else unit}"
        rezeroed = "" if read.rig.encoders.rezeroed else "with rezeroed = true in [encoders] of the rig file, "
        causes += f". Proposed zeros are uncertain by about {about}: {rezeroed}the fit corrects them"
    other_unit = broken == BROKEN and all(
        len(other.causes) == 1 and other.options.unit != read.options.unit for other in others
    )
    mend = others[0].mend if len(others) == 1 else ()
    return TableQuestion(f"with these options {broken} if {causes}", mend, other_unit)


def _distance_of_zeros(read: InterpretedTable, other: Interpretation) -> float:
    """Return the largest difference, rad, between the zeros of an interpretation and those that fit best.

    The energy and the accelerations give two estimates of the zeros, which depend differently on friction. The result
    is 0 if neither can be computed.
    """
    rods = read.rods(other.values, other.options)
    balance = torque_balance(read.t, rods, read.torques, read.rig)
    zeros = [] if balance is None else [balance.zeros(nearest=True)]
    if read.torques is None and (of_energy := energy_zeros(read.t, rods, read.rig, nearest=True)):
        zeros.append(of_energy)
    return float(np.abs(zeros).max(initial=0.0))


def _as_counts(read: InterpretedTable) -> Interpretation | None:
    """Create an interpretation of integers as encoder counts, possibly with other zeros.

    The result is None unless the energy of a free swing is conserved in this interpretation.
    """
    whole = all(np.array_equal(column, np.round(column)) for column in read.values.values())
    if read.options.unit == "counts" or read.options.offset or read.options.scale or not whole:
        return None
    counted = replace(read, options=replace(read.options, unit="counts", wrap=None))
    right = _conserves(energy_fit(read.t, counted.rods(read.values, counted.options), None, read.rig))
    moved = Interpretation((), (), read.values, counted.options) if right else _with_other_zeros(counted)
    if moved is None:
        return None
    causes = ("the angles are counts of the encoders", *moved.causes)
    return replace(moved, causes=causes, words=("--unit", "counts"))


def _conserves(fit: EnergyFit | None) -> bool:
    """Check whether the energy residual of a free swing indicates a correct interpretation."""
    return fit is not None and fit.residual <= READ.right / READ.alike


def _with_other_zeros(read: InterpretedTable) -> Interpretation | None:
    """Create an interpretation with other zeros, in which a free swing conserves its energy.

    The result is None if there are no such zeros, or if they differ so little that a diagnosis fits them.
    """
    rods = read.rods(read.values, read.options)
    added = energy_zeros(read.t, rods, read.rig)
    if added is None or not _conserves(energy_fit(read.t, rods + added, None, read.rig)):
        return None
    moved = _with_zeros(read, added)
    return moved if moved.mend or read.options.unit == "counts" else None


def balanced_interpretations(read: InterpretedTable) -> list[Interpretation]:
    """List interpretations with a clearly smaller residual of the torque balance.

    Of interpretations with similar residuals, only those with the fewest differences are listed.
    """

    def balance(values: Values, options: ImportOptions) -> TorqueBalance | None:
        return torque_balance(read.t, read.rods(values, options), read.torques, read.rig)

    equations = balance(read.values, read.options)
    if equations is None or (residual := equations.residual()) <= READ.balanced:
        return []
    residuals: list[tuple[float, Interpretation]] = []
    nearest = equations.zeros(nearest=True)
    balancing = nearest if residual <= READ.near_balance else equations.zeros()
    zeros = _with_zeros(read, balancing)
    for reading in (*other_interpretations(read), *(() if read.drive else (zeros,))):
        other = None if reading.time_factor != 1 else balance(reading.values, reading.options)
        if other is not None:
            residuals.append((other.residual(), reading))
    best = min((unbalance for unbalance, _ in residuals), default=np.inf)
    limit = min(READ.sure_balance, residual / READ.better_balance, READ.alike_balance * best)
    balanced = [reading for unbalance, reading in sorted(residuals, key=lambda pair: pair[0]) if unbalance <= limit]
    named = [reading for reading in balanced if reading is not zeros] or balanced
    if named:
        return fewest_changes(named)
    wrong_zero = np.abs(nearest).max() >= READ.wrong_zero_rad and not read.drive
    wrong_zero = wrong_zero and equations.residual(nearest) <= min(READ.sure_balance, residual / READ.better_zero)
    return [_with_zeros(read, nearest)] if wrong_zero else []


def _with_zeros(read: InterpretedTable, added: ArrayLike) -> Interpretation:
    """Create an interpretation in which two offsets, rad, are added to the absolute angles.

    The interpretation describes them by `--zero`, `--offset`, or `zero_counts` of the rig file.
    """
    values, options, rig = read.values, read.options, read.rig
    if options.unit != "counts":
        from_pi = np.abs((np.asarray(added) % (2 * np.pi)) - np.pi)
        # The remaining difference is an error of the zero that a diagnosis names.
        if from_pi.max() < READ.wrong_zero_rad:
            return _changed(read, zero=True)
        return with_zeros(read, added)
    turned = without_turns(rig.encoders.joint_angles.of_rods(added))
    counts = np.round(turned / np.asarray(rig.radians_per_count)[1:])
    moved = {axis: values[axis] + count for axis, count in zip(AXES[1:], counts, strict=True)}
    zeros = [round(zero) for zero in np.asarray(rig.encoders.zero_counts)[1:] - counts]
    if rig.rods.mounting != "both":  # a single rod: choose the turn of the zero that contains the swing
        turn = 2 * np.pi / abs(rig.radians_per_count[1])
        zeros[0] += round(turn * round((float(np.median(values["theta1"])) - zeros[0]) / turn))
    of_joint2 = f" and {zeros[1]} for joint 2" if rig.rods.mounted == "both" else ""
    cause = f"zero_counts of the rig file is {zeros[0]} for joint 1{of_joint2}"
    return Interpretation((cause,), (), {**values, **moved}, options)


def with_zeros(read: InterpretedTable, added: ArrayLike, tolerance: float = 0.0) -> Interpretation:
    """Create an interpretation with two offsets added to the absolute angles.

    Small offsets are omitted.

    Args:
        read: the table
        added: (2,) offsets, rad
        tolerance: largest difference, rad, for which an offset is replaced by the nearest usual zero error
    """
    turned = without_turns(np.asarray(added))
    usual = np.round(turned / READ.usual_zero_rad) * READ.usual_zero_rad
    inner, outer = np.where(np.abs(turned - usual) <= tolerance, usual, turned).tolist()
    values, options = read.values, read.options
    unit = TO_RADIANS[options.unit or "rad"]
    columns = (inner, without_turns(outer - inner) if options.angles == "relative" else outer)
    digits = 1 if options.unit == "deg" else 3
    offset = tuple(round(zero / unit, digits) if abs(zero) > READ.zero_rad else 0.0 for zero in columns)
    moved = {axis: values[axis] + value for axis, value in zip(AXES[1:], offset, strict=True)}
    causes = ("the angles have other zeros",)
    return Interpretation(causes, (), {**values, **moved}, options, offset=(offset[0], offset[1]))


def _per_rod(option: str, value: Mapping[str, float], neutral: float) -> tuple[str, str]:
    """Return name and text of an option.

    The text is one value if it is equal for both rods; otherwise it contains a value for each rod.
    """
    if set(value) == set(AXES[1:]) and len(set(value.values())) == 1:
        return option, f"{value['theta1']:g}"
    return option, ",".join(
        f"{axis}={value_of_axis:g}" for axis, value_of_axis in value.items() if value_of_axis != neutral
    )


def other_interpretations(read: InterpretedTable) -> Iterator[Interpretation]:
    """Yield interpretations with a different zero, reference, sign, order, unit or scale."""
    options = read.options
    counted, both_rods = options.unit == "counts", read.rig.rods.mounting == "both"
    zeros = (False,) if counted else (False, True)
    references = (False,) if counted or not both_rods else (False, True)
    of_joints = (False, True) if both_rods else (False,)
    for zero, reference, sign, swap in product(zeros, references, of_joints, of_joints):
        if zero or reference or sign or swap:
            yield _changed(read, zero=zero, reference=reference, sign=sign, swap=swap)
    for unit, (zero, reference) in product(() if counted else ("rad", "deg"), product(zeros, references)):
        if unit != options.unit:
            other = _changed(read, zero=zero, reference=reference)
            yield replace(
                other,
                causes=(f"the angles are in {unit}", *other.causes),
                words=(*unit_words(read), *other.words),
                options=replace(other.options, unit=unit),
            )
    yield from _scaled(read)
    for unit in TO_SECONDS if options.rate_hz is None else ():
        factor = TO_SECONDS[unit] / TO_SECONDS[options.time_unit or "s"]
        if factor != 1:
            yield Interpretation((f"the times are in {unit}",), ("--time-unit", unit), read.values, options, factor)


def unit_words(read: InterpretedTable) -> tuple[str, ...]:
    """Return the command-line options that exchange degrees and radians.

    If the name of a column states its unit, `--unit` would contradict the name. The options are then factors for
    `--scale`.
    """
    unit = "deg" if read.options.unit == "rad" else "rad"
    if not any(UNIT_IN_NAME.search(name.lower()) for axis, name in read.columns.items() if axis in AXES):
        return "--unit", unit
    factor = TO_RADIANS[unit] / TO_RADIANS[read.options.unit or "rad"]
    scale = {axis: factor * read.options.scale.get(axis, 1.0) for axis in AXES[1:]}
    return _per_rod("--scale", scale, 1.0)


def _scaled(read: InterpretedTable) -> Iterator[Interpretation]:
    """Yield interpretations in which the readings of one or both rods are halved or doubled."""
    values, options, rig = read.values, read.options, read.rig
    counted = options.unit == "counts"
    zeros = rig.encoders.zero_counts[1:] if counted else (0.0, 0.0)
    relative = rig.encoders.joint2 == "relative" if counted else options.angles == "relative"
    one_each = rig.rods.mounting == "both" or (rig.rods.mounting == "clamped" and relative)
    for factor, joints in product((0.5, 2.0), ((1, 2), (1,), (2,)) if one_each else ((1, 2),)):
        scale = (factor if 1 in joints else 1.0, factor if 2 in joints else 1.0)
        turned = {
            axis: zero + (values[axis] - zero) * times for axis, zero, times in zip(AXES[1:], zeros, scale, strict=True)
        }
        if counted:
            suffix = "" if len(joints) > 1 else f" for joint {joints[0]}"
            cause = f"counts_per_rev of the rig file is {1 / factor:g} times as large{suffix}"
            turned, scale = {axis: np.round(column) for axis, column in turned.items()}, (1.0, 1.0)
        else:
            which = "the angles" if len(joints) > 1 else f"theta{joints[0]}"
            cause = f"{which} must be multiplied by {factor:g}"
        yield Interpretation((cause,), (), {**values, **turned}, options, scale=scale)


def _slower(read: InterpretedTable, factor: float) -> Interpretation:
    """Create an interpretation in which the times of the table are multiplied by a factor."""
    if read.options.rate_hz is not None:
        cause = f"the rate is about {read.near_frames(read.options.rate_hz / factor):.3g} Hz (--rate-hz)"
    else:
        cause = (
            f"one second of the table is about {factor:.3g} s: the clock of the logger is wrong, or the"
            " rate is known and replaces the times (--rate-hz)"
        )
    return Interpretation((cause,), (), read.values, read.options, factor)


def _changed(
    read: InterpretedTable, *, zero: bool = False, reference: bool = False, sign: bool = False, swap: bool = False
) -> Interpretation:
    causes, words, changed, options = [], [], dict(read.values), read.options
    if swap:
        changed |= {"theta1": changed["theta2"], "theta2": changed["theta1"]}
        causes.append("the columns of the two rods are exchanged")
        inner, outer = (read.columns.get(axis, "NAME") for axis in ("theta2", "theta1"))
        words += ["--columns", f"theta1={inner},theta2={outer}"]
    if zero:
        options = replace(options, zero="upright" if options.zero == "hanging" else "hanging")
        causes.append(f"the angles are zero where the rods {'hang' if options.zero == 'hanging' else 'stand upright'}")
        words += ["--zero", options.zero]
    if reference:
        options = replace(options, angles="absolute" if options.angles == "relative" else "relative")
        direction = "inner rod" if options.angles == "relative" else "vertical"
        causes.append(f"the angle of the outer rod is relative to the {direction}")
        words += ["--angles", options.angles]
    if sign:
        changed["theta2"] = -changed["theta2"]
        causes.append("the angle of one rod has the opposite sign (direction of its encoder)")
    return Interpretation(tuple(causes), tuple(words), changed, options, scale=(1.0, -1.0 if sign else 1.0))
