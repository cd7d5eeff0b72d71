"""Warnings about the pose of the release."""

from dataclasses import replace

import numpy as np

from dpr_lab.arrays import Array, without_turns
from dpr_lab.errors import RunError
from dpr_lab.storage.tables.interpreted import SETTINGS, InterpretedTable, TableQuestion
from dpr_lab.storage.tables.readings import (
    READ,
    Interpretation,
    energy_residual,
    fewest_changes,
    other_interpretations,
    with_zeros,
)


def pose_questions(table: InterpretedTable) -> list[TableQuestion]:
    """Warn if the release is not at the named pose.

    Raises:
        RunError: the release is far away from the named pose.
    """
    if table.options.pose is None:
        return []
    began = np.median(table.theta[table.rest, 1:], axis=0)
    deviations = {name: apart(began, pose.theta[1:]) / pose.tolerance for name, pose in table.rig.poses.items()}
    pose = table.rig.poses[table.options.pose]
    if (deviation := deviations[table.options.pose]) <= SETTINGS.pose[0]:
        return []
    began_at, asked_for = (f"theta1 = {a:.2f}, theta2 = {b:.2f} rad" for a, b in (began, pose.theta[1:]))
    near = [name for name, distance in deviations.items() if distance <= SETTINGS.pose[0]]
    counted = table.options.unit == "counts"
    keys = (
        "zero_counts, joint2, direction and counts_per_rev of the rig file"
        if counted
        else "--zero, --offset, --angles, --unit"
    )
    mend, words = f"remove --pose, or correct {keys}", ()
    if near:
        mend, words = f"it is pose {near[0]} (--pose {near[0]})", ("--pose", near[0])
    elif others := _interpretations_in_pose(table) or _zeros_in_pose(table, pose.theta[1:] - began):
        mend = f"it would if {'; or '.join(other.sentence for other in others)}"
        words = others[0].mend if len(others) == 1 else ()
    sentence = f"the swing starts at {began_at}, not in pose {table.options.pose} ({asked_for}): {mend}"
    if deviation > SETTINGS.pose[1]:
        raise RunError(f"{table.path}: {sentence}")
    return [TableQuestion(sentence, words)]


def _interpretations_in_pose(table: InterpretedTable) -> list[Interpretation]:
    """List interpretations that start at the named pose and conserve the energy.

    Only interpretations with the fewest changes are listed.
    """
    read = table.beginning()
    others, as_read = list(other_interpretations(read)), Interpretation((), (), read.values, table.options)
    candidates = [as_read.mirrored, *others, *(other.mirrored for other in others)]
    posed = [other for other in candidates if other.time_factor == 1 and _in_pose(table, other)]
    residuals = [energy_residual(read, other) for other in posed]
    limit = min(READ.right, READ.alike * min(residuals, default=0.0))
    return fewest_changes([other for other, residual in zip(posed, residuals, strict=True) if residual <= limit])


def _zeros_in_pose(table: InterpretedTable, added: Array) -> list[Interpretation]:
    """Return an interpretation whose zeros start the swing at the named pose.

    The list is empty if the energy is conserved less well with these zeros.
    """
    if table.options.unit == "counts" or table.options.pose is None:
        return []
    read, tolerance = table.beginning(), table.rig.poses[table.options.pose].tolerance
    other = with_zeros(read, added, tolerance)
    worst = max(READ.right, energy_residual(read, replace(other, values=read.values)))
    return [other] if energy_residual(read, other) <= worst else []


def as_posed(table: InterpretedTable, other: Interpretation) -> Interpretation:
    """Return the interpretation, or its mirror image if only the mirror image starts at the named pose."""
    behind = not _in_pose(table, other) and _in_pose(table, other.mirrored)
    return other.mirrored if behind else other


def _in_pose(table: InterpretedTable, other: Interpretation) -> bool:
    if table.options.pose is None:
        return False
    pose = table.rig.poses[table.options.pose]
    released = {axis: column[:1] for axis, column in other.values.items()}
    (rods,) = table.rods(released, other.options)
    return apart(rods, pose.theta[1:]) <= SETTINGS.pose[0] * pose.tolerance


def apart(rods: Array, pose: Array) -> float:
    """Return the largest angle between a rod and its pose, rad, without full turns."""
    return float(np.abs(without_turns(rods - pose)).max())
