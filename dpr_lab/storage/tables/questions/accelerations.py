"""Warnings about the interpretation and the rig file, from the accelerations of the swing.

Accelerations are more sensitive to a wrong interpretation than the energy of the swing.
"""

from dataclasses import replace

import numpy as np

from dpr_lab.identification.misread.moving_arm_balance import arm_balance, is_unit, wrong_unit
from dpr_lab.identification.misread.torque_balance import inertia_bounds, torque_balance
from dpr_lab.shown import percent
from dpr_lab.storage.tables.angles import angles
from dpr_lab.storage.tables.columns import TO_RADIANS
from dpr_lab.storage.tables.interpreted import SETTINGS, InterpretedTable, TableQuestion
from dpr_lab.storage.tables.readings import balanced_interpretations, read_otherwise


def balance_questions(table: InterpretedTable) -> list[TableQuestion]:
    """Warn if other zeros, scales or signs agree better with the accelerations of the swing."""
    if table.prescribed:
        return []
    others = balanced_interpretations(table.beginning())
    broken = "the accelerations do not follow from gravity and friction, but they do"
    return [read_otherwise(broken, others, table.beginning())] if others else []


def rig_questions(table: InterpretedTable) -> list[TableQuestion]:
    """Warn if the inertias of the swing are outside the bounds of the rig file.

    Rigs with gears are not checked, because their motors add inertia.
    """
    if not table.free or table.ignored or table.rig.joints.geared:
        return []
    read = table.beginning()
    balance = torque_balance(read.t, read.rods(read.values, read.options), None, read.rig)
    if balance is None:
        return []
    residual, ratios = balance.inertias()
    least, most = inertia_bounds(table.rig, balance.elbow)
    factor = max(np.max(least / ratios), np.max(ratios / most))
    if residual > SETTINGS.same_rig or factor <= SETTINGS.other_rig:
        return []
    slow, fast = (table.options.rate_hz or 0) * np.sqrt([np.max(ratios / most), np.min(ratios / least)])
    filmed = f" Or were {slow:.3g} to {fast:.3g} rows or frames per second recorded (--rate-hz)?" if slow < fast else ""
    return [
        TableQuestion(
            f"the inertia of the rods relative to their weight differs by {percent(factor - 1)} from the nearest value"
            f" that the rig file {table.rig.rig.name!r} allows: is it the file of the recorded rig (--rig)?{filmed}"
            " Otherwise correct its lengths, masses, inertias and their bounds"
        )
    ]


def unit_questions(table: InterpretedTable) -> list[TableQuestion]:
    """Warn about a wrong unit of the angles of a moving arm and its rods.

    The evidence is the equation of motion of the last rod.
    """
    unit = table.options.unit
    if not table.arm_moves or unit not in TO_RADIANS:
        return []
    other, read = "rad" if unit == "deg" else "deg", table.beginning()
    factor = TO_RADIANS[other] / TO_RADIANS[unit]
    converted, _ = angles(read.values, replace(table.options, unit=other), table.rig, table.path)
    balance, balance_converted = (arm_balance(read.t, theta, table.rig) for theta in (read.theta, converted))
    rods = wrong_unit(balance.residual, balance_converted.residual)
    arm = is_unit(balance.arm_scale, factor) or (rods and not is_unit(balance_converted.arm_scale, 1.0 / factor))
    if not (arm or rods):
        return []
    names = [*(["theta0"] if arm else []), *(["theta1", "theta2"][: table.rig.rods.number] if rods else [])]
    mend = ("--unit", other) if arm and rods else ("--scale", ",".join(f"{name}={factor:.6g}" for name in names))
    subject = "the angles are" if arm and rods else f"{' and '.join(names)} {'are' if len(names) > 1 else 'is'}"
    sentence = (
        f"with these options the rod's acceleration does not follow from gravity and the motion of the arm; it does if"
        f" {subject} in {other} ({' '.join(mend)})"
    )
    return [TableQuestion(sentence, mend, other_unit=True)]
