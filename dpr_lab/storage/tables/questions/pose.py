"""Warn about the pose of the release."""

import numpy as np

from dpr_lab.arrays import Array, without_turns
from dpr_lab.errors import RunError
from dpr_lab.storage.tables.interpreted import SETTINGS, InterpretedTable, TableQuestion
from dpr_lab.storage.tables.readings import OtherReading


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
        else "--zero, --offset, --angles, --unit, --scale"
    )
    mend, words = f"remove --pose, or correct {keys}", ()
    if near:
        mend, words = f"it is pose {near[0]} (--pose {near[0]})", ("--pose", near[0])
    sentence = f"the swing starts at {began_at}, not in pose {table.options.pose} ({asked_for}): {mend}"
    if deviation > SETTINGS.pose[1]:
        raise RunError(f"{table.path}: {sentence}")
    return [TableQuestion(sentence, words)]


def as_posed(table: InterpretedTable, other: OtherReading) -> OtherReading:
    """Return the interpretation, or its mirror image if only the mirror image starts at the named pose."""
    behind = not _in_pose(table, other) and _in_pose(table, other.mirrored)
    return other.mirrored if behind else other


def _in_pose(table: InterpretedTable, other: OtherReading) -> bool:
    if table.options.pose is None:
        return False
    pose = table.rig.poses[table.options.pose]
    released = {axis: column[:1] for axis, column in other.values.items()}
    (rods,) = table.rods(released, other.options)
    return apart(rods, pose.theta[1:]) <= SETTINGS.pose[0] * pose.tolerance


def apart(rods: Array, pose: Array) -> float:
    """Return the largest angle between a rod and its pose, rad, without full turns."""
    return float(np.abs(without_turns(rods - pose)).max())
