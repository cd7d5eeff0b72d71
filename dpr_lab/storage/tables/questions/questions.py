"""Run all checks of the interpretation of a table.

A table that cannot be used is refused. Each warning names the options that may correct the interpretation.
"""

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.errors import RunError
from dpr_lab.identification.misread.balance import periods
from dpr_lab.storage.tables.interpreted import SETTINGS, InterpretedTable, TableQuestion
from dpr_lab.storage.tables.questions.accelerations import balance_questions, rig_questions, unit_questions
from dpr_lab.storage.tables.questions.energy import energy_questions
from dpr_lab.storage.tables.questions.hand import hand_questions
from dpr_lab.storage.tables.questions.joined import gap_questions, joined_questions, rise_questions, section_questions
from dpr_lab.storage.tables.questions.lost_frames import lost_frame_questions
from dpr_lab.storage.tables.questions.period import degree_questions, period_questions, small_questions
from dpr_lab.storage.tables.questions.pose import apart, pose_questions
from dpr_lab.storage.tables.questions.torques import torque_questions


def questions(table: InterpretedTable) -> list[TableQuestion]:
    """Return the warnings about the interpretation of a table, most serious first.

    Raises:
        RunError: the table cannot be used because of too few rows, constant or identical columns, a wrong unit of time,
            or another pose.
    """
    t, theta = table.t[table.swing], table.theta[table.swing]
    if len(t) < SETTINGS.fewest_rows:
        raise RunError(f"{table.path}: only {len(t)} rows of a swing; at least {SETTINGS.fewest_rows} are required")
    _refuse_dead(table, theta)
    if of_unit := unit_questions(table):
        return [*of_unit, *_few(table, t)]
    if lost := lost_frame_questions(table):  # uneven times disturb every other test
        return [*lost, *_few(table, t)]
    doubts, other = energy_questions(table)
    arm = _arm_questions(table, theta[:, 0])
    few_rows = [*joined_questions(table), *_few(table, t), *torque_questions(table)]
    if separate := section_questions(table) or gap_questions(table):  # the parts are tested when each is imported
        return separate
    sure = other or any(doubt.mend for doubt in doubts)
    in_degrees = [] if any("--unit deg" in doubt.sentence for doubt in doubts) else degree_questions(table)
    if not sure and (separate := in_degrees or rise_questions(table)):
        return [*separate, *arm, *few_rows]
    posed = [] if other else pose_questions(table)
    certain = other or posed or arm or any(doubt.mend for doubt in doubts)
    if not certain:
        of_unit = period_questions(table) or small_questions(table)
        sure = balance_questions(table) or [doubt for doubt in of_unit if doubt.mend]
        doubts = sure or [*of_unit, *rig_questions(table), *hand_questions(table), *doubts]
    return [*doubts, *arm, *few_rows, *posed]


def _refuse_dead(table: InterpretedTable, theta: Array) -> None:
    """Refuse equal columns, and rods or free elbows that do not move."""
    if table.rig.rods.mounted != "both":
        return
    names = [table.columns.get(axis, axis) for axis in ("theta1", "theta2")]
    moved1, moved2 = np.ptp(theta[:, 1:], axis=0).tolist()
    most, joint2 = max(moved1, moved2), np.ptp(theta[:, 2] - theta[:, 1])
    if table.rig.rods.elbow == "clamped" or not most > 0:
        return
    if np.array_equal(table.values["theta1"], table.values["theta2"]):
        raise RunError(
            f"{table.path}: {names[0]!r} and {names[1]!r} contain the same numbers. Name the columns of the two rods:"
            " --columns theta1=NAME,theta2=NAME; if the elbow was clamped: --elbow clamped"
        )
    if joint2 < SETTINGS.stiff_rad and joint2 < SETTINGS.stiff_rad * most:
        raise RunError(
            f"{table.path}: theta2 - theta1 stays within {joint2:.2g} rad while the rods turn by {most:.3g}"
            f" rad: joint 2 does not turn. If the elbow was clamped: --elbow clamped; otherwise name the"
            f" column: --columns theta2=NAME"
        )
    if moved2 < SETTINGS.still_share * most:
        raise RunError(
            f"{table.path}: theta2 ({names[1]!r}) is constant while theta1 turns by {most:.3g} rad. If no outer rod"
            " was mounted: --rods inner; if it is the angle to the inner rod and the elbow was clamped: --angles"
            " relative --elbow clamped; otherwise name the column: --columns theta2=NAME"
        )
    if moved1 < SETTINGS.still_share * most:
        raise RunError(
            f"{table.path}: theta1 ({names[0]!r}) is constant while theta2 turns by {most:.3g} rad. If only the"
            " outer rod swung, use --rods outer; otherwise name the column: --columns theta1=NAME"
        )


def refuse_push(table: InterpretedTable, origin: float, cart: Array | None, of_cart: str) -> None:
    """Refuse a table whose rods leave the hanging rest without a known drive.

    Args:
        table: the table
        origin: time to which the option --start-s refers, s
        cart: (n,) column that may be the position of a cart, m; None if there is no column
        of_cart: note on how to import this cart, or empty

    Raises:
        RunError: the rods were pushed; the message names the option that excludes the push.
    """
    rest, start = table.part.rest, table.part.start
    if start == rest or not table.free:
        return
    hung = apart(np.median(table.theta[rest:start, 1:], axis=0), np.array([np.pi, np.pi]))
    excursion = np.ptp(table.theta[table.swing, 1:], axis=0).max()
    if hung <= SETTINGS.hanging_rad and excursion > max(SETTINGS.pushed_rad, SETTINGS.pushed_ratio * hung):
        if cart is not None and _carried(table, cart):
            return
        begins = table.t[start] - origin
        raise RunError(
            f"{table.path}: the rods hang at rest until {begins:.4g} s after the first row and then swing:"
            f" they were pushed by an unknown force. Exclude the push (--start-s {begins + 1:.4g}), or name"
            " the torques' columns tau1_Nm, tau2_Nm; --keep-rest uses all rows"
            + (f". Or a cart set the rod in motion: {of_cart}" if of_cart else "")
        )


def _carried(table: InterpretedTable, cart: Array) -> bool:
    """Return whether a column can be the position of a cart that accelerates the single rod.

    It cannot if it is a function of the angle, like the position of a point on the rod.
    """
    angle, still = table.theta[table.swing, 1], cart[table.part.rest : (table.part.rest + table.part.start + 1) // 2]
    of_angle = np.column_stack([np.ones_like(angle), angle, np.sin(angle), np.cos(angle)])
    moved = cart[table.swing]
    remainder = moved - of_angle @ np.linalg.lstsq(of_angle, moved, rcond=None)[0]
    if remainder.var() < SETTINGS.of_angle * moved.var():
        return False
    period = periods(table.rig)[0]
    first = slice(table.part.rest, int(np.searchsorted(table.t, table.t[table.part.start] + period)))
    carried = table.rig.g * (period / (2 * np.pi)) ** 2 * np.ptp(table.theta[first, 1])
    return bool(np.ptp(cart[first]) > max(SETTINGS.jitter * np.ptp(still), SETTINGS.carried * carried))


def _few(table: InterpretedTable, t: Array) -> list[TableQuestion]:
    """Warn about a low sample rate or a short duration.

    Raises:
        RunError: there are too few rows to follow a swing.
    """
    slow, fast = periods(table.rig)
    step, lasts = np.median(np.diff(t)), t[-1] - t[0]
    doubts = []
    if step > fast / SETTINGS.refused_rows_a_period:
        raise RunError(
            f"{table.path}: rows are {step:.3g} s apart, but the rods of this rig swing with a period of"
            f" {fast:.2g} s: too few rows per period. Is the unit of time correct (--time-unit ms), or the rate"
            " (--rate-hz)?"
        )
    if step > fast / SETTINGS.rows_a_period:
        doubts.append(
            TableQuestion(
                f"rows are {step:.3g} s apart, {fast / step:.1f} in a period of the faster oscillation ({fast:.2g} s):"
                f" record at {SETTINGS.rows_a_period * 4 / fast:.0f} Hz or more, or correct --time-unit or --rate-hz"
            )
        )
    if len(t) < SETTINGS.few_rows or lasts < slow / 2:
        doubts.append(
            TableQuestion(
                f"{len(t)} rows in {lasts:.3g} s: a recording with fewer than {SETTINGS.few_rows} rows, or shorter"
                f" than half a period of the slower oscillation ({slow:.2g} s), contains little information"
            )
        )
    return doubts


def _arm_questions(table: InterpretedTable, theta0: Array) -> list[TableQuestion]:
    """Warn about an arm that is specified as clamped although it moves."""
    if table.arm_moves or not (moved := float(np.ptp(theta0))) > SETTINGS.arm_rad:
        return []
    known = "L0" in table.rig.rig.model_fields_set
    mend = "--arm prescribed" + ("" if known else ", with the arm's length L0 in [rig] of the rig file")
    sentence = f"theta0 moves by {moved:.2g} rad, but the arm is specified as clamped: if it moved, import with {mend}"
    return [TableQuestion(sentence, ("--arm", "prescribed") if known else ())]
