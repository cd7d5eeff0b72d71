"""Warn about a table that contains more than one motion."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.estimation.usable_runs import long_gap
from dpr_lab.identification.misread.balance import periods
from dpr_lab.identification.misread.rising_energy import energy_rises
from dpr_lab.shown import percent
from dpr_lab.storage.tables.interpreted import InterpretedTable, TableQuestion
from dpr_lab.storage.tables.plausible import PLAUSIBLE


@dataclass(frozen=True, slots=True)
class JoinSettings:
    """Limits beyond which the readings before and after an interruption do not belong to one motion."""

    rows: int = 4
    """Number of rows before, and number of rows after an interruption to which one polynomial is fitted."""
    degree: int = 4
    """Degree of the polynomial."""
    lost: int = 3
    """Maximum number of missing rows. The motion in a longer interruption cannot be predicted."""
    times: float = 5.0
    """Minimum ratio of the residual at the interruption to the reference residual."""
    usual: float = 0.95
    """Reference residual: this quantile of the residuals at other places, with as many rows left out."""
    share: float = 0.02
    """Minimum residual relative to the range of the angle."""
    margin: float = 0.25
    """Duration before and after a rise of the energy that is excluded, too, in periods of small swings. A hand that
    catches or holds the rods does not increase their energy."""
    places: tuple[int, int] = (20, 300)
    """Minimum and maximum number of other places."""


JOIN = JoinSettings()


def joined_questions(table: InterpretedTable) -> list[TableQuestion]:
    """Warn about the first interruption after which a further recording seems to begin."""
    t, theta = table.t[table.swing], table.theta[table.swing, 1:]
    steps = np.diff(t)
    lost = np.rint(steps / np.median(steps)).astype(np.intp) - 1
    for rows in range(1, JOIN.lost + 1):
        gaps = np.flatnonzero((steps > PLAUSIBLE.gap_steps * np.median(steps)) & (lost == rows)) + 1
        gaps = gaps[(gaps >= JOIN.rows) & (gaps <= len(t) - JOIN.rows)][: JOIN.places[1]]
        most = _usual(t, theta, lost == 0, rows) if len(gaps) else np.inf
        for after in gaps:
            part = slice(after - JOIN.rows, after + JOIN.rows)
            if (_residual(t[part], theta[part]) > most).any():
                sentence = (
                    f"the readings before and after the interruption at {t[after - 1]:.5g} s do not belong to one"
                    " motion: if another swing begins there, import both swings separately"
                    f" ({_gap_parts(table, t, after)})"
                )
                return [TableQuestion(sentence)]
    return []


def gap_questions(table: InterpretedTable) -> list[TableQuestion]:
    """Warn about the first interruption that is too long to predict the motion in it."""
    t = table.t[table.swing]
    after, words = long_gap(t)
    return [TableQuestion(f"the table {words} ({_gap_parts(table, t, after)})")] if words else []


def section_questions(table: InterpretedTable) -> list[TableQuestion]:
    """Warn about a repeated header in a table without times, because another recording begins there."""
    t, half = table.t, 0.5 * float(np.median(np.diff(table.t)))
    begins = [begin - half for begin in table.sections if t[0] < begin <= t[-1]]
    if not begins or np.diff([t[0], *begins, t[-1]]).min() < periods(table.rig)[0]:
        return []
    recordings = "; ".join(_parts(table, [(begin - t[0], begin - t[0]) for begin in begins]))
    return [TableQuestion(f"another recording begins at the repeated header: import each separately ({recordings})")]


def rise_questions(table: InterpretedTable) -> list[TableQuestion]:
    """Warn about rises of the energy of a free swing, and name the parts without them."""
    if not table.free or table.drive or table.ignored:
        return []
    read = table.beginning()
    rises = energy_rises(read.t, read.rods(read.values, read.options), table.rig)
    if not rises:
        return []
    period, first = periods(table.rig)[0], table.t[0]
    margin = JOIN.margin * period
    begins, ends = [rise.begin - margin for rise in rises], [rise.end + margin for rise in rises]
    long = np.subtract([*begins, read.t[-1]], [read.t[0], *ends]) >= period
    if not long.any():
        return []
    cuts = [
        (math.floor(100 * max(begin - first, 0.0)) / 100, math.ceil(100 * (end - first)) / 100)
        for begin, end in zip(begins, ends, strict=True)
    ]
    before, after = f"{cuts[0][0]:g}", f"{cuts[-1][1] + table.options.start_s:g}"
    share = max(rise.share for rise in rises)
    amount = f"{percent(share)} of" if share < 1 else "more than"
    rises_by = f"the energy of the rods rises by {amount} the energy exchanged by gravity"
    force = "a drive or a hand probably acted"
    if not long[:-1].any():
        sentence = (
            f"use only the swing from {after} s on (--start-s {after}): before that time, {force}, because {rises_by}"
        )
    elif not long[1:].any():
        sentence = f"use only the first {before} s (--duration-s {before}): later, {force}, because {rises_by}"
    else:
        places = " and ".join(f"after {begin:g} s" for begin, _ in cuts)
        parts = [part for part, usable in zip(_parts(table, cuts), long, strict=True) if usable]
        use = "Use only the part without a rise"
        if len(parts) > 1:
            use = "Import the parts without a rise as separate runs"
        sentence = (
            f"{rises_by} {places}: another swing begins, a hand or a drive acts, or readings are wrong. {use}"
            f" ({'; '.join(parts)})"
        )
    return [TableQuestion(sentence)]


def _gap_parts(table: InterpretedTable, t: Array, after: int) -> str:
    """Return the import options of the parts before and after the interruption that ends at row `after`."""
    begin, end = (t[[after - 1, after]] - table.t[0]).tolist()
    lasts = begin + float(np.median(np.diff(t)))  # the row at the end of a duration is excluded
    return "; ".join(_parts(table, [(lasts, end)]))


def _parts(table: InterpretedTable, cuts: Sequence[tuple[float, float]]) -> list[str]:
    """Return the import options of each part that remains after the cuts.

    A cut lasts from its first to its second instant, s after the first row.
    """
    parts = list[str]()
    for begin, end in zip([0.0, *(end for _, end in cuts)], [*(begin for begin, _ in cuts), math.inf], strict=True):
        start = f"--start-s {table.options.start_s + begin:.6g}" if begin else ""
        duration = f"--duration-s {end - begin:.6g}" if end < math.inf else ""
        parts.append(f"{start} {duration}".strip())
    return parts


def _usual(t: Array, theta: Array, whole: Flags, lost: int) -> float:
    """Return the largest plausible residual at an interruption within one motion, rad.

    The result is infinite if the table has too few places to estimate the residual.

    Args:
        t: (n,) s
        theta: (n, rods) rad
        whole: (n - 1,) mask of the steps without a missing row
        lost: number of rows that are left out at each place
    """
    length = 2 * JOIN.rows + lost
    if len(whole) < length:
        return np.inf
    begins = np.flatnonzero(np.lib.stride_tricks.sliding_window_view(whole, length - 1).all(axis=1))
    fewest, most = JOIN.places
    if len(begins) < fewest:
        return np.inf
    near = np.delete(np.arange(length), np.arange(JOIN.rows, JOIN.rows + lost))
    begins = begins[np.linspace(0, len(begins) - 1, min(len(begins), most)).astype(np.intp)]
    residuals = [_residual(t[begin + near], theta[begin + near]).max() for begin in begins]
    return float(max(JOIN.times * np.quantile(residuals, JOIN.usual), JOIN.share * np.ptp(theta, axis=0).max()))


def _residual(t: Array, theta: Array) -> Array:
    """Fit a polynomial to the rows; return the largest residual (rods,), rad."""
    powers = np.vander((t - t.mean()) / np.ptp(t), JOIN.degree + 1)
    return np.abs(theta - powers @ np.linalg.lstsq(powers, theta, rcond=None)[0]).max(axis=0)
