"""Doubts about a table: it is refused if it cannot be used, and a warning names the option that may correct it."""

import math
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.errors import RunError
from dpr_lab.identification.misread.balance import EnergyFit, energy_fit, other_pace, periods, residual_near
from dpr_lab.identification.misread.moving_arm_balance import arm_balance, is_unit, wrong_unit
from dpr_lab.identification.misread.torque_balance import inertia_bounds, torque_balance
from dpr_lab.shown import percent
from dpr_lab.storage.tables.columns import TO_RADIANS, TO_SECONDS
from dpr_lab.storage.tables.interpreted import SETTINGS, InterpretedTable, QuestionSettings, TableQuestion
from dpr_lab.storage.tables.plausible import odd_notes
from dpr_lab.storage.tables.readings import (
    READ,
    OtherReading,
    ReadTable,
    angles,
    balanced_readings,
    better_readings,
    with_zeros,
)
from dpr_lab.storage.tables.torques import better_torques, coarse_torques, idle_torques, other_torques


@dataclass(frozen=True, slots=True)
class PushSettings:
    """Limits for rods that are pushed."""

    hanging_rad: float = 0.03
    """Distance from hanging at rest within which rods do not start to swing by themselves, rad."""
    pushed_rad: float = 0.2
    """Later excursion that shows that they were pushed, rad."""


PUSH = PushSettings()


def questions(table: InterpretedTable, settings: QuestionSettings = SETTINGS) -> list[TableQuestion]:
    """Doubts about a table, most serious first.

    Raises:
        RunError: the table cannot be used: too few rows, constant or identical columns, another unit of time, another
        pose.
    """
    t, theta = table.t[table.swing], table.theta[table.swing]
    if len(t) < settings.fewest_rows:
        raise RunError(f"{table.path}: only {len(t)} rows of a swing; at least {settings.fewest_rows} are required")
    _refuse_dead(table, theta, settings)
    if of_unit := _unit_questions(table, settings):
        return [*of_unit, *_few(table, t, settings)]
    doubts, other = _energy_questions(table, settings)
    arm = _arm_questions(table, theta[:, 0], settings)
    few_rows = [*_few(table, t, settings), *_torque_doubts(table, settings)]
    posed = [] if other else _pose_questions(table, settings)
    certain = other or posed or arm or any(doubt.mend for doubt in doubts)
    if not certain:
        doubts = _balance_questions(table, settings) or [*_rig_questions(table, settings), *doubts]
    return [*doubts, *arm, *few_rows, *posed]


def _refuse_dead(table: InterpretedTable, theta: Array, settings: QuestionSettings) -> None:
    """Refuse a mounted rod or a free joint that does not move."""
    if table.rig.rods.mounted != "both":
        return
    names = [table.columns.get(axis, axis) for axis in ("theta1", "theta2")]
    moved1, moved2 = np.ptp(theta[:, 1:], axis=0).tolist()
    most, joint2 = max(moved1, moved2), float(np.ptp(theta[:, 2] - theta[:, 1]))
    if table.rig.rods.elbow == "clamped" or not most > 0:
        return
    if np.array_equal(table.values["theta1"], table.values["theta2"]):
        raise RunError(
            f"{table.path}: {names[0]!r} and {names[1]!r} contain the same numbers. Name the columns of the two rods:"
            " --columns theta1=NAME,theta2=NAME; if the elbow was clamped: --elbow clamped"
        )
    if joint2 < settings.stiff_rad and joint2 < settings.stiff_rad * most:
        raise RunError(
            f"{table.path}: theta2 - theta1 stays within {joint2:.2g} rad while the rods turn by {most:.3g}"
            f" rad: joint 2 does not turn. If the elbow was clamped: --elbow clamped; otherwise name the"
            f" column: --columns theta2=NAME"
        )
    if moved2 < settings.still_share * most:
        raise RunError(
            f"{table.path}: theta2 ({names[1]!r}) is constant while theta1 turns by {most:.3g} rad. If no outer rod"
            " was mounted: --rods inner; if it is the angle to the inner rod and the elbow was clamped: --angles"
            " relative --elbow clamped; otherwise name the column: --columns theta2=NAME"
        )
    if moved1 < settings.still_share * most:
        raise RunError(
            f"{table.path}: theta1 ({names[0]!r}) is constant while theta2 turns by {most:.3g} rad. If the outer rod"
            " swung alone: --rods outer; otherwise name the column: --columns theta1=NAME"
        )


def refuse_push(table: InterpretedTable, origin: float, settings: PushSettings = PUSH) -> None:
    """Refuse rods that start to swing from the hanging rest without a known drive.

    Raises:
        RunError: the rods were pushed; the message names the option that excludes the push.
    """
    rest, start = table.part.rest, table.part.start
    if start == rest or not table.free:
        return
    hung = apart(np.median(table.theta[rest:start, 1:], axis=0), np.array([np.pi, np.pi]))
    if hung <= settings.hanging_rad and np.ptp(table.theta[table.swing, 1:], axis=0).max() > settings.pushed_rad:
        begins = table.t[start] - origin
        raise RunError(
            f"{table.path}: the rods hang at rest until {begins:.4g} s after the first row and then swing:"
            f" they were pushed by an unknown force. Exclude the push (--start-s {begins + 1:.4g}), or name"
            f" the torques' columns"
            " tau1_Nm, tau2_Nm; --keep-rest uses all rows"
        )


def _energy_questions(
    table: InterpretedTable, settings: QuestionSettings
) -> tuple[list[TableQuestion], list[OtherReading]]:
    """Doubts about units, zero, signs and order from the energy of the swing, and corrected interpretations."""
    looked_at, read = table.looked_at(settings), table.read(settings)
    fit = energy_fit(read.t, table.theta[looked_at, 1:], read.torques, table.rig)
    residual, others = math.nan, []
    if fit is not None and not table.prescribed:
        residual = fit.residual
        others = better_readings(fit, read)
        if not others and (doubt := _torque_question(table, fit, looked_at)):
            return [doubt], []
    if fit is not None and not others and table.options.inner != "prescribed":
        _refuse_unit_of_time(table, fit.kinetic_scale, settings)
    for other in others:
        if "--time-unit" in other.mend:
            raise RunError(_unit_of_time(table, *other.mend[1:]))
    if others:
        others = [_as_posed(table, other, settings) for other in others]
        return [_read_otherwise("the energy of the swing is not conserved; it is", others)], others
    doubts = []
    unexplained = settings.unexplained[table.torques is not None]
    if residual > unexplained:
        residual = residual_near(read.t, table.theta[looked_at, 1:], read.torques, table.rig)
    if residual > unexplained:
        share, rate = f"{percent(residual)} of" if residual < 1 else "more than", table.options.rate_hz
        pace = other_pace(read.t, table.theta[looked_at, 1:], table.rig) if rate and table.free else 1.0
        filmed = f"; much less with --rate-hz {rate * pace:g}: was it filmed so fast?" if rate and pace != 1.0 else ""
        doubts.append(
            TableQuestion(
                f"the energy of the swing changes by {share} the energy exchanged by gravity, which friction and known"
                " torques do not explain: check --unit, --zero, --offset, --angles, --columns, --time-unit, --torque"
                f" (in N m) and --arm, and lengths and masses of the rig{filmed}"
            )
        )
    elif fit is not None and table.free and abs(math.log(fit.time_scale)) >= math.log(settings.time_scale):
        doubts.append(
            TableQuestion(
                f"the rods swing {fit.time_scale:.3g} times as fast as predicted from lengths and masses of the rig"
                " file: check L1, masses and inertias of the rig, --rate-hz or --time-unit"
            )
        )
    upright = table.options.zero == "upright" and table.options.unit != "counts" and not residual <= READ.right
    upright = upright and table.torques is None and table.ignored is None  # drives can hold rods up
    upright = upright and (table.options.pose is None or not table.arm_moves)  # the pose shows a wrong zero
    radians = table.free and table.options.unit in (None, "rad")
    odd = odd_notes(table.t[table.swing], table.theta[table.swing], upright, table.rig.rods.number, radians)
    return [TableQuestion(note) for note in odd] + doubts, []


def _read_otherwise(broken: str, others: list[OtherReading]) -> TableQuestion:
    causes = "; or ".join(other.sentence for other in others)
    return TableQuestion(f"with these options {broken} if {causes}", others[0].mend if len(others) == 1 else ())


def _balance_questions(table: InterpretedTable, settings: QuestionSettings) -> list[TableQuestion]:
    """Doubt about zeros, scales and signs from the accelerations of the swing, which are more sensitive than energy."""
    if table.prescribed:
        return []
    others = balanced_readings(table.read(settings))
    broken = "the accelerations do not follow from gravity and friction; they do"
    return [_read_otherwise(broken, others)] if others else []


def _rig_questions(table: InterpretedTable, settings: QuestionSettings) -> list[TableQuestion]:
    """Doubt about the rig file from inertias that its bounds exclude; motors add an inertia of their own."""
    if not table.free or table.ignored or table.rig.joints.geared:
        return []
    read = table.read(settings)
    balance = torque_balance(read.t, read.rods(read.values, read.options), None, read.rig)
    if balance is None:
        return []
    residual, ratios = balance.inertias()
    least, most = inertia_bounds(table.rig, balance.elbow)
    factor = max(np.max(least / ratios), np.max(ratios / most))
    if residual > settings.same_rig or factor <= settings.other_rig:
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


def _torque_question(table: InterpretedTable, fit: EnergyFit, looked_at: slice) -> TableQuestion | None:
    """Doubt about sign, unit, order or absence of the torques, if another interpretation conserves the energy."""
    others = list(other_torques(table.torques, table.torque_columns, table.options.scale, table.ignored))
    others = [replace(other, torques=other.torques[looked_at]) for other in others]
    best = better_torques(fit, table.t[looked_at], table.theta[looked_at][:, 1:], others, table.rig)
    if best is None:
        return None
    return TableQuestion(
        f"with these options the energy of the swing is not conserved; it is if {best.cause} ({' '.join(best.words)})",
        best.words,
    )


def _unit_questions(table: InterpretedTable, settings: QuestionSettings) -> list[TableQuestion]:
    """Doubt about the unit of the angles of a moving arm or its rods, from the equation of the last rod."""
    unit = table.options.unit
    if not table.arm_moves or unit not in TO_RADIANS:
        return []
    other, read = "rad" if unit == "deg" else "deg", table.read(settings)
    factor = TO_RADIANS[other] / TO_RADIANS[unit]
    converted, _ = angles(read.values, replace(table.options, unit=other), table.rig, table.path)
    balance, balance_converted = (
        arm_balance(read.t, theta, table.rig) for theta in (table.theta[table.looked_at(settings)], converted)
    )
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
    return [TableQuestion(sentence, mend)]


def _arm_questions(table: InterpretedTable, theta0: Array, settings: QuestionSettings) -> list[TableQuestion]:
    """Doubt about an arm that is specified as clamped."""
    if table.arm_moves or not (moved := float(np.ptp(theta0))) > settings.arm_rad:
        return []
    known = "L0" in table.rig.rig.model_fields_set
    mend = "--arm prescribed" + ("" if known else ", with the arm's length L0 in [rig] of the rig file")
    sentence = f"theta0 moves by {moved:.2g} rad, but the arm is specified as clamped: if it moved, import with {mend}"
    return [TableQuestion(sentence, ("--arm", "prescribed") if known else ())]


def _refuse_unit_of_time(table: InterpretedTable, scale: float, settings: QuestionSettings) -> None:
    now = table.options.time_unit or "s"
    if not 0 < scale < np.inf or 1 / settings.other_unit < scale < settings.other_unit or table.options.rate_hz:
        return
    unit = min(TO_SECONDS, key=lambda name: abs(math.log(TO_SECONDS[name] / TO_SECONDS[now] / scale)))
    if unit != now:
        raise RunError(_unit_of_time(table, unit))


def _unit_of_time(table: InterpretedTable, unit: str) -> str:
    lasts = table.t[-1] - table.t[0]
    return (
        f"{table.path}: in {table.options.time_unit or 's'} the table lasts {lasts:.4g} s and its rods"
        f" {'hardly move' if unit != 's' else 'turn far too fast'}; the rods of the rig swing with periods of"
        f" {' and '.join(f'{period:.2g} s' for period in periods(table.rig))}: the times are in {unit}"
        f" (--time-unit {unit}), or the angles in another unit (--unit)"
    )


def _few(table: InterpretedTable, t: Array, settings: QuestionSettings) -> list[TableQuestion]:
    """Doubts about rate and duration.

    Raises:
        RunError: too few rows to follow a swing.
    """
    slow, fast = periods(table.rig)
    step, lasts = float(np.median(np.diff(t))), float(t[-1] - t[0])
    doubts = []
    if step > fast / settings.refused_rows_a_period:
        raise RunError(
            f"{table.path}: rows are {step:.3g} s apart, but the rods of this rig swing with a period of"
            f" {fast:.2g} s: too few rows per period. Is the unit of time right (--time-unit ms), or the rate"
            " (--rate-hz)?"
        )
    if step > fast / settings.rows_a_period:
        doubts.append(
            TableQuestion(
                f"rows are {step:.3g} s apart, {fast / step:.1f} in a period of the faster oscillation ({fast:.2g} s):"
                f" record at {settings.rows_a_period * 4 / fast:.0f} Hz or more, or correct --time-unit or --rate-hz"
            )
        )
    if len(t) < settings.few_rows or lasts < slow / 2:
        doubts.append(
            TableQuestion(
                f"{len(t)} rows in {lasts:.3g} s: a recording of less than {settings.few_rows} rows or of less"
                f" than half a period of the slower oscillation ({slow:.2g} s) contains little information"
            )
        )
    return doubts


def _torque_doubts(table: InterpretedTable, settings: QuestionSettings) -> list[TableQuestion]:
    """Doubts about known torques: their rows are too far apart, or the rods move as if they did not act.

    The input of a driven arm does not act on the rods: only the distance of its rows is judged.
    """
    if table.torques is None:
        return []
    words = "the input of the arm changes" if table.arm_moves else "the torques change"
    coarse = coarse_torques(table.torques[table.swing], settings.torque_step, words)
    if table.arm_moves:
        return [TableQuestion(coarse)] if coarse else []
    read = table.read(settings)
    rods, columns = read.rods(read.values, read.options), table.torque_columns
    idle = idle_torques(read.t, rods, read.torques, columns, read.rig, settings.idle)
    return [TableQuestion(sentence) for sentence in (coarse, idle) if sentence]


def _pose_questions(table: InterpretedTable, settings: QuestionSettings) -> list[TableQuestion]:
    """Doubts about the pose of the release.

    Raises:
        RunError: the release is at another pose.
    """
    if table.options.pose is None:
        return []
    began = np.median(table.theta[table.rest, 1:], axis=0)
    deviations = {name: apart(began, pose.theta[1:]) / pose.tolerance for name, pose in table.rig.poses.items()}
    pose = table.rig.poses[table.options.pose]
    if (away := deviations[table.options.pose]) <= settings.pose[0]:
        return []
    began_at, asked_for = (f"theta1 = {a:.2f}, theta2 = {b:.2f} rad" for a, b in (began, pose.theta[1:]))
    near = [name for name, distance in deviations.items() if distance <= settings.pose[0]]
    counted = table.options.unit == "counts"
    keys = (
        "zero_counts, joint2, direction and counts_per_rev of the rig file"
        if counted
        else "--zero, --offset, --angles, --unit"
    )
    mend, words = f"remove --pose, or correct {keys}", ()
    if near:
        mend, words = f"it is pose {near[0]} (--pose {near[0]})", ("--pose", near[0])
    elif others := _readings_in_pose(table, settings) or _zeros_in_pose(table, pose.theta[1:] - began, settings):
        mend = f"it would if {'; or '.join(other.sentence for other in others)}"
        words = others[0].mend if len(others) == 1 else ()
    sentence = f"the swing starts at {began_at}, not in pose {table.options.pose} ({asked_for}): {mend}"
    if away > settings.pose[1]:
        raise RunError(f"{table.path}: {sentence}")
    return [TableQuestion(sentence, words)]


def _readings_in_pose(table: InterpretedTable, settings: QuestionSettings) -> list[OtherReading]:
    """Interpretations with the swing starting in the named pose and conserving its energy, fewest changes first."""
    read = table.read(settings)
    others, as_read = list(read.others()), OtherReading((), (), read.values, table.options)
    candidates = [as_read.mirrored, *others, *(other.mirrored for other in others)]
    posed = [other for other in candidates if other.time_factor == 1 and _in_pose(table, other, settings)]
    residuals = [_residual(read, other) for other in posed]
    limit = min(READ.right, READ.alike * min(residuals, default=0.0))
    matching = [other for other, residual in zip(posed, residuals, strict=True) if residual <= limit]
    fewest = min((len(other.causes) for other in matching), default=0)
    return [other for other in matching if len(other.causes) == fewest]


def _zeros_in_pose(table: InterpretedTable, added: Array, settings: QuestionSettings) -> list[OtherReading]:
    """The table with other zeros, for which its swing starts in the named pose, unless its energy is then worse."""
    if table.options.unit == "counts" or table.options.pose is None:
        return []
    read, tolerance = table.read(settings), table.rig.poses[table.options.pose].tolerance
    other = with_zeros(read.values, table.options, added, tolerance)
    worst = max(READ.right, _residual(read, replace(other, values=read.values)))
    return [other] if _residual(read, other) <= worst else []


def _residual(read: ReadTable, other: OtherReading) -> float:
    fit = energy_fit(read.t, read.rods(other.values, other.options), read.torques, read.rig)
    return math.inf if fit is None else fit.residual


def _as_posed(table: InterpretedTable, other: OtherReading, settings: QuestionSettings) -> OtherReading:
    """An interpretation, or its mirror image if only that starts in the named pose."""
    behind = not _in_pose(table, other, settings) and _in_pose(table, other.mirrored, settings)
    return other.mirrored if behind else other


def _in_pose(table: InterpretedTable, other: OtherReading, settings: QuestionSettings) -> bool:
    if table.options.pose is None:
        return False
    pose = table.rig.poses[table.options.pose]
    released = {axis: column[:1] for axis, column in other.values.items()}
    (rods,) = table.read(settings).rods(released, other.options)
    return apart(rods, pose.theta[1:]) <= settings.pose[0] * pose.tolerance


def apart(rods: Array, pose: Array) -> float:
    """Largest distance of a rod from a pose, without whole turns, rad."""
    return float(np.abs((rods - pose + np.pi) % (2 * np.pi) - np.pi).max())
