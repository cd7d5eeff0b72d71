"""Warnings from the energy of a swing: units, zeros, signs, columns, and known torques."""

import math
from bisect import bisect_left
from dataclasses import replace
from itertools import pairwise, product

import numpy as np

from dpr_lab.errors import RunError
from dpr_lab.identification.misread.balance import (
    ENERGY,
    energy_fit,
    energy_zeros,
    other_pace,
    periods,
    residual_near,
)
from dpr_lab.shown import percent
from dpr_lab.storage.tables.columns import TO_SECONDS
from dpr_lab.storage.tables.interpreted import SETTINGS, InterpretedTable, TableQuestion
from dpr_lab.storage.tables.plausible import odd_notes
from dpr_lab.storage.tables.questions.pose import as_posed
from dpr_lab.storage.tables.questions.torques import better_torques
from dpr_lab.storage.tables.readings import (
    BROKEN,
    READ,
    Interpretation,
    better_interpretations,
    energy_residual,
    other_interpretations,
    read_otherwise,
    with_zeros,
)


def energy_questions(table: InterpretedTable) -> tuple[list[TableQuestion], list[Interpretation]]:
    """Warn about units, zeros, signs and column order from the energy of the swing.

    Returns:
        The warnings, and the interpretations in which the energy is conserved better.
    """
    read = table.beginning()
    fit = energy_fit(read.t, read.theta[:, 1:], read.torques, table.rig)
    residual, others = math.nan, []
    if fit is not None and not table.prescribed:
        residual = fit.residual
        others = better_interpretations(fit, read)
        if others and all(other.scale != (1.0, 1.0) for other in others):
            others += [other for other in _turned(read) if energy_residual(read, other) < READ.sure]
        if not others and (doubts := better_torques(fit, read)):
            return doubts, []
    if fit is not None and not others and table.options.inner != "prescribed":
        _refuse_unit_of_time(table, fit.kinetic_scale)
    for other in others:
        if "--time-unit" in other.mend:
            raise RunError(_unit_of_time(table, other.mend[1]))
    if others:
        others = [as_posed(table, other) for other in others]
        return [read_otherwise(BROKEN, others, read)], others
    notes = []
    unexplained = ENERGY.unexplained[table.torques is not None]
    if residual > unexplained:
        residual = residual_near(read.t, read.theta[:, 1:], read.torques, table.rig)
    if residual > unexplained:
        share, rate = f"{percent(residual)} of" if residual < 1 else "more than", table.options.rate_hz
        pace = other_pace(read.t, read.theta[:, 1:], table.rig) if rate and table.free else 1.0
        other = (
            f"; much less with --rate-hz {table.near_frames(rate * pace):g}: was this the frame rate of the camera?"
            if rate and pace != 1.0
            else _nearest(read, residual)
        )
        part = "" if other else _explained_part(table)
        drive = table.drive and f"; {table.drive}: record the torques of the motors, or a free swing"
        counted = table.options.unit == "counts"
        angles = "counts_per_rev, zero_counts, --offset" if counted else "--unit, --scale, --zero, --offset, --angles"
        notes.append(
            f"{part}. In the whole swing, the energy changes by {share} the energy exchanged by gravity; friction and"
            f" known torques explain the change only in this part{drive}"
            if part
            else f"the energy of the swing changes by {share} the energy exchanged by gravity, and friction and known"
            f" torques do not explain this change: check {angles}, --columns, --time-unit, --torque"
            f" (in N m) and --arm, and lengths and masses of the rig{other}{drive}"
        )
    elif fit is not None and table.free and abs(math.log(fit.time_scale)) >= math.log(SETTINGS.time_scale):
        notes.append(
            f"the rods swing {fit.time_scale:.3g} times as fast as predicted from lengths and masses of the rig"
            " file: check L1, masses and inertias of the rig, --rate-hz or --time-unit"
        )
    upright = (
        table.options.zero == "upright"
        and table.options.unit != "counts"
        and not residual <= READ.right
        and table.torques is None
        and table.ignored is None  # drives can hold rods up
        and (table.options.pose is None or not table.arm_moves)  # the pose reveals a wrong zero
    )
    radians = table.free and table.options.unit in (None, "rad")
    odd = odd_notes(table.t[table.swing], table.theta[table.swing], upright, table.rig.rods.number, radians)
    return [TableQuestion(note) for note in (*odd, *notes)], []


def _nearest(read: InterpretedTable, residual: float) -> str:
    """Describe the interpretation with by far the smallest energy residual.

    The result is the end of a sentence; it is empty if there is no such interpretation. This interpretation is not
    proposed as a correction, because it does not conserve the energy either.
    """
    turned = _turned(read, ENERGY.zero_error_rad)  # the residual already includes smaller errors of the zero
    others = (
        other for other in other_interpretations(read) if other.mend and (not turned or other.scale == (1.0, 1.0))
    )
    fits = sorted((energy_residual(read, other), other.sentence) for other in (*others, *turned))
    (least, sentence), (second, _) = [*fits, *[(math.inf, "")] * 2][:2]
    lead, most = SETTINGS.nearest
    near = least <= min(most, residual / lead, second / lead)
    return f"; it changes by {percent(least)} if {sentence}" if near else ""


def _explained_part(table: InterpretedTable) -> str:
    """Describe the longest part of a free swing in which the energy is consistent with friction.

    The result is the beginning of a sentence. A coil, a hand or a motor drives the rods in the rest of the swing. Half
    a period next to this rest is excluded as well. The result is empty if no consistent part is at least half the swing
    and at least one period long.
    """
    rows, before = table.looked_at, table.options.start_s - table.t[0]
    t, rods = table.t[rows], table.theta[rows, 1:]
    duration_s, period = t[-1] - t[0], periods(table.rig)[0]

    def residual(cut: float, later: bool, limit: float = 0.0) -> float:
        samples = t >= t[0] + cut if later else t <= t[-1] - cut
        return residual_near(t[samples], rods[samples], None, table.rig, limit=limit)

    cuts = np.linspace(0, 0.5, 9) * duration_s
    parts = pairwise(cuts[cuts <= duration_s - period][1:]) if table.free else ()
    for (cut, longest), later in product(parts, (True, False)):
        if residual(cut, later, READ.sure) > READ.sure:
            continue
        limit = READ.alike * residual(longest, later)  # a remainder of the drive exceeds it
        finer = np.linspace(cut - cuts[1], longest, 33)
        clear = finer[bisect_left(finer, True, hi=32, key=lambda shorter: residual(shorter, later, limit) <= limit)]
        safe = min(clear + period / 2, longest)
        if later:
            begins = f"{round(t[np.searchsorted(t, t[0] + safe)] + before, 2):g}"
            return (
                f"use only the swing from {begins} s on (--start-s {begins}): before that time, a drive or a hand"
                " probably acted"
            )
        ends = f"{round(t[np.searchsorted(t, t[-1] - safe, 'right') - 1] - table.t[0], 2):g}"
        return f"use only the first {ends} s (--duration-s {ends}): later, a drive or a hand probably acted"
    return ""


def _turned(read: InterpretedTable, least_rad: float = READ.wrong_zero_rad) -> list[Interpretation]:
    """Return an interpretation in which a single free rod hangs at an angle other than 0 or half a turn.

    The list is empty if the rod hangs within `least_rad` of 0 or half a turn. If it hangs at 90 degrees of the table,
    the doubled angles also look like an energy-conserving swing about the hanging position.
    """
    if read.torques is not None or read.drive or read.rig.rods.mounting == "both" or read.options.unit == "counts":
        return []
    added = energy_zeros(read.t, read.rods(read.values, read.options), read.rig)
    if added is None or abs(math.sin(added[0])) < math.sin(least_rad):
        return []
    cause = "the camera is turned, or a constant torque deflects the hanging rod"
    return [replace(with_zeros(read, added), causes=(cause,))]


def _refuse_unit_of_time(table: InterpretedTable, scale: float) -> None:
    unit_used = table.options.time_unit or "s"
    if not 0 < scale < np.inf or 1 / SETTINGS.other_unit < scale < SETTINGS.other_unit or table.options.rate_hz:
        return
    unit = min(TO_SECONDS, key=lambda name: abs(math.log(TO_SECONDS[name] / TO_SECONDS[unit_used] / scale)))
    if unit != unit_used:
        raise RunError(_unit_of_time(table, unit, scale))


def _unit_of_time(table: InterpretedTable, unit: str, scale: float | None = None) -> str:
    """Compose the message about a wrong unit of time.

    Args:
        table: the table
        unit: the nearest unit
        scale: true duration divided by the duration in the current unit; None if the energy does not determine it. If
            the scale agrees with no unit, whole numbers whose steps are multiples of the smallest step count as row
            numbers.
    """
    factor = TO_SECONDS[table.options.time_unit or "s"]
    duration_s = table.t[-1] - table.t[0]
    steps = np.diff(table.t) / factor
    step = np.gcd.reduce(np.rint(steps).astype(np.int64))
    numbered = np.allclose(steps, np.rint(steps)) and 0 < step == np.rint(steps.min())
    causes, rows = f"the times are in {unit} (--time-unit {unit})", "the column numbers the rows or frames (--rate-hz"
    if numbered and scale is not None and abs(math.log(TO_SECONDS[unit] / factor / scale)) > math.log(READ.alike):
        causes = f"{rows}, about {float(f'{1 / (factor * scale * step):.2g}'):g} Hz), or {causes}"
    elif numbered and step == 1:
        causes += f", or {rows})"
    ending = f": {causes}, or the angles are in another unit (--unit, --scale)"
    if np.median(steps) * TO_SECONDS[unit] > periods(table.rig)[1] / SETTINGS.refused_rows_a_period:
        ending = (
            f". In {unit} the rows would be too far apart, so the unit of time is not the cause: the column is not an"
            " angle (--columns), or its unit is another one (--unit, --scale)"
        )
    return (
        f"{table.path}: with times in {table.options.time_unit or 's'}, the table lasts {duration_s:.4g} s and its rods"
        f" {'hardly move' if unit != 's' else 'turn far too fast'}, but the rods of the rig swing with periods of"
        f" {' and '.join(dict.fromkeys(f'{period:.2g} s' for period in periods(table.rig)))}{ending}"
    )
